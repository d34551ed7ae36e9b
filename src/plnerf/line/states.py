"""The line in other states than the one surveyed: at other temperatures, in wind, under ice.  Values.

A wire keeps its attachments; what changes is its tension, and with it its sag, and in wind its swing.
LineFrame, metres; tensions in newtons.
"""

from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float

from plnerf.line.ends import Quantity
from plnerf.line.wire import Wire

SURVEYED = "as surveyed"
"""Name of the state of the survey itself, which no other may have."""


@dataclass(frozen=True)
class Load:
    """What acts on every wire of a line."""

    name: str
    temperature_c: float
    """Of the conductors."""
    wind_pa: float = 0.0
    """Pressure on the area that a wire, with its ice, shows to a wind square to the span; to the left of the
    line's direction where positive."""
    ice_mm: float = 0.0
    """Thickness of ice all around a wire."""
    ice_kg_m3: float = 900.0
    """Density of the ice."""

    @property
    def words(self) -> str:
        """What acts, briefly."""
        parts = [f"{self.temperature_c:g} °C"]
        if self.ice_mm:
            parts.append(f"{self.ice_mm:g} mm of ice of {self.ice_kg_m3:g} kg/m³")
        if self.wind_pa:
            side = "left" if self.wind_pa > 0 else "right"
            parts.append(f"wind of {abs(self.wind_pa):g} Pa to the {side}")
        return ", ".join(parts)


@dataclass(frozen=True, eq=False)
class WireState:
    """A wire of the survey in one state."""

    wire: int
    """Its id."""
    theta: Float[np.ndarray, "6"]
    """Of its curve, on the base that the surveyed wire has."""
    covariance: Float[np.ndarray, "6 6"]
    """Of theta; holds what is unknown of the survey, of the temperature then and of the conductor."""
    sag: Quantity
    """Greatest vertical drop below the chord."""
    sag_change: Quantity
    """Sag in this state less that of the survey."""
    horizontal_n: Quantity
    """Horizontal tension: across the load."""
    greatest_n: Quantity
    """Tension at the higher attachment."""
    strength_share: float | None
    """That tension over the conductor's rated strength; None: it is not given."""
    ruling_span_m: float
    """Of the tension section as far as it was surveyed."""

    def of(self, wire: Wire) -> Wire:
        """The surveyed wire as it hangs in this state.

        Its own `sag` has the interval of a curve whose ends are uncertain; use this state's.
        """
        return replace(wire, theta=self.theta, covariance=self.covariance)


@dataclass(frozen=True, eq=False)
class State:
    """All wires that a state could be computed of."""

    load: Load
    wires: tuple[WireState, ...]

    def of(self, wire: int) -> WireState | None:
        """That of a wire by its id; None: there is none."""
        return next((one for one in self.wires if one.wire == wire), None)


@dataclass(frozen=True, eq=False)
class States:
    """What was computed, and from what."""

    states: tuple[State, ...]
    temperature_c: Quantity
    """Of the conductors when they were surveyed."""
    temperature_from: str
    """How that is known, in words."""
    conductors: tuple[tuple[str, str], ...]
    """Kind of wire, and the name and source of the conductor that was taken for it."""
