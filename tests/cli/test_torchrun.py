"""What the command line does in one of several processes."""

import pytest

from plnerf.cli.torchrun import rank_of_process, require_shared
from plnerf.errors import ConfigError


def test_only_training_runs_in_several_processes(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv("TORCHELASTIC_RUN_ID", raising=False)
    monkeypatch.setenv("RANK", "1")  # other launchers set it, too
    monkeypatch.setenv("WORLD_SIZE", "2")
    assert rank_of_process() == 0
    require_shared(["eval", "RUN"])
    monkeypatch.setenv("TORCHELASTIC_RUN_ID", "some")
    assert rank_of_process() == 1
    require_shared(["train", "SCENE"])
    require_shared(["--help"])
    with pytest.raises(ConfigError, match=r"Only plnerf train runs in several processes, but .* eval in 2"):
        require_shared(["eval", "RUN"])
    monkeypatch.setenv("WORLD_SIZE", "1")
    require_shared(["eval", "RUN"])
