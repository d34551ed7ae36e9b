"""Every tree, building, other thing and crossing wire that comes too near to a phase conductor.

    as surveyed, in other states     the distances that rules or the requirement are about
    fall-in                          a tree that tilts about its foot, against what is required in space
    grow-in                          a plant whose distance shrinks by its growth, against the same
    crossings                        every pair of wires of two lines, against the rules between lines

An object is listed where any of these is not clear of what is required, with every way in which it is not.
"""

from dataclasses import dataclass, replace

import numpy as np

from plnerf.line.clearances import Crossing, verdict_of
from plnerf.line.encroachments import WAYS, Approach, Encroachment, Encroachments, Way, priority_of
from plnerf.line.ends import Quantity
from plnerf.line.rules import Direction, RuleObject, StateKind
from plnerf.line.states import SURVEYED
from plnerf.line.stations import chains
from plnerf.line.survey import Survey
from plnerf.line.wire import Wire
from plnerf.survey.config_encroachments import EncroachmentConfig
from plnerf.survey.config_ground import ClearanceConfig
from plnerf.survey.config_rules import RulesConfig
from plnerf.survey.crossings import find_crossings, variance_towards
from plnerf.survey.encroaching_objects import Near, ThingsNear, falls, sigma_towards
from plnerf.survey.map_objects import MapObject
from plnerf.survey.obstacles import beyond_ends_m, obstacles, onto_wire, shared_structures
from plnerf.survey.rule_scene import RuleState, objects_by_class, rule_states
from plnerf.survey.unseen_air import upper_limits

OF_GROUP: dict[str, RuleObject] = {"vegetation": "vegetation", "structures": "building", "other": "other"}
UP = np.array([0.0, 0.0, 1.0])
LEAST_SLACK_M = 3.0
"""Distances that exceed what is required by more than this, and by growth, are clear without a deviation."""


@dataclass(frozen=True)
class Required:
    """A distance to be kept."""

    object: RuleObject
    direction: Direction
    states: tuple[StateKind, ...]
    """Empty: all."""
    distance_m: float
    name: str

    def holds_in(self, state: RuleState) -> bool:
        """As surveyed every one does."""
        return state.name == SURVEYED or not self.states or bool(set(self.states) & set(state.kinds))


def find_encroachments(
    survey: Survey, maps: list[MapObject], clearance: ClearanceConfig, rules: RulesConfig,
    config: EncroachmentConfig,
) -> Encroachments | None:  # fmt: skip
    """All of them, by priority.  None where nothing is required of any object."""
    required = _required(survey)
    if not required:
        return None
    found = _Search(survey, maps, required, clearance, rules, config)
    records = [*found.of_things(), *found.of_crossings()]
    order = sorted(records, key=lambda one: (one.priority, one.first.margin_m, one.station_m))
    numbered = tuple(replace(one, id=k) for k, one in enumerate(order, 1))
    names = tuple(dict.fromkeys(one.name for one in required))
    return Encroachments(numbered, names, tuple(found.not_examined()))


def _required(survey: Survey) -> list[Required]:
    """By the rules, and by the requirement on the clearances as surveyed."""
    found: list[Required] = []
    if survey.rules is not None:
        for rule in survey.rules.rules:
            if rule.object in {*OF_GROUP.values(), "line"}:
                name = f"rule {rule.name} ({survey.rules.name})"
                found.append(Required(rule.object, rule.direction, rule.states, rule.required_m, name))
    needed = survey.clearances.requirement if survey.clearances is not None else None
    if needed is not None:
        found += [
            Required(OF_GROUP[group], "radial", (), needed.distance_m, needed.name)
            for group in needed.applies_to
            if group in OF_GROUP
        ]
    return found


