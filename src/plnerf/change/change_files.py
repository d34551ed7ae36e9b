"""What differs between two surveys, as text for the terminal, as JSON and as CSV."""

import csv
import json
from dataclasses import asdict
from pathlib import Path

from plnerf.change.values import Change, Standing
from plnerf.line.ends import Quantity
from plnerf.line.files import plain_values
from plnerf.scene.files import complete_file, write_text

FORMAT_VERSION = 1
JSON_FILE, CSV_FILE = "change.json", "change.csv"
COLUMNS = (
    "what", "a", "b", "before_m", "before_95_m", "after_m", "after_95_m", "difference_m", "difference_95_m",
    "expected_m", "expected_95_m", "standing",
)  # fmt: skip
Row = dict[str, str | float | int | None]


def write_change(folder: Path, change: Change, a: Path, b: Path) -> None:
    """Writes change.json and change.csv into a folder."""
    folder.mkdir(parents=True, exist_ok=True)
    content = {"format_version": FORMAT_VERSION, "a": str(a), "b": str(b), **plain_values(asdict(change))}
    text = json.dumps(content, indent=1, allow_nan=False, ensure_ascii=False)
    write_text(folder / JSON_FILE, text + "\n")
    with (
        complete_file(folder / CSV_FILE) as beside,
        beside.open("w", encoding="utf-8", newline="") as file,
    ):
        writer = csv.DictWriter(file, COLUMNS, lineterminator="\n")
        writer.writeheader()
        writer.writerows(change_rows(change))


def change_rows(change: Change) -> list[Row]:
    """A row for each structure, wire's sag and clearance.  expected_m: of the difference, what temperature
    explains of a sag, and what the wire's own movement explains of a clearance."""
    rows = [
        _row("structure", one.a, one.b, None, None, one.moved_m, None, one.standing)
        for one in change.structures
    ]
    rows += [
        _row("sag", one.a, one.b, one.sag_a_m, one.sag_b_m, one.difference_m, one.expected_m, one.standing)
        for one in change.sags
    ]
    rows += [
        _row(
            f"clearance to {one.to}", one.a, one.b, one.distance_a_m, one.distance_b_m, one.difference_m,
            Quantity(one.by_wire_m, 0.0), one.standing,
        )
        for one in change.clearances
    ]  # fmt: skip
    alone: tuple[tuple[int | None, int | None], ...] = (
        *((wire, None) for wire in change.only_a), *((None, wire) for wire in change.only_b)
    )  # fmt: skip
    return rows + [_row("wire", one, other, None, None, None, None, "different") for one, other in alone]


def _row(
    what: str, a: int | None, b: int | None, before: Quantity | None, after: Quantity | None,
    difference: Quantity | None, expected: Quantity | None, standing: Standing,
) -> Row:  # fmt: skip
    row: Row = {"what": what, "a": a, "b": b, "standing": standing}
    named = (("before", before), ("after", after), ("difference", difference), ("expected", expected))
    for name, one in named:
        row[f"{name}_m"] = None if one is None else round(one.value, 4)
        row[f"{name}_95_m"] = None if one is None else round(one.half_95, 4)
    return row


def change_text(change: Change) -> str:
    """A table of what was compared, and a summary."""
    lines = [
        f"{'':28} {'A':>5} {'B':>5} {'before, m':>16} {'after, m':>16} {'difference, m':>16} "
        f"{'expected, m':>16}  standing (± 95 %)"
    ]
    for row in change_rows(change):
        cells = " ".join(f"{_cell(row, name):>16}" for name in ("before", "after", "difference", "expected"))
        a, b = ("-" if row[key] is None else str(row[key]) for key in ("a", "b"))
        lines.append(f"{row['what']:28} {a:>5} {b:>5} {cells}  {row['standing']}")
    lines.append(
        f"{change.different} of {change.comparisons} differences are explained by neither uncertainty nor "
        f"temperature (beyond {change.sigmas:.1f} standard deviations)."
    )
    return "\n".join([*lines, *change.notes])


def _cell(row: Row, name: str) -> str:
    value, half = row[f"{name}_m"], row[f"{name}_95_m"]
    if value is None:
        return "-"
    return f"{value:.2f}" if not half else f"{value:.2f} ± {half:.2f}"
