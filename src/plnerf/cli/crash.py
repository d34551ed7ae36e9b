"""The report of an exception that nobody expected: where it was raised, by which versions, and nothing else.

It holds no photos and no positions, so that it can be shown to anyone: no values of variables or options, and
the digits of messages are written as #.
"""

import platform
import re
import tempfile
import traceback
from collections.abc import Iterator, Sequence
from datetime import UTC, datetime
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path

PACKAGES = (
    "plnerf", "torch", "numba", "llvmlite", "numpy", "scipy", "opencv-python-headless", "pillow", "pycolmap",
    "pyproj", "laspy", "lazrs", "safetensors", "tyro", "mitsuba", "triton",
)  # fmt: skip


def write_crash_report(error: BaseException, arguments: Sequence[str]) -> Path:
    """Writes the report into the folder for temporary files; returns its path.

    arguments: of the command line.  Raises OSError where no such folder can be written.
    """
    text = crash_report(error, arguments)
    name = f"plnerf-crash-{datetime.now(UTC):%Y%m%d-%H%M%S}-"
    with tempfile.NamedTemporaryFile("w", prefix=name, suffix=".txt", delete=False, encoding="utf-8") as file:
        file.write(text)
    return Path(file.name)


def crash_report(error: BaseException, arguments: Sequence[str]) -> str:
    """Command and options without their values, versions, and the stacks of the error and of its causes."""
    command = " ".join(["plnerf", *_words_of_plnerf(arguments)])
    about = f"{platform.platform()}, Python {platform.python_version()}"
    stacks = [
        "".join(traceback.format_tb(one.__traceback__)) + f"{type(one).__qualname__}: {without_digits(one)}"
        for one in causes(error)
    ]
    return "\n\n".join([command, about, ", ".join(_versions()), *stacks]) + "\n"


def without_digits(error: BaseException) -> str:
    """An exception's message, in which nobody can read a position."""
    try:
        return re.sub(r"\d", "#", str(error))
    except Exception:  # a message that cannot be made must not hide the stack
        return "(its message cannot be read)"


def _words_of_plnerf(arguments: Sequence[str]) -> list[str]:
    """The command and the names of the options: values may be paths and places."""
    options = [word.split("=")[0] for word in arguments[1:] if re.match(r"--?[a-z]", word)]
    return [*arguments[:1], *options]


def _versions() -> Iterator[str]:
    for package in PACKAGES:
        try:
            yield f"{package} {version(package)}"
        except PackageNotFoundError:
            continue


def causes(error: BaseException | None) -> list[BaseException]:
    """The error, last, after what it was raised from, as a traceback shows them."""
    chain: list[BaseException] = []
    while error is not None and error not in chain:
        chain.append(error)
        error = error.__cause__ or (None if error.__suppress_context__ else error.__context__)
    return chain[::-1]
