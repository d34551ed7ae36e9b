"""What a table of the report is: cells, their meaning, and verdicts in them."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

from plnerf.report.figures import NOTHING
from plnerf.report.nearest import Nearest, Standing

SIGNS: dict[Standing, str] = {"short": "✕", "doubtful": "!", "kept": "✓", "open": NOTHING}
"""Before a verdict's words, so that colour is not needed to read it."""
XYZ = "x,\u00a0y,\u00a0z"
"""Head of a column of coordinates, which does not break."""


@dataclass(frozen=True)
class Verdict:
    """A verdict's words and sign; the standing gives its colour."""

    words: str
    standing: Standing

    @property
    def sign(self) -> str:
        """Of its standing."""
        return SIGNS[self.standing]


Cell = str | Verdict


@dataclass(frozen=True)
class Table:
    """Cells by row, and what they mean."""

    columns: Sequence[str]
    rows: Sequence[Sequence[Cell]]
    caption: str
    left: frozenset[int]
    """Columns of words, set left; all others are figures and set right."""
    groups: Mapping[int, str] = field(default_factory=dict)
    """Headings by the row that they stand before."""
    folded: str = ""
    """Where it is not empty, the table is hidden behind these words until a reader asks for it."""


def verdict_of(one: Nearest) -> Verdict:
    """As the page shows it."""
    return Verdict(one.words, one.standing)
