"""Terminal output of texts that hold what users and strangers named: files, cameras, wires.

A terminal obeys escape sequences, so that a file's name could clear the screen, retitle the window or make a
line read as another.
"""

import unicodedata
from typing import Any

from rich.console import Console

_KEPT = {"\n", "\t"}
_CONTROLS = {"Cc", "Cs", "Zl", "Zp"}
"""Unicode's categories of control characters, halves of characters, and ends of lines and paragraphs."""
_TURNS = set("\u200e\u200f\u202a\u202b\u202c\u202d\u202e\u2066\u2067\u2068\u2069")
"""Characters that make a text run from right to left, or the other way."""


def printable(text: str) -> str:
    """The text with every character that a terminal would obey written as its number: \\x1b for escape."""
    if text.isascii() and text.isprintable():
        return text
    return "".join(
        one
        if one in _KEPT or (unicodedata.category(one) not in _CONTROLS and one not in _TURNS)
        else one.encode("unicode_escape").decode()
        for one in text
    )


def one_line(text: str, most: int = 4000) -> str:
    """An error in one paragraph, whatever the names in it hold."""
    line = text.replace("\n", "\\n")
    return line if len(line) <= most else f"{line[:most]}..."


class Terminal(Console):
    """A console that prints texts as `printable` has them."""

    def print(self, *objects: Any, **options: Any) -> None:
        """As that of `Console`."""
        super().print(*(printable(one) if isinstance(one, str) else one for one in objects), **options)

    def on_broken_pipe(self) -> None:
        """Nobody reads any more: the command line ends as where anything else is not read (`cli/stop.py`)."""
        if self.stderr:  # nobody reads errors either
            super().on_broken_pipe()
        raise BrokenPipeError
