"""What was written is read back and compared: a file that differs is not kept."""

from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float

from plnerf.errors import SurveyError

TOLERANCE_M = 1e-3
"""A coordinate that reads back differently by more is an error."""


def check_places(
    path: Path, wanted: Float[np.ndarray, "n 3"], found: Float[np.ndarray, "_ 3"], what: str
) -> None:
    """Raises SurveyError unless as many places are found, each within `TOLERANCE_M`."""
    check_same(path, len(wanted), len(found), f"the number of {what}")
    if not len(wanted):
        return
    apart = np.abs(wanted - found).max(axis=1)
    worst = int(np.argmax(np.where(np.isfinite(apart), apart, np.inf)))
    if not apart[worst] <= TOLERANCE_M:
        raise SurveyError(
            f"{path} reads back differently: of its {len(wanted)} {what}, number {worst} (from 0) should be "
            f"at {wanted[worst].tolist()}, but is at {found[worst].tolist()}. {_ADVICE}"
        )


def check_same(path: Path, wanted: Any, found: Any, what: str) -> None:
    """Raises SurveyError unless the two are equal."""
    if wanted != found:
        raise SurveyError(
            f"{path} reads back differently: {what} should be {wanted!r}, but is {found!r}. {_ADVICE}"
        )


def check_all(path: Path, equal: bool, what: str) -> None:
    """Raises SurveyError unless the comparison of a whole array held."""
    if not equal:
        raise SurveyError(f"{path} reads back differently: {what} differ. {_ADVICE}")


_ADVICE = "The file was not kept. Export again to a healthy disk; if it happens again, report this text."
