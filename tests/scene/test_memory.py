"""What does not fit is refused with an estimate; limits count, and little is not asked for."""

import resource
from pathlib import Path

import pytest
from rich.console import Console
from tests.support.tiny_run import open_tiny, tiny_config

from plnerf.console import bars
from plnerf.errors import ConfigError, SurveyError
from plnerf.scene import memory
from plnerf.scene.memory import available_bytes, require_memory
from plnerf.train.report import RunLog


def test_what_does_not_fit_is_refused_with_the_estimate(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(memory, "available_bytes", lambda: 8e9)
    require_memory(7.9e9, "A view", "Render at a smaller scale.")
    with pytest.raises(ConfigError) as caught:
        require_memory(8.1e9, "A view", "Render at a smaller scale.")
    assert str(caught.value) == (
        "A view needs at least 8.1 GB of memory, but 8.0 GB are free. Render at a smaller scale."
    )
    with pytest.raises(SurveyError, match=r"at least 1e\+21 GB of memory"):
        require_memory(1e30, "A line", "Correct it.", SurveyError)


def test_little_is_not_asked_for(monkeypatch: pytest.MonkeyPatch) -> None:
    def asked() -> float:
        raise AssertionError

    monkeypatch.setattr(memory, "available_bytes", asked)
    require_memory(1e6, "A line", "Correct it.")


@pytest.mark.parametrize(
    ("limit", "free"), [("9000000", 6_000_000), ("2000000", 0), ("max", None), ("", None), (None, None)]
)
def test_the_limit_of_a_container_counts(
    limit: str | None, free: int | None, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    of_machine = available_bytes()
    monkeypatch.setattr(memory, "CGROUP", tmp_path)
    if limit is not None:
        (tmp_path / "memory.max").write_text(f"{limit}\n")
        (tmp_path / "memory.current").write_text("3000000\n")
    if free is None:
        assert available_bytes() == pytest.approx(of_machine, rel=0.5)
    else:
        assert available_bytes() == free


@pytest.mark.parametrize("limit", [1, resource.RLIM_INFINITY])
def test_the_limit_of_the_process_counts(limit: int, monkeypatch: pytest.MonkeyPatch) -> None:
    of_machine = available_bytes()
    monkeypatch.setattr(resource, "getrlimit", lambda what: (limit, limit))
    expected = of_machine if limit == resource.RLIM_INFINITY else 0.0
    assert available_bytes() == pytest.approx(expected, rel=0.5)


def test_no_thread_is_begun_where_it_may_find_no_memory(
    built_tiny_scene: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Python waits for ever for a thread that ends before it has begun."""
    config, scene = tiny_config(built_tiny_scene), open_tiny(built_tiny_scene, tmp_path)
    monkeypatch.setattr(memory, "available_bytes", lambda: 1e6)
    with pytest.raises(ConfigError, match=r"A command needs at least 0\.1 GB"), bars(Console()):
        pass
    with pytest.raises(ConfigError, match=r"raise the limit \(ulimit -v\)"):
        RunLog(tmp_path).begin(config, scene, 0)
