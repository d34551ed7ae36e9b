"""One clearance of a survey beside the true one."""

from dataclasses import dataclass

from plnerf.line.ends import TWO_SIDED_95


@dataclass(frozen=True)
class Compared:
    """Metres; as in surveys counted from the wire's axis."""

    wire: str
    conductor: int
    """Id of the survey's."""
    true_m: float
    found_m: float | None
    """None: the survey states none."""
    sigma_m: float | None
    off_along_m: float | None
    """None where either place is not known."""
    at_most: bool = False
    """Whether the survey states an upper limit."""

    @property
    def error_m(self) -> float | None:
        """Found less true."""
        return None if self.found_m is None else self.found_m - self.true_m

    @property
    def within_95(self) -> bool | None:
        """None where no deviation is stated."""
        if self.error_m is None or self.sigma_m is None:
            return None
        if self.at_most and self.error_m > 0:
            return True
        return abs(self.error_m) <= TWO_SIDED_95 * self.sigma_m
