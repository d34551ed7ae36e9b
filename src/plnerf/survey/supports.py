"""The structures at the ends of wires that images show: where they stand along the line, and which points
are theirs.

LineFrame; x runs along the wires.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Bool, Float

from plnerf.line.line import Structure
from plnerf.line.wire import Wire
from plnerf.survey.attachments import held_at
from plnerf.survey.bodies import Body, body_at, find_bodies
from plnerf.survey.config_wires import SupportConfig
from plnerf.survey.surface import Surface


@dataclass(frozen=True, eq=False)
class Supports:
    """At either end of the wires; None where no structure is seen."""

    structures: tuple[Structure | None, Structure | None]
    x_m: tuple[float | None, float | None]
    """Where the first and the last hold the wires."""
    points: Bool[np.ndarray, " n"]
    """Those of the surface that are theirs."""

    @property
    def seen(self) -> tuple[Structure, ...]:
        """The structures that are seen."""
        return tuple(one for one in self.structures if one is not None)


def find_supports(
    surface: Surface, field: Surface | None, wires: Sequence[Wire], config: SupportConfig
) -> Supports:
    """The structures at both ends of wires that run along x side by side.

    Bodies are looked for in the field where there is one, which shows a lattice from all sides: stereo sees
    its near side alone.
    """
    of_stereo, of_field = surface.xyz, (surface if field is None else field).xyz
    mine = np.zeros(len(of_stereo), np.bool_)
    if not wires:
        return Supports((None, None), (None, None), mine)
    half = config.polyline_places // 2
    lines = [wire.points(np.linspace(0.0, wire.base.length_m, half)) for wire in wires]
    bodies = find_bodies(of_field, lines, config.body)
    first, last = min(float(line[0, 0]) for line in lines), max(float(line[-1, 0]) for line in lines)
    x = np.linspace(first - config.about_end_m, last + config.about_end_m, config.polyline_places)
    curves = [wire.points(x - wire.base.a[0]) for wire in wires]
    shown = [(of_stereo, config.by_stereo_m, "stereo")]
    shown += [(of_field, config.by_field_m, "the field")] if field is not None else []
    structures: list[Structure | None] = []
    for body, end in zip(bodies, (first, last), strict=True):
        found = _support(body, end, shown, of_field, curves, config)
        if found is None:
            structures.append(None)
            continue
        at, sigma, evidence = found
        mine |= at.holds(of_stereo, curves, config.body)
        number = 1 + sum(one is not None for one in structures)
        structures.append(
            Structure(
                number, np.array([at.x_m, at.y_m, at.foot_m]), at.top_m - at.foot_m, sigma, evidence
            )
        )
    at_x = [None if one is None else float(one.foot[0]) for one in structures]
    return Supports((structures[0], structures[1]), (at_x[0], at_x[1]), mine)


def trimmed(wire: Wire, supports: Supports) -> Wire:
    """The wire as far as it lies between the structures, without what was detected beyond them."""
    low, high = wire.base.a[0], wire.base.b[0]
    first, last = (
        bound if at is None else at
        for bound, at in zip((-np.inf, np.inf), supports.x_m, strict=True)
    )
    return wire.between(max(low, first) - low, min(high, last) - low)


def _support(
    body: Body | None,
    end: float,
    shown: Sequence[tuple[Float[np.ndarray, "_ 3"], float, str]],
    of_field: Float[np.ndarray, "m 3"],
    wires: Sequence[Float[np.ndarray, "_ 3"]],
    config: SupportConfig,
) -> tuple[Body, float, str] | None:
    """Where the wires are held about a body, or their end, by the best that shows it, and how exactly."""
    middle, reach = (end, config.about_end_m) if body is None else (body.x_m, config.around_m)
    for points, sigma, source in shown:
        at = held_at(points, wires, middle - reach, middle + reach, config.attachment)
        if at is not None:
            found = body or body_at(at, of_field, wires, config.body)
            # A structure is as high as its highest wire.
            highest = max(float(np.interp(at, wire[:, 0], wire[:, 2])) for wire in wires)
            what = f"what holds the wires, seen by {source}"
            return replace(found, x_m=at, top_m=max(highest, found.top_m)), sigma, what
    return None if body is None else (body, config.by_body_m, "its body alone")
