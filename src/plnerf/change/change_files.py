"""What differs between two surveys, as text for the terminal, as JSON and as CSV."""

import csv
import json
from collections import Counter
from dataclasses import asdict
from pathlib import Path
from typing import get_args

from plnerf.change.values import (
    Change,
    ClearanceChange,
    SagChange,
    Standing,
    StructureChange,
    WireAlone,
)
from plnerf.line.clearances import IN_WORDS
from plnerf.line.ends import Quantity
from plnerf.line.files import plain_values
from plnerf.scene.files import complete_file, write_text

FORMAT_VERSION = 1
JSON_FILE, CSV_FILE = "change.json", "change.csv"
FIGURES = ("before", "after", "difference", "expected", "by_object")
"""Columns of a row, which `values.py` describes."""
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
        lengths = [f"{name}{end}" for name in FIGURES for end in ("_m", "_95_m")]
        writer = csv.DictWriter(file, ["what", "a", "b", *lengths, "standing"], lineterminator="\n")
        writer.writeheader()
        writer.writerows(change_rows(change))


def change_rows(change: Change) -> list[Row]:
    """A row for each structure, wire's sag and clearance, and for each wire that one survey alone has."""
    rows = [_row("structure", one, difference=one.moved_m) for one in change.structures]
    rows += [
        _row(
            "sag", one, before=one.sag_a_m, after=one.sag_b_m, difference=one.difference_m,
            expected=one.expected_m,
        )
        for one in change.sags
    ]  # fmt: skip
    rows += [
        _row(
            f"clearance to {IN_WORDS[one.to]}", one, before=one.distance_a_m, after=one.distance_b_m,
            difference=one.difference_m, expected=one.expected_m, by_object=one.by_object_m,
        )
        for one in change.clearances
    ]  # fmt: skip
    return rows + [_row("wire", one) for one in change.wires]


def _row(
    what: str, one: StructureChange | SagChange | ClearanceChange | WireAlone, **figures: Quantity | None
) -> Row:
    row: Row = {"what": what, "a": one.a, "b": one.b, "standing": one.standing}
    for name in FIGURES:
        figure = figures.get(name)
        row[f"{name}_m"] = None if figure is None else round(figure.value, 4)
        row[f"{name}_95_m"] = None if figure is None else round(figure.half_95, 4)
    return row


def change_text(change: Change) -> str:
    """A table of what was compared, and a summary."""
    heads = " ".join(f"{name.replace('_', ' ') + ', m':>16}" for name in FIGURES)
    lines = [f"{'':26} {'A':>4} {'B':>4} {heads}  standing (± 95 %)"]
    for row in change_rows(change):
        cells = " ".join(f"{_cell(row, name):>16}" for name in FIGURES)
        a, b = ("-" if row[key] is None else str(row[key]) for key in ("a", "b"))
        lines.append(f"{row['what']:26} {a:>4} {b:>4} {cells}  {row['standing']}")
    counts = Counter(one.standing for one in change.rows)
    lines.append(
        f"{len(lines) - 1} rows: {', '.join(f'{counts[one]} {one}' for one in get_args(Standing))}. "
        f"A difference counts beyond {change.sigmas:.1f} standard deviations: the chance of any false alarm "
        f"among {change.comparisons} comparisons is 5 %."
    )
    return "\n".join([*lines, *change.notes])


def _cell(row: Row, name: str) -> str:
    value, half = row[f"{name}_m"], row[f"{name}_95_m"]
    if value is None:
        return "-"
    return f"{value:.2f}" if not half else f"{value:.2f} ± {half:.2f}"
