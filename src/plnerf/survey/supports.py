"""The structures of lines that images show: where they hold the wires, and which points are theirs.

Two kinds of evidence, which must agree where there are both: the kinks in which the curves of adjacent spans
meet (`kinks.py`), and what is seen of insulators, arms and bodies: by stereo and the field (`attachments.py`,
`bodies.py`), or else by single photos that agree on one plane across the line (`end_sweep.py`).

Letters: t along a junction's axis, y to its left, z up: the coordinates of everything about a junction.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float, Int

from plnerf.line.base import Base
from plnerf.line.ends import TWO_SIDED_95
from plnerf.line.line import Structure
from plnerf.line.wire import Wire
from plnerf.survey.attachments import held_at
from plnerf.survey.bodies import Body, body_at, find_bodies, pole_axis
from plnerf.survey.chains import Chain, junctions
from plnerf.survey.config_spans import ChainConfig
from plnerf.survey.config_wires import SupportConfig
from plnerf.survey.end_sweep import held_across
from plnerf.survey.held_places import Stands, held_places
from plnerf.survey.kinks import Held, find_kinks, held_by
from plnerf.survey.posed_photos import Photos
from plnerf.survey.span_wires import Junction, SpanWires, crossing
from plnerf.survey.support import Support, Supports, each_structure_once
from plnerf.survey.surface import Surface
from plnerf.survey.tees import with_tees

Lines = Sequence[Float[np.ndarray, "_ 3"]]
Place = Float[np.ndarray, "3"]


@dataclass(frozen=True, eq=False)
class _Around:
    """What is around a junction, in its own coordinates."""

    junction: Junction
    lines: Lines
    """Its conductors, before and after it."""
    stereo: Float[np.ndarray, "n 3"]
    field: Float[np.ndarray, "m 3"] | None
    of_stereo: Int[np.ndarray, " n"]
    """Indices of the stereo points."""
    photos: Photos | None

    @property
    def best(self) -> Float[np.ndarray, "_ 3"]:
        """The points that show a structure from all sides, if any do."""
        return self.stereo if self.field is None else self.field


@dataclass(frozen=True)
class _Shown:
    """Where what holds the wires is seen."""

    t: float
    sigma: float
    words: str
    holds: bool
    """Whether what holds the wires is seen, rather than a body below them."""
    above: tuple[bool, ...] = ()
    """Of each of the lines, whether it is seen above it; empty: of none."""
    afar: bool = False
    """Whether photos show it, but too small for more."""


@dataclass(frozen=True, eq=False)
class Scenery:
    """What stands about lines, LineFrame."""

    surface: Surface
    """By stereo."""
    field: Surface | None
    """By a trained field, if there is one."""
    bodies: tuple[tuple[tuple[Place | None, Place | None], ...], ...]
    """Of each chain and span, where the bodies at its ends stand; None where none is seen."""
    photos: Photos | None = None
    """At their full size; None: none, or lengths are no metres."""


def scenery_of(
    surface: Surface,
    field: Surface | None,
    chains: Sequence[Chain],
    config: SupportConfig,
    photos: Photos | None = None,
) -> Scenery:
    """With the bodies at the ends of wires as they were detected, which end well before or beyond them.

    Bodies are looked for in the field where there is one, which shows a lattice from all sides; stereo sees
    its near side alone, but must see something of it.
    """
    bodies = (tuple(_bodies(surface, field, span, config) for span in chain) for chain in chains)
    full = photos.full_size() if photos is not None and photos.frame.unit == "m" else None
    return Scenery(surface, field, tuple(bodies), full)


def find_supports(
    scenery: Scenery, chains: Sequence[Chain], config: SupportConfig, chaining: ChainConfig
) -> Supports:
    """The structures between the spans of chains and at their ends, numbered from 1 along them."""
    mine = np.zeros(len(scenery.surface.xyz), np.bool_)
    found = []
    for chain, bodies in zip(chains, scenery.bodies, strict=True):
        placed = []
        for k, junction in enumerate(junctions(chain, chaining)):
            near = [bodies[k - 1][1]] if k > 0 else []
            near += [bodies[k][0]] if k < len(chain) else []
            around = _around(scenery, junction, config)
            placed.append(_support(junction, around, [one for one in near if one is not None], config))
            mine[_points_of(placed[-1], around, config)] = True
        found.append(each_structure_once(placed, config.least_span))
    return Supports(_numbered(with_tees(found, config)), mine)


def _bodies(
    surface: Surface, field: Surface | None, span: SpanWires, config: SupportConfig
) -> tuple[Place | None, Place | None]:
    """Where the bodies at both ends of a span stand, LineFrame."""
    lines = span.polylines(config.polyline_places // 2)
    both = [_near(one.xyz, span.base, lines, config)[1] for one in (surface, field) if one is not None]
    found = find_bodies(both[-1], lines, config.body, None if field is None else both[0])
    first, last = (
        None if one is None else span.base.place(np.array([one.x_m]), np.array([[one.y_m, one.foot_m]]))[0]
        for one in found
    )
    return first, last


def _support(junction: Junction, around: _Around, bodies: Sequence[Place], config: SupportConfig) -> Support:
    """By its kinks and by what is seen to hold the wires, if they agree; else by what has more evidence.

    bodies: where bodies stand near, LineFrame.
    """
    axis, kinks = junction.axis, find_kinks(junction, config.kink)
    held = held_by(kinks, axis, None, config.kink)
    middle = 0.0 if held is None else held.t
    t = axis.local(np.array(bodies).reshape(-1, 3))[:, 0]
    if held is not None:  # a body elsewhere is none
        t = t[np.abs(t - middle) <= config.around_m]
    body = float(t[np.abs(t - middle).argmin()]) if len(t) else None
    shown = _shown(around, middle, body, held, config)
    words = []
    if held is not None and shown is not None:
        alike = abs(held.t - shown.t) <= config.agree_sigmas * np.hypot(held.sigma, shown.sigma)
        if alike:
            held = held_by(kinks, axis, (shown.t, shown.sigma), config.kink)
            words = [shown.words]
        elif held.agreeing < config.least_wires and shown.holds:
            held = None  # a single kink against what is seen to hold the wires
        else:
            words = [f"against {shown.words}, {abs(held.t - shown.t):.1f} m from there"]
            shown = replace(shown, above=())  # that holds no wire here
    if held is not None:
        words = [f"the kinks of {held.agreeing} wires" if held.agreeing > 1 else "the kink of a wire", *words]
        t0, sigma = held.t, held.sigma
    elif shown is not None and shown.holds:  # a body alone may be a tree, and says where no wire is held
        t0, sigma, words = shown.t, shown.sigma, [shown.words]
    else:
        return Support(junction, None, (np.zeros((0, 2)), np.zeros((0, 2))), kinks)
    lines = around.lines
    stands = body_at(t0 if body is None else body, around.best, lines, config.body)
    # A structure is as high as its highest wire.
    top = max(stands.top_m, *(float(np.interp(t0, line[:, 0], line[:, 2])) for line in lines))
    lowest = min(float(np.interp(t0, line[:, 0], line[:, 2])) for line in lines)
    pole = pole_axis(replace(stands, x_m=t0), sigma, around.best, lowest, config.pole)
    at = (t0, sigma) if pole is None else (pole, config.pole.sigma_m)
    foot = axis.place(np.array(at[:1]), np.array([[stands.y_m, stands.foot_m]]))[0]
    structure = Structure(0, foot, top - stands.foot_m, at[1], ", and ".join(words))
    above = () if shown is None else shown.above
    places = held_places(junction, Stands(t0, sigma, stands.y_m, above), held, around.photos, config)
    afar = held is None and shown is not None and shown.afar
    return Support(junction, structure, places, kinks, any(above), afar)


def _shown(
    around: _Around, middle: float, body: float | None, held: Held | None, config: SupportConfig
) -> _Shown | None:
    """Where the wires are held about a body, their kinks or their end, by the best that shows it.

    What is above one wire of many may be a plant: only a body makes it an attachment.
    """
    reach = config.around_m if held is not None or body is not None else config.about_end_m
    middle = middle if held is not None or body is None else body
    sources = [(around.stereo, config.by_stereo_m, "stereo")]
    sources += [] if around.field is None else [(around.field, config.by_field_m, "the field")]
    agree = 1 if body is not None else config.least_wires
    least = min(agree, len(around.lines))
    for points, sigma, source in sources:
        one = held_at(points, around.lines, middle - reach, middle + reach, config.attachment)
        if one is not None and one.wires >= least:
            return _Shown(one.x_m, sigma, f"what holds the wires, seen by {source}", True, one.held)
    if around.photos is not None and (held is None or held.agreeing < config.least_wires):
        place = held_across(around.junction, around.photos, middle - reach, middle + reach, config.sweep)
        if place is not None and place[1] >= agree:  # photos of one wire agree on something somewhere
            t, _ = place
            by_string = _string_m(around, t, config) / TWO_SIDED_95
            sigma = float(np.linalg.norm([config.by_sweep_m, by_string, _turned_m(around, t, config)]))
            return _Shown(t, sigma, "what holds the wires, seen in single photos", True, afar=True)
    return None if body is None else _Shown(body, config.by_body_m, "its body alone", False)


def _string_m(around: _Around, t: float, config: SupportConfig) -> float:
    """How long tension strings may be: their ends, seen across the line, look like what holds the wires."""
    at = np.array([[np.interp(t, line[:, 0], line[:, k]) for k in (1, 2)] for line in around.lines])
    apart = np.linalg.norm(at[:, None] - at, axis=2)
    least = float(apart[apart >= config.sweep.apart_m].min(initial=np.inf))
    return min(config.sweep.string_share * least, config.sweep.longest_string_m)


def _turned_m(around: _Around, t: float, config: SupportConfig) -> float:
    """By how much the outermost wires may be held before or behind the middle, standard deviation: where no
    next span says which way a structure's arms are turned."""
    if all(around.junction.sides):
        return 0.0
    y = [float(np.interp(t, line[:, 0], line[:, 1])) for line in around.lines]
    return (max(y) - min(y)) / 2 * float(np.tan(np.radians(config.sweep.half_turn_deg)))


