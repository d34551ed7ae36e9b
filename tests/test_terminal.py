"""What a file is named reaches the terminal as text; what the system refuses is explained by its reason."""

import errno
import io
import os
import sys
from pathlib import Path

import pytest

from plnerf.cli.main import main
from plnerf.errors import PlnerfError, advice_on
from plnerf.scene.files import complete_file, write_text
from plnerf.terminal import Terminal, one_line, printable

HOSTILE = "a\x1b[2J\x1b]0;title\x07\r\x9b31m\u202egpj.exe\udcff\u2028.laz"


def test_no_character_is_obeyed() -> None:
    text = printable(HOSTILE)
    assert text.isprintable() and text.startswith(r"a\x1b[2J\x1b]0;title\x07\r\x9b31m\u202egpj.exe\udcff")
    for plain in ("Zürich 5 µm – 山 😀.jpg", "two\nlines\tand a tab", ""):
        assert printable(plain) == plain


def test_a_terminal_prints_texts_only() -> None:
    out = io.StringIO()
    Terminal(file=out).print(f"[bold]{HOSTILE}", 3, soft_wrap=True)
    assert out.getvalue() == f"{printable(HOSTILE)} 3\n"


def test_an_error_is_one_paragraph() -> None:
    assert one_line("a\nb") == r"a\nb" and len(one_line("x" * 10_000)) < 5000


def test_a_hostile_name_in_an_error_is_printed_as_text(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / HOSTILE.replace("\u2028", "\n")
    path.write_bytes(b"no cloud")
    monkeypatch.setattr(sys, "argv", ["plnerf", "survey", str(path)])
    with pytest.raises(SystemExit):
        main()
    text = capsys.readouterr().err
    assert r"a\x1b[2J" in text and r"\udcff\n.laz cannot be read as LAS" in text
    assert all(one.isprintable() or one == "\n" for one in text)


@pytest.mark.parametrize("name", ["y" * 251 + ".txt", "y" * 255, "é" * 120 + ".json", "." + "y" * 254])
def test_a_name_as_long_as_can_be_is_written(name: str, tmp_path: Path) -> None:
    assert len(os.fsencode(name)) <= 255
    write_text(tmp_path / name, "text")
    assert (tmp_path / name).read_text() == "text" and len(list(tmp_path.iterdir())) == 1


def test_a_name_that_is_too_long_is_not_blamed_on_the_disk(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    with pytest.raises(PlnerfError, match="A name is longer than the file system takes"):
        write_text(tmp_path / ("y" * 256), "text")
    monkeypatch.setattr(sys, "argv", ["plnerf", "capture", str(tmp_path), "-o", str(tmp_path / ("y" * 256))])
    (tmp_path / "a.png").write_bytes(b"")
    with pytest.raises(SystemExit):
        main()
    monkeypatch.setattr(sys, "argv", ["plnerf", "doctor", str(tmp_path / ("y" * 256))])
    with pytest.raises(SystemExit):
        main()
    assert "A name is longer than the file system takes" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("number", "text"),
    [
        (errno.ENOSPC, "Make room on the disk."),
        (errno.EFBIG, "Files may not get so large here"),
        (errno.ENOMEM, "The system is short of memory"),
        (errno.EROFS, "The disk is read-only"),
        (errno.EACCES, "Check that you may read and write there."),
        (errno.EIO, "Check that the folder exists, is writable and has space left."),
    ],
)
def test_advice_is_about_the_reason(number: int, text: str, tmp_path: Path) -> None:
    assert advice_on(OSError(number, "why")).startswith(text)
    with pytest.raises(PlnerfError, match=text), complete_file(tmp_path / "a"):
        raise OSError(number, "why")