class _Search:
    """What a survey's wires come too near to."""

    def __init__(
        self, survey: Survey, maps: list[MapObject], required: list[Required], clearance: ClearanceConfig,
        rules: RulesConfig, config: EncroachmentConfig,
    ) -> None:  # fmt: skip
        self.survey, self.required, self.clearance, self.config = survey, required, clearance, config
        self.under_m, self.states = rules.under_m, rule_states(survey)
        self.shared = shared_structures(survey)
        groups = obstacles(survey, clearance.obstacles)
        houses = [one for one in maps if one.kind == "building"]
        by_class = objects_by_class(survey, groups, houses)
        wanted = {one.object for one in required}
        some: dict[RuleObject, np.ndarray] = {
            kind: index for kind, index in by_class.items() if kind in wanted and kind != "ground"
        }
        self.near = ThingsNear(survey.cloud, some, groups["ground"], config)
        self.kinds = np.array([one.kind for one in self.near.things])
        self.lower_m = np.zeros(len(self.kinds))
        for one in required:
            if one.direction == "vertical":
                of = self.kinds == one.object
                self.lower_m[of] = np.maximum(self.lower_m[of], one.distance_m)
        for one in required:  # without a vertical one, what is lower by the horizontal distance is clear
            of = (self.kinds == one.object) & (self.lower_m == 0)
            self.lower_m[of] = one.distance_m
        grown = (config.growth_m or 0.0) * config.growth_years
        self.slack_m = LEAST_SLACK_M + 2 * grown
        self.found: dict[int, dict[Way, Approach]] = {}
        self.surveyed: dict[int, tuple[Wire, float, int, float]] = {}
        self.growing: dict[int, Approach] = {}

    def of_things(self) -> list[Encroachment]:
        """Those of the cloud's points."""
        if not self.near.things:
            return []
        for state in self.states:
            for line in state.lines:
                for wire in line.wires:
                    if wire.kind == "phase" and wire.id in state.known:
                        self._pass_by(state, wire)
        for k, one in self.growing.items():
            before = [self.found.get(k, {}).get(way) for way in ("as surveyed", "sag", "blow-out")]
            if not any(each is not None and each.verdict == "closer than required" for each in before):
                self.found.setdefault(k, {})["grow-in"] = one
        return [self._record(k, tuple(self.found[k].values())) for k in sorted(self.found)]

    def _pass_by(self, state: RuleState, wire: Wire) -> None:
        reach_m = self.clearance.obstacles.reach_m
        beyond_m = beyond_ends_m(wire, self.survey.cloud, self.shared, reach_m)
        near: dict[Direction, Near] = {"radial": self.near.radial(wire, reach_m, beyond_m)}
        if state.name == SURVEYED:
            self._keep_surveyed(wire, near["radial"])
        for one in self.required:
            if one.object == "line" or not one.holds_in(state):
                continue
            if one.direction not in near:
                near[one.direction] = self.near.across(
                    wire, one.direction, reach_m, self.under_m, self.lower_m
                )
            found = near[one.direction]
            close = (self.kinds == one.object) & (found.distance_m < one.distance_m + self.slack_m)
            for k in np.flatnonzero(close).tolist():
                self._approach(state, wire, one, k, found)
        self._fall(state, wire)

    def _approach(self, state: RuleState, wire: Wire, one: Required, k: int, found: Near) -> None:
        value, s, point = float(found.distance_m[k]), float(found.s_m[k]), int(found.point[k])
        on_wire, on_object = wire.points(np.array([s]))[0], self.survey.cloud.xyz[point].copy()
        towards = {
            "radial": (on_wire - on_object) / max(value, 1e-9),
            "vertical": UP,
            "horizontal": np.array([*wire.base.n, 0.0]),
        }[one.direction]
        sigma = sigma_towards(
            wire, s, self.survey.cloud, self.near.things[k], point, towards, self.clearance.sampling
        )
        made = Approach(
            _way(state), state.name, wire.id, one.direction, Quantity(value, sigma), one.distance_m,
            one.name, verdict_of(value, sigma, one.distance_m), on_wire, on_object,
        )  # fmt: skip
        self._keep(k, made)
        if self.config.growth_m and one.object == "vegetation":
            self._grow(k, made, self.config.growth_m)

    def _grow(self, k: int, standing: Approach, rate_m: float) -> None:
        """The distance at the end of the years that are examined, and when it is the required one."""
        years, spread = self.config.growth_years, self.config.growth_sigma * rate_m
        now = standing.distance
        then = Quantity(now.value - rate_m * years, float(np.hypot(now.sigma, years * spread)))
        after = max(standing.margin_m, 0.0) / rate_m
        verdict = verdict_of(then.value, then.sigma, standing.required_m)
        made = replace(
            standing, way="grow-in", distance=then, verdict=verdict,
            years=Quantity(after, float(np.hypot(now.sigma, after * spread)) / rate_m),
        )  # fmt: skip
        kept = self.growing.get(k)
        if verdict != "clear" and (kept is None or made.margin_m < kept.margin_m):
            self.growing[k] = made

    def _fall(self, state: RuleState, wire: Wire) -> None:
        of = [one for one in self.required if one.object == "vegetation" and one.holds_in(state)]
        if not of:
            return
        radial = [one for one in of if one.direction == "radial"]
        one = max(radial, key=lambda one: one.distance_m) if radial else replace(
            of[0], direction="radial", distance_m=0.0, name="to touch"
        )  # fmt: skip
        found = falls(
            wire, self.survey.cloud, self.near.things, one.distance_m + self.slack_m,
            self.config.stem_sigma_m, self.clearance.sampling,
        )  # fmt: skip
        for k, distance, place in found:
            tree = self.near.things[k].tree
            assert tree is not None
            verdict = verdict_of(distance.value, distance.sigma, one.distance_m)
            self._keep(k, Approach(
                "fall-in", state.name, wire.id, "radial", distance, one.distance_m, one.name, verdict, place,
                tree.foot,
            ))  # fmt: skip

    def _keep(self, k: int, one: Approach) -> None:
        """The least margin of every way."""
        if one.verdict == "clear":
            return
        kept = self.found.setdefault(k, {})
        if one.way not in kept or one.margin_m < kept[one.way].margin_m:
            kept[one.way] = one

    def _keep_surveyed(self, wire: Wire, near: Near) -> None:
        for k in np.flatnonzero(np.isfinite(near.distance_m)).tolist():
            distance = float(near.distance_m[k])
            if k not in self.surveyed or distance < self.surveyed[k][3]:
                self.surveyed[k] = (wire, float(near.s_m[k]), int(near.point[k]), distance)

    def _record(self, k: int, approaches: tuple[Approach, ...]) -> Encroachment:
        thing, cloud = self.near.things[k], self.survey.cloud
        wire, s, point = self._nearest(k)
        on_wire, on_object = wire.points(np.array([s]))[0], cloud.xyz[point].copy()
        gap = on_wire - on_object

        def along(towards: np.ndarray) -> Quantity:
            sigma = sigma_towards(wire, s, cloud, thing, point, towards, self.clearance.sampling)
            return Quantity(float(gap @ towards), sigma)

        flat = gap * [1, 1, 0]
        line, span, station = self._place(wire.id, on_wire)
        approaches = _sorted(approaches)
        return Encroachment(
            0, priority_of(approaches), thing.kind, line, span, wire.id, None, station, thing.outline,
            cloud.xyz[thing.highest].copy(), thing.height_m, along(_unit(gap)), along(UP), along(_unit(flat)),
            on_wire, on_object, approaches,
        )  # fmt: skip

    def _nearest(self, k: int) -> tuple[Wire, float, int]:
        """The phase conductor that an object is nearest to as surveyed, where, and its point."""
        if k in self.surveyed:
            return self.surveyed[k][:3]
        best: tuple[float, Wire, float, int] | None = None
        for wire in self.survey.wires:  # a tall tree that stands outside of the reach
            if wire.kind == "phase":
                index = self.near.things[k].points
                distance, s = onto_wire(wire, self.survey.cloud.xyz[index])
                i = int(distance.argmin())
                if best is None or distance[i] < best[0]:
                    best = (float(distance[i]), wire, float(s[i]), int(index[i]))
        assert best is not None
        return best[1:]

    def of_crossings(self) -> list[Encroachment]:
        """Of every pair of wires of two lines, one of them a phase conductor."""
        required = [one for one in self.required if one.object == "line" and one.direction != "horizontal"]
        found: dict[tuple[int, int], dict[Way, Approach]] = {}
        surveyed: dict[tuple[int, int], Crossing] = {}
        for state in self.states if required else []:
            kind = {wire.id: wire.kind for line in state.lines for wire in line.wires}
            for one in find_crossings(replace(self.survey, lines=state.lines)):
                pair = (min(one.upper, one.lower), max(one.upper, one.lower))
                if state.name == SURVEYED:
                    surveyed[pair] = one
                if "phase" not in {kind[one.upper], kind[one.lower]} or not state.known & set(pair):
                    continue
                for of in required:
                    if of.holds_in(state):
                        made = _between(state, one, of)
                        kept = found.setdefault(pair, {})
                        if made.verdict != "clear" and (
                            made.way not in kept or made.margin_m < kept[made.way].margin_m
                        ):
                            kept[made.way] = made
        return [
            self._pair(surveyed[pair], _sorted(tuple(ways.values())))
            for pair, ways in found.items()
            if ways and pair in surveyed
        ]

    def _pair(self, one: Crossing, approaches: tuple[Approach, ...]) -> Encroachment:
        wires = {wire.id: wire for wire in self.survey.wires}
        upper, lower = wires[one.upper], wires[one.lower]
        wire, other = (upper, lower) if upper.kind == "phase" else (lower, upper)
        at = {one.upper: one.on_upper, one.lower: one.on_lower}
        gap = at[wire.id] - at[other.id]

        def along(towards: np.ndarray) -> Quantity:
            variance = variance_towards(upper, one.s_upper_m, towards)
            variance += variance_towards(lower, one.s_lower_m, towards)
            return Quantity(float(gap @ towards), float(np.sqrt(variance)))

        line, span, station = self._place(wire.id, at[wire.id])
        return Encroachment(
            0, priority_of(approaches), "line", line, span, wire.id, other.id, station, np.zeros((0, 2)),
            at[other.id], None, along(_unit(gap)), along(UP), along(_unit(gap * [1, 1, 0])), at[wire.id],
            at[other.id], approaches,
        )  # fmt: skip

    def _place(self, wire: int, on_wire: np.ndarray) -> tuple[int, int, float]:
        """Line, span and station of a place on a wire."""
        for line in self.survey.lines:
            for chain in chains(line):
                for stretch in chain:
                    if any(one.id == wire for one in stretch.span.wires):
                        return line.id, stretch.span.id, float(stretch.station(on_wire[None])[0])
        raise ValueError(f"no span has wire {wire}")

    def not_examined(self) -> list[str]:
        """Ways that were left out, and why."""
        left, objects = [], {one.object for one in self.required}
        kinds = {kind for state in self.states for kind in state.kinds}
        if "wind" not in kinds:
            left.append("Blow-out is not examined: no state with wind was computed (--conductor, --states).")
        if "still" not in kinds:
            left.append("Greater sag is not examined: no other state was computed (--conductor).")
        if "vegetation" in objects and not self.config.growth_m:
            left.append("Growth is not examined: no rate is given (--encroachments.growth-m).")
        bare = sum(one.kind == "vegetation" and one.tree is None for one in self.near.things)
        if bare:
            left.append(f"The fall of {bare} plants is not examined: no ground is known below them.")
        if self.near.scattered:
            left.append(
                f"{self.near.scattered} groups of points of plants are taken for wrong matches, since they "
                "are scattered."
            )
        if self.near.wires:
            left.append(
                f"{self.near.wires} groups of points of plants are taken for wires that were not found: they "
                "are level and narrow, with nothing below."
            )
        unseen = sum(hidden_m == 0 for hidden_m in upper_limits(self.survey).values())
        if "vegetation" in objects and unseen:
            left.append(
                f"Plants that images do not show are not examined: in {unseen} of the spans one may "
                "stand nearer than the nearest that is found."
            )
        unruled = [
            name for kind, name in (("vegetation", "plants"), ("building", "buildings"), ("other", "other "
             "things"), ("line", "wires of crossing lines")) if kind not in objects
        ]  # fmt: skip
        if unruled:
            left.append(f"Nothing is required of {', '.join(unruled)}: none of these is listed.")
        return left


def _between(state: RuleState, one: Crossing, of: Required) -> Approach:
    value = one.vertical_m if of.direction == "vertical" else one.distance_m
    return Approach(
        _way(state), state.name, one.upper, of.direction, Quantity(value, one.sigma_m), of.distance_m,
        of.name, verdict_of(value, one.sigma_m, of.distance_m), one.on_upper, one.on_lower,
    )  # fmt: skip


def _way(state: RuleState) -> Way:
    if state.name == SURVEYED:
        return "as surveyed"
    return "blow-out" if "wind" in state.kinds else "sag"


def _sorted(approaches: tuple[Approach, ...]) -> tuple[Approach, ...]:
    """The most urgent first: certain before doubtful, then by way."""
    return tuple(
        sorted(approaches, key=lambda one: (one.verdict != "closer than required", WAYS.index(one.way)))
    )


def _unit(gap: np.ndarray) -> np.ndarray:
    length = float(np.linalg.norm(gap))
    return gap / length if length > 1e-9 else UP
