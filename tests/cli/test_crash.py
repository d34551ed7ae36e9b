"""An exception that nobody expected ends in one paragraph and a report that holds nothing of the input."""

import errno
import re
import sys
import tempfile
from pathlib import Path

import pytest

from plnerf.cli.main import main

PLACE, NAME = "47.37689, 8.54172", "DJI_0815.JPG"


def broken(*_: object, **__: object) -> None:
    position = PLACE
    try:
        float(f"{position} of {NAME}")
    except ValueError as error:
        raise RuntimeError(f"a photo at {position}\nis elsewhere") from error


@pytest.fixture
def defect(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> str:
    """What is printed of it."""
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path / "temporary"))
    monkeypatch.setattr("plnerf.pipeline.train_scene", broken)
    place = ["--line-azimuth", "47.37689", "--seed=815"]
    monkeypatch.setattr(sys, "argv", ["plnerf", "train", str(tmp_path / "my garden"), "-o", "out", *place])
    with pytest.raises(SystemExit) as ended:
        main()
    assert ended.value.code == 70
    return capsys.readouterr().err


def test_the_report_says_where_and_nothing_of_the_input(
    tmp_path: Path, request: pytest.FixtureRequest
) -> None:
    (tmp_path / "temporary").mkdir()
    text: str = request.getfixturevalue("defect")
    assert "Traceback" not in text and text.count("\n") == 1
    assert text.startswith("Defect: plnerf met an error that it should have handled: RuntimeError, a photo")
    (report,) = (tmp_path / "temporary").iterdir()
    assert str(report) in text and re.fullmatch(r"plnerf-crash-\d{8}-\d{6}-\w+\.txt", report.name)
    content = report.read_text()
    command, system, versions, cause, error = content.split("\n\n")
    assert command == "plnerf train -o --line-azimuth --seed" and "Python 3" in system
    assert "plnerf 0." in versions and "torch " in versions
    assert cause.endswith("to float: '##.#####, #.##### of DJI_####.JPG'")
    assert error.endswith("RuntimeError: a photo at ##.#####, #.#####\nis elsewhere\n")
    assert "in broken" in cause and "in main" in error
    assert not re.search(r"47\.3|8\.54|0?815\b|my garden", content)


def test_without_a_place_for_the_report_the_error_is_still_told(defect: str) -> None:
    assert "a photo at 47.37689, 8.54172 is elsewhere" in defect
    assert "No crash report could be written" in defect and "Traceback" not in defect


def of_cuda() -> type[Exception]:
    return type("OutOfMemoryError", (RuntimeError,), {})


def caused(error: Exception, cause: Exception) -> Exception:
    error.__cause__ = cause
    return error


NOT_LOADED = "libtorch_cpu.so: failed to map segment from shared object"


@pytest.mark.parametrize(
    ("error", "said"),
    [
        (MemoryError("Unable to allocate 7.45 GiB"), "Unable to allocate 7.45 GiB"),
        (MemoryError(), "an allocation failed"),
        (RuntimeError("DefaultCPUAllocator: can't allocate memory: 8 bytes"), "DefaultCPUAllocator: can't"),
        (RuntimeError("can't start new thread"), "can't start new thread"),
        (of_cuda()("CUDA out of memory"), "CUDA out of memory"),
        (ImportError(NOT_LOADED), NOT_LOADED),
        (caused(OSError("Could not find/load shared object file"), OSError(NOT_LOADED)), NOT_LOADED),
        (OSError(errno.ENOMEM, "Cannot allocate memory", "a"), "[Errno 12] Cannot allocate memory: 'a'"),
    ],
    ids=str,
)
def test_memory_that_is_not_there_is_no_defect(
    error: Exception,
    said: str,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    def starved(*_: object, **__: object) -> None:
        raise error

    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path))
    monkeypatch.setattr("plnerf.pipeline.train_scene", starved)
    monkeypatch.setattr(sys, "argv", ["plnerf", "train", "a scene", "-o", "out"])
    with pytest.raises(SystemExit) as ended:
        main()
    text = capsys.readouterr().err
    assert ended.value.code == 1 and text.startswith(f"Out of memory: {said}")
    assert "Close other programs" in text
    assert text.count("\n") == 1 and list(tmp_path.iterdir()) == []
