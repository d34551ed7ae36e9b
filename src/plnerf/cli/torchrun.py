"""What the command line does where torchrun started it in several processes: rank 0 alone prints.

An error that a command line, a scene or a setting has is every rank's.  The others are silent about it until
they have joined rank 0 to train; what they meet after that is their own, and printed with their rank.
"""

import os
from collections.abc import Sequence

from plnerf.errors import ConfigError

BEFORE_OTHERS_S = 1.0
"""Time that another rank leaves to rank 0 to print an error of both: torchrun ends all when one has ended."""
SHARED = ("train",)
"""Commands that several processes run together."""


def rank_of_process() -> int:
    """The rank that torchrun gave to this process; 0 without it."""
    return int(os.environ.get("RANK", "0")) if "TORCHELASTIC_RUN_ID" in os.environ else 0


def joined() -> bool:
    """Whether this process has joined the others to train."""
    from torch.distributed import is_initialized  # takes time, and almost no command comes here

    return is_initialized()


def require_shared(arguments: Sequence[str]) -> None:
    """Raises ConfigError where several processes would run a command that is one process's."""
    several = "TORCHELASTIC_RUN_ID" in os.environ and int(os.environ.get("WORLD_SIZE", "1")) > 1
    if several and arguments and arguments[0] not in (*SHARED, "-h", "--help"):
        raise ConfigError(
            f"Only plnerf train runs in several processes, but torchrun started plnerf {arguments[0]} in "
            f"{os.environ['WORLD_SIZE']}. Start it without torchrun."
        )
