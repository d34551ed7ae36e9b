"""What the conductors' temperatures explain of a difference: A's wires as they hang at B's temperature.

In still air, and compared with A's temperature in still air: no survey knows the wind of the other.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from plnerf.line.clearances import Place
from plnerf.line.ends import Quantity
from plnerf.line.states import Load, WireState
from plnerf.line.survey import Survey
from plnerf.line.wire import Wire
from plnerf.mechanics.config import MechanicsConfig
from plnerf.mechanics.states import compute_states
from plnerf.survey.obstacles import onto_wire


@dataclass(frozen=True, eq=False)
class Warmed:
    """A wire of A at the temperatures of both surveys."""

    sag: Quantity
    """By how much its sag changes; holds what is unknown of both temperatures and of the conductor."""
    at_a: Wire
    at_b: Wire
    warmer: Wire
    """At a temperature somewhat above B's."""
    warmer_sag_m: float
    """By how much its sag is greater there than at B's."""

    def distance(self, place: Place) -> Quantity:
        """By how much its distance to an obstacle in A changes."""
        at = place.on_obstacle[None]
        at_a, at_b, warmer = (
            float(onto_wire(one, at)[0][0]) for one in (self.at_a, self.at_b, self.warmer)
        )
        by_sag = (warmer - at_b) / self.warmer_sag_m
        return Quantity(at_b - at_a, abs(by_sag) * self.sag.sigma)


def warmed_wires(
    a: Survey, b: Survey, wires: Sequence[Wire], config: MechanicsConfig
) -> tuple[dict[int, Warmed], list[str]]:
    """A's wires at B's temperature, by their ids, and what a reader must know; none where a temperature or
    the conductor is missing."""
    of_a, of_b = temperature_of(a, config), temperature_of(b, config)
    if config.conductor is None or of_a is None or of_b is None:
        missing = "the conductor (--conductor)" if config.conductor is None else _without(of_a, of_b)
        return {}, [f"What temperature makes of sags and clearances is not known without {missing}."]
    step_c = max(of_b.sigma, 1.0)
    degrees = (of_a.value, of_b.value, of_b.value + step_c)
    loads = [Load(f"{number}", one) for number, one in enumerate(degrees)]
    states, findings = compute_states(
        a.lines, of_a.value, replace(config, temperature_sigma_c=of_a.sigma), loads
    )
    if states is None:
        return {}, [one.text for one in findings]
    found = {}
    for wire in wires:
        hung = [one for state in states.states if (one := state.of(wire.id)) is not None]
        if len(hung) == len(loads):
            found[wire.id] = _warmed(wire, hung, of_b.sigma / step_c)
    return found, [
        f"The conductors were at {of_a.value:g} ± {of_a.half_95:.1f} °C in A and at {of_b.value:g} ± "
        f"{of_b.half_95:.1f} °C in B (95 %)."
    ]


def _without(of_a: Quantity | None, of_b: Quantity | None) -> str:
    names = [name for name, one in (("A", of_a), ("B", of_b)) if one is None]
    return f"the conductors' temperature at {' and '.join(names)} (--temperature-c of its survey)"


def _warmed(wire: Wire, hung: Sequence[WireState], steps: float) -> Warmed:
    """hung: at A's temperature, at B's, and so much warmer that B's deviation is a number of such steps."""
    at_a, at_b, warmer = hung
    by_step = warmer.sag.value - at_b.sag.value
    sigma = float(np.hypot(at_b.sag_change.sigma, steps * by_step))
    sag = Quantity(at_b.sag.value - at_a.sag.value, sigma)
    return Warmed(sag, at_a.of(wire), at_b.of(wire), warmer.of(wire), by_step)


def temperature_of(survey: Survey, config: MechanicsConfig) -> Quantity | None:
    """Of a survey's conductors: as its states have it, else as it was given; None: it is not known."""
    if survey.states is not None:
        return survey.states.temperature_c
    if survey.temperature_c is None:
        return None
    return Quantity(survey.temperature_c, config.temperature_sigma_c)
