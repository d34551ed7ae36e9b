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
from plnerf.survey.obstacles import obstacles
from plnerf.survey.rule_measures import Measured, above_surface, beside_area, to_points, within

ON_MAPS: tuple[RuleObject, ...] = ("road", "rail", "water")
Least = dict[tuple[int, int], tuple[Wire, Measured]]
"""Of each line and span the wire that comes nearest."""


@dataclass(frozen=True, eq=False)
class RuleState:
    """The survey's wires in one state."""

    name: str
    kinds: tuple[StateKind, ...]
    lines: tuple[Line, ...]
    """With those wires alone of which the state is known."""


def rule_states(survey: Survey) -> list[RuleState]:
    """The survey itself, and its other states."""
    found = [RuleState(SURVEYED, (), survey.lines)]
    for state in survey.states.states if survey.states is not None else ():
        curves = {one.wire: one for one in state.wires}
        lines = tuple(
            replace(line, spans=tuple(
                replace(span, wires=tuple(
                    curves[wire.id].of(wire) for wire in span.wires if wire.id in curves
                ))
                for span in line.spans
            ))
            for line in survey.lines
        )  # fmt: skip
        found.append(RuleState(state.load.name, kinds_of(state.load), lines))
    return found


def kinds_of(load: Load) -> tuple[StateKind, ...]:
    """Of which kinds of states a load is."""
    if not load.wind_pa and not load.ice_mm:
        return ("still",)
    kinds: list[StateKind] = ["wind"] if load.wind_pa else []
    return (*kinds, "ice") if load.ice_mm else tuple(kinds)


class RuleScene:
    """What wires come near to, by class of objects."""

    def __init__(
        self, survey: Survey, maps: Sequence[MapObject], clearance: ClearanceConfig, config: RulesConfig,
        lower_m: Mapping[RuleObject, float],
    ) -> None:  # fmt: skip
        """lower_m: by so much lower an object is clear of a wire, whatever its distance in plan."""
        self._survey, self._clearance, self._config = survey, clearance, config
        self._lower_m = lower_m
        groups = obstacles(survey, clearance.obstacles)
        self._maps: dict[str, list[MapObject]] = {}
        for one in maps:
            self._maps.setdefault(one.kind, []).append(one)
        houses = self._maps.get("building", [])
        self._ground = groups["ground"]
        self._points: dict[RuleObject, Int[np.ndarray, " _"]] = {}
        named: tuple[tuple[RuleObject, Group], ...] = (
            ("building", "structures"), ("vegetation", "vegetation"), ("other", "other")
        )  # fmt: skip
        on_houses = [groups["structures"]]
        for name, group in named:
            index = groups[group]
            stands = within(survey.cloud.xyz, index, houses)
            if name != "building":
                on_houses.append(index[stands])
            self._points[name] = index if name == "building" else index[~stands]
        self._points["building"] = np.unique(np.concatenate(on_houses))

    def least(self, rule: Rule, state: RuleState) -> Least:
        """The least clearance of every span's phase conductors."""
        if rule.object == "line":
            return self._of_lines(rule, state)
        found: Least = {}
        for line in state.lines:
            for span in line.spans:
                for wire in span.wires:
                    if wire.kind == "phase":
                        one = self._measure(rule, wire)
                        _keep(found, (line.id, span.id), wire, one)
        return found

    def _measure(self, rule: Rule, wire: Wire) -> Measured | None:
        cloud, clearance, config = self._survey.cloud, self._clearance, self._config
        if rule.object in ON_MAPS or (rule.object == "building" and rule.direction == "horizontal"):
            objects = self._maps.get(rule.object, [])
            if rule.direction == "vertical":
                return above_surface(wire, cloud, self._ground, objects, clearance) if objects else None
            beside = beside_area(wire, objects, config.reach_m, clearance.station_m) if objects else None
            if rule.object in ON_MAPS:
                return beside
            points = self._to_points(rule, wire)
            both = [one for one in (beside, points) if one is not None]
            return min(both, key=lambda one: one.distance.value, default=None)
        if rule.object == "ground" and rule.direction == "vertical":
            return above_surface(wire, cloud, self._ground, None, clearance)
        return self._to_points(rule, wire)

    def _to_points(self, rule: Rule, wire: Wire) -> Measured | None:
        index = self._ground if rule.object == "ground" else self._points[rule.object]
        lower_m = self._lower_m.get(rule.object, rule.required_m)
        return to_points(
            wire, self._survey.cloud, index, rule.direction, lower_m, self._config, self._clearance.station_m
        )

    def _of_lines(self, rule: Rule, state: RuleState) -> Least:
        """Between the wires of lines that cross, if one of the two is a phase conductor."""
        lines = state.lines
        if state.name != SURVEYED:  # what has no state of its own hangs as surveyed
            lines = tuple(
                replace(line, spans=tuple(
                    replace(span, wires=(*span.wires, *(
                        wire for wire in old.wires if all(wire.id != one.id for one in span.wires)
                    )))
                    for span, old in zip(line.spans, before.spans, strict=True)
                ))
                for line, before in zip(lines, self._survey.lines, strict=True)
            )  # fmt: skip
        of = {
            wire.id: (line.id, span.id, wire) for line in lines for span in line.spans for wire in span.wires
        }
        found: Least = {}
        for one in find_crossings(replace(self._survey, lines=lines)):
            line, span, wire = of[one.upper]
            if "phase" not in {wire.kind, of[one.lower][2].kind}:
                continue
            value = {"radial": one.distance_m, "vertical": one.vertical_m}.get(rule.direction)
            if value is not None:
                measured = Measured(Quantity(value, one.sigma_m), one.on_upper, one.on_lower)
                _keep(found, (line, span), wire, measured)
        return found


def _keep(found: Least, key: tuple[int, int], wire: Wire, one: Measured | None) -> None:
    if one is not None and (key not in found or one.distance.value < found[key][1].distance.value):
        found[key] = (wire, one)