def _around(scenery: Scenery, junction: Junction, config: SupportConfig) -> _Around:
    t = np.linspace(-config.surroundings_m, config.surroundings_m, config.polyline_places)
    curves = [[_curve(wire, junction.axis, t) for wire in wires] for wires in junction.sides]
    lines = []
    for i, j in junction.conductors:
        sides = [side[k] for side, k in zip(curves, (i, j), strict=True) if k is not None]
        lines.append(np.where((t < junction.meet_m)[:, None], sides[0], sides[-1]))
    of_stereo, stereo = _near(scenery.surface.xyz, junction.axis, lines, config)
    field = scenery.field
    shown = None if field is None else _near(field.xyz, junction.axis, lines, config)[1]
    return _Around(junction, lines, stereo, shown, of_stereo, scenery.photos)


def _curve(wire: Wire, axis: Base, t: Float[np.ndarray, " m"]) -> Float[np.ndarray, "m 3"]:
    return axis.local(wire.points(crossing(wire, axis, t)))


def _near(
    points: Float[np.ndarray, "n 3"], base: Base, lines: Lines, config: SupportConfig
) -> tuple[Int[np.ndarray, " k"], Float[np.ndarray, "k 3"]]:
    """Points around wires that are given in a base's coordinates: their indices, and they in these."""
    local, every = base.local(points), np.concatenate(lines)[:, :2]
    low, high = every.min(0) - config.surroundings_m, every.max(0) + config.surroundings_m
    index = np.flatnonzero(((local[:, :2] >= low) & (local[:, :2] <= high)).all(1))
    return index, local[index]


def _points_of(support: Support, around: _Around, config: SupportConfig) -> Int[np.ndarray, " _"]:
    """Indices of the surface's points that belong to a structure."""
    if support.structure is None:
        return around.of_stereo[:0]
    ((t, y, foot),) = support.junction.axis.local(support.structure.foot[None])
    body = Body(float(t), float(y), float(foot), float(foot) + support.structure.height_m)
    return around.of_stereo[body.holds(around.stereo, around.lines, config.body)]


def _numbered(chains: Sequence[Sequence[Support]]) -> tuple[tuple[Support, ...], ...]:
    """With ids from 1 along the chains."""
    every = [one.structure for chain in chains for one in chain if one.mine and one.structure is not None]
    numbered = {id(one): replace(one, id=k + 1) for k, one in enumerate(every)}
    return tuple(
        tuple(
            one if one.structure is None else replace(one, structure=numbered[id(one.structure)])
            for one in chain
        )
        for chain in chains
    )
