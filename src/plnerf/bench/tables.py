"""Tables of measurements, for the console and as Markdown."""

import math
from collections.abc import Sequence
from dataclasses import dataclass

from rich.box import SIMPLE_HEAD
from rich.markup import escape
from rich.table import Table as RichTable

from plnerf.errors import ConfigError


@dataclass(frozen=True)
class Table:
    """Cells are texts; the first column is set left, all others right."""

    title: str
    columns: tuple[str, ...]
    rows: tuple[tuple[str, ...], ...]
    notes: tuple[str, ...] = ()
    """Sentences below the table: what was counted and how."""

    def __post_init__(self) -> None:
        for row in self.rows:
            if len(row) != len(self.columns):
                raise ConfigError(
                    f"The table {self.title!r} has {len(self.columns)} columns, a row {len(row)}: {row}"
                )

    def markdown(self) -> str:
        """A heading, the table and its notes."""
        lines = [f"## {self.title}", "", _line(self.columns)]
        lines.append(_line(["---", *["---:"] * (len(self.columns) - 1)]))
        lines += [_line(row) for row in self.rows]
        for note in self.notes:
            lines += ["", note]
        return "\n".join(lines) + "\n"

    def for_console(self) -> RichTable:
        """The same for rich, its notes as the caption."""
        table = RichTable(
            title=escape(self.title), title_justify="left", box=SIMPLE_HEAD,
            caption=escape("\n".join(self.notes)) or None, caption_justify="left",
        )  # fmt: skip
        for i, column in enumerate(self.columns):
            table.add_column(escape(column), justify="right" if i else "left", overflow="fold")
        for row in self.rows:
            table.add_row(*map(escape, row))
        return table


def figure(value: float | None, digits: int = 3) -> str:
    """A number with so many significant digits, thousands separated; a dash for None."""
    if value is None:
        return "–"
    if value == 0 or not math.isfinite(value):
        return f"{value:.0f}"
    rounded = float(f"{value:.{digits}g}")
    places = max(0, digits - len(f"{abs(int(rounded))}".lstrip("0")))
    if abs(rounded) < 1:
        return f"{rounded:.{digits}g}"
    return f"{rounded:,.{places}f}"


def percent(share: float | None) -> str:
    """A share in percent; a dash for None."""
    return "–" if share is None else f"{100 * share:.0f} %"


def _line(cells: Sequence[str]) -> str:
    return "| " + " | ".join(cell.replace("|", "\\|") for cell in cells) + " |"
