"""What does not fit is refused with an estimate; a container's limit counts, and little is not asked for."""

from pathlib import Path

import pytest

from plnerf.errors import ConfigError, SurveyError
from plnerf.scene import memory
from plnerf.scene.memory import available_bytes, require_memory


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
