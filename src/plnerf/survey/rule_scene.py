"""What the wires of a line come near to in one state, by the classes of objects that rules know."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Int

from plnerf.line.clearances import Group
from plnerf.line.ends import Quantity
from plnerf.line.line import Line
from plnerf.line.rules import Rule, RuleObject, StateKind
from plnerf.line.states import SURVEYED, Load
from plnerf.line.survey import Survey
from plnerf.line.wire import Wire
from plnerf.survey.config_ground import ClearanceConfig
from plnerf.survey.config_rules import RulesConfig
from plnerf.survey.crossings import find_crossings
from plnerf.survey.map_objects import MapObject
from plnerf.survey.obstacles import beyond_ends_m, obstacles, shared_structures
from plnerf.survey.rule_measures import (
    Measured,
    ObjectPoints,
    above_surface,
    beside_area,
    inside_any,
    to_points,
)

ON_MAPS: tuple[RuleObject, ...] = ("road", "rail", "water")
Least = dict[tuple[int, int], tuple[Wire, Measured]]
"""Of each line and span the wire that comes nearest."""


@dataclass(frozen=True, eq=False)
class RuleState:
    """The survey's wires in one state."""

    name: str
    kinds: tuple[StateKind, ...]
    lines: tuple[Line, ...]
    """With wires of which the state is not known as they were surveyed."""
    known: frozenset[int]
    """Ids of the wires of which it is."""


def rule_states(survey: Survey) -> list[RuleState]:
    """The survey itself, and its other states that are known of any wire."""
    found = [RuleState(SURVEYED, (), survey.lines, frozenset(wire.id for wire in survey.wires))]
    for state in survey.states.states if survey.states is not None else ():
        curves = {one.wire: one for one in state.wires}
        if not curves:
            continue
        lines = tuple(
            replace(line, spans=tuple(
                replace(span, wires=tuple(
                    curves[wire.id].of(wire) if wire.id in curves else wire for wire in span.wires
                ))
                for span in line.spans
            ))
            for line in survey.lines
        )  # fmt: skip
        found.append(RuleState(state.load.name, kinds_of(state.load), lines, frozenset(curves)))
    return found


def kinds_of(load: Load) -> tuple[StateKind, ...]:
    """Of which kinds of states a load is."""
    if not load.wind_pa and not load.ice_mm:
        return ("still",)
    kinds: list[StateKind] = ["wind"] if load.wind_pa else []
    return (*kinds, "ice") if load.ice_mm else tuple(kinds)


def objects_by_class(
    survey: Survey, groups: Mapping[Group, Int[np.ndarray, " _"]], houses: Sequence[MapObject]
) -> dict[RuleObject, Int[np.ndarray, " _"]]:
    """Indices of the points of each class of objects; what stands on a building of the maps is one."""
    plants, other = groups["vegetation"], groups["other"]
    plant_on_house, other_on_house = (
        inside_any(survey.cloud.xyz[some, :2], houses) for some in (plants, other)
    )
    return {
        "ground": groups["ground"],
        "building": np.concatenate([groups["structures"], plants[plant_on_house], other[other_on_house]]),
        "vegetation": plants[~plant_on_house],
        "other": other[~other_on_house],
    }


class RuleScene:
    """What wires come near to, by class of objects."""

    def __init__(
        self, survey: Survey, maps: Sequence[MapObject], clearance: ClearanceConfig, config: RulesConfig,
        lower_m: Mapping[RuleObject, float],
    ) -> None:  # fmt: skip
        """lower_m: by so much lower an object is clear of a wire, whatever its distance in plan."""
        self._survey, self._clearance, self._under_m = survey, clearance, config.under_m
        self._lower_m, self._shared = lower_m, shared_structures(survey)
        self._maps: dict[str, list[MapObject]] = {}
        for one in maps:
            self._maps.setdefault(one.kind, []).append(one)
        groups = obstacles(survey, clearance.obstacles)
        index = objects_by_class(survey, groups, self._maps.get("building", []))
        self._points = {
            name: ObjectPoints(survey.cloud, some, name) for name, some in index.items()
        }

    def least(self, rule: Rule, state: RuleState) -> Least:
        """The least clearance of every span's phase conductors."""
        if rule.object == "line":
            return self._of_lines(rule, state)
        found: Least = {}
        for line in state.lines:
            for span in line.spans:
                for wire in span.wires:
                    if wire.kind == "phase" and wire.id in state.known:
                        _keep(found, (line.id, span.id), wire, self._measure(rule, wire))
        return found

    def _measure(self, rule: Rule, wire: Wire) -> Measured | None:
        objects = self._maps.get(rule.object, [])
        if rule.object in {"ground", *ON_MAPS} and rule.direction == "vertical":
            over = None if rule.object == "ground" else objects
            return above_surface(wire, self._points["ground"], over, self._clearance)
        found = []
        if rule.direction == "horizontal" and objects:
            found.append(beside_area(wire, objects, self._clearance))
        if rule.object not in ON_MAPS:
            found.append(self._to_points(rule, wire))
        some = [one for one in found if one is not None]
        return min(some, key=lambda one: one.distance.value, default=None)

    def _to_points(self, rule: Rule, wire: Wire) -> Measured | None:
        cloud, reach_m = self._survey.cloud, self._clearance.obstacles.reach_m
        return to_points(
            wire, self._points[rule.object], rule.direction, self._clearance, under_m=self._under_m,
            lower_m=self._lower_m.get(rule.object, rule.required_m),
            beyond_m=beyond_ends_m(wire, cloud, self._shared, reach_m),
        )  # fmt: skip

    def _of_lines(self, rule: Rule, state: RuleState) -> Least:
        """Between the wires of lines that cross, if one of the two is a phase conductor; in a state, if that
        of one of the two is known."""
        of = {
            wire.id: (line.id, span.id, wire)
            for line in state.lines
            for span in line.spans
            for wire in span.wires
        }
        found: Least = {}
        for one in find_crossings(replace(self._survey, lines=state.lines)):
            line, span, wire = of[one.upper]
            if "phase" in {wire.kind, of[one.lower][2].kind} and state.known & {one.upper, one.lower}:
                value = one.vertical_m if rule.direction == "vertical" else one.distance_m
                measured = Measured(Quantity(value, one.sigma_m), one.on_upper, one.on_lower)
                _keep(found, (line, span), wire, measured)
        return found


def _keep(found: Least, key: tuple[int, int], wire: Wire, one: Measured | None) -> None:
    if one is not None and (key not in found or one.distance.value < found[key][1].distance.value):
        found[key] = (wire, one)
