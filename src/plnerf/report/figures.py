"""How figures are written: lengths with their unit and their 95 % interval, counts, shares, lists."""

from dataclasses import dataclass
from typing import Literal

import numpy as np
from jaxtyping import Float

from plnerf.line.ends import Quantity

NOTHING = "–"
FOOT_M = 0.3048
"""The international foot."""
FINEST = 3
"""Decimals at most, where fewer would round the width of an interval to nothing."""
CERTAIN = "95\u00a0%"
"""Of the intervals behind all ± in a report."""
PLUS_MINUS, MINUS = "\u202f±\u202f", "−"


@dataclass(frozen=True)
class Units:
    """How lengths are written; values come in metres, or in units of an unscaled survey."""

    unit: Literal["m", "ft", "unscaled"]

    @property
    def short(self) -> str:
        """Behind a figure."""
        return "units" if self.unit == "unscaled" else self.unit

    def length(self, value: float | None, digits: int = 2) -> str:
        """A length with so many decimals; a dash where there is none."""
        if value is None or not np.isfinite(value):
            return NOTHING
        value = value / FOOT_M if self.unit == "ft" else value
        return f"{value:,.{digits}f}".replace("-", MINUS)

    def with_unit(self, value: float | None, digits: int = 2) -> str:
        """The same with its unit behind."""
        text = self.length(value, digits)
        return text if text == NOTHING else f"{text}\u00a0{self.short}"

    def interval(self, one: Quantity | None, digits: int = 2) -> str:
        """A length and half the width of its 95 % interval; a dash where there is none."""
        if one is None:
            return NOTHING
        half_95 = one.half_95 / FOOT_M if self.unit == "ft" else one.half_95
        while digits < FINEST and half_95 < 0.5 * 10.0**-digits:
            digits += 1
        half = self.length(one.half_95, digits) if np.isfinite(one.half_95) else "?"
        return f"{self.length(one.value, digits)}{PLUS_MINUS}{half}"

    def interval_with_unit(self, one: Quantity | None, digits: int = 2) -> str:
        """The same with its unit behind."""
        text = self.interval(one, digits)
        return text if text == NOTHING else f"{text}\u00a0{self.short}"

    def heads(self, *names: str) -> list[str]:
        """Heads of columns with lengths."""
        return [f"{name},\u00a0{self.short}" for name in names]

    def heads_95(self, *names: str) -> list[str]:
        """Heads of columns with lengths and their 95 % intervals."""
        return [f"{name},\u00a0{self.short} ±\u00a0{CERTAIN}" for name in names]

    def place(self, xyz: Float[np.ndarray, "3"]) -> str:
        """Coordinates of a point, without thousands separators so that they can be copied."""
        return ", ".join(f"{value:.2f}" for value in xyz)


AS_THEY_ARE = Units("unscaled")
"""Writes figures that are no lengths: angles, years."""


def degrees(value: float | None, digits: int = 1) -> str:
    """An angle with its sign of a degree; a dash where there is none."""
    return NOTHING if value is None else f"{value:.{digits}f}°".replace("-", MINUS)


def counted(count: int, noun: str) -> str:
    """ "1 span", "2 spans", "no spans"."""
    return f"{count:,} {noun}{'s' * (count != 1)}" if count else f"no {noun}s"


def share(part: float) -> str:
    """Per cent."""
    return f"{100 * part:.0f}\u00a0%"


def listed(parts: list[str]) -> str:
    """ "1, 2 and 3"."""
    return parts[0] if len(parts) == 1 else f"{', '.join(parts[:-1])} and {parts[-1]}"


def wires_named(ids: list[int]) -> str:
    """ "wire 1", "wires 1, 3 and 5", "wires 1 to 6 and 8"."""
    return f"wire{'s' if len(ids) > 1 else ''} {listed([part.replace('–', ' to ') for part in _runs(ids)])}"


def runs_of(ids: list[int]) -> str:
    """ "1", "1, 3, 5", "1–6, 8"."""
    return ", ".join(_runs(ids))


def _runs(ids: list[int]) -> list[str]:
    """Numbers in order; of three and more in a row the first and the last."""
    rows: list[list[int]] = []
    for one in sorted(ids):
        if rows and one == rows[-1][-1] + 1:
            rows[-1].append(one)
        else:
            rows.append([one])
    parts: list[str] = []
    for row in rows:
        parts += [f"{row[0]}–{row[-1]}"] if len(row) > 2 else [str(one) for one in row]
    return parts
