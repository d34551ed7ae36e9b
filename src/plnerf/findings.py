"""What a stage reports beside its result: what was found, where, and what to do about it.

Three degrees: `stops` (nothing good can come of it), `harms` (the result is worse for it), `note` (to know).
"""

from dataclasses import dataclass
from typing import Literal

Degree = Literal["stops", "harms", "note"]


@dataclass(frozen=True)
class Finding:
    """One thing that a reader of the result must know."""

    kind: str
    """What it is about, in one or two words, the same for the same thing."""
    degree: Degree
    what: str
    where: tuple[str, ...] = ()
    """Names of the images, wires or structures; empty where it is about all."""
    do: str = ""

    @property
    def text(self) -> str:
        """What was found and what to do about it, as one paragraph."""
        return f"{self.what} {self.do}".strip()


def note(kind: str, what: str, do: str = "") -> Finding:
    """A finding of the least degree about the whole result."""
    return Finding(kind, "note", what, do=do)


def harms(kind: str, what: str, do: str = "") -> Finding:
    """A finding about the whole result, which is worse for it."""
    return Finding(kind, "harms", what, do=do)
