"""Clearances: as brute force finds them, exact on surfaces of a formula, and as uncertain as they say."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from tests.support.catenary_surveys import cloud, corridor, fitted, line_of

from plnerf.errors import ConfigError, SurveyError
from plnerf.findings import Finding
from plnerf.line.base import Base
from plnerf.line.clearances import GROUPS, Clearances, WireClearance
from plnerf.line.cloud import Cloud
from plnerf.line.ends import Open
from plnerf.line.frame import LineFrame
from plnerf.line.hang import hang
from plnerf.line.line import Structure
from plnerf.line.survey import Survey
from plnerf.line.wire import Wire
from plnerf.survey import obstacles as room
from plnerf.survey.clearance import _lowest, measure_clearances
from plnerf.survey.config_ground import ClearanceConfig, GroundSectionConfig, SamplingConfig
from plnerf.survey.config_obstacles import ObstacleConfig
from plnerf.survey.ground_section import ground_under
from plnerf.survey.obstacles import CLASSES, obstacles, onto_wire, rules, stations

CONFIG = ClearanceConfig()
WIRE = hang((0.0, 0.0, 20.0), (100.0, 0.0, 20.0), 4.0)
"""Level."""


def swung(wire: Wire, phi: float, y_A: float = 0.0, y_B: float = 0.0) -> Wire:
    """The wire blown aside, on a base that its ends lie beside."""
    theta = wire.theta.copy()
    theta[[0, 1, 5]] = y_A, y_B, phi
    return replace(wire, theta=theta)


SHAPES = {
    "level": WIRE,
    "steep": hang((0.0, 0.0, 10.0), (40.0, 30.0, 60.0), 4.0),
    "deep": hang((0.0, 0.0, 30.0), (30.0, 0.0, 28.0), 12.0),
    "far away": hang((500_000.0, 5_700_000.0, 110.0), (500_180.0, 5_700_090.0, 104.0), 5.0),
    "swung": swung(hang((0.0, 0.0, 30.0), (60.0, 45.0, 36.0), 6.0), 0.6, -2.0, 3.0),
    "aside": swung(hang((0.0, 0.0, 30.0), (60.0, 45.0, 26.0), 3.0), 0.0, 4.0, -5.0),
}


def survey_of(
    groups: dict[int, np.ndarray],
    wire: Wire | None = None,
    structures: tuple[Structure, ...] = (),
    **more: Any,
) -> Survey:
    """One wire, the level one where none is given, over points by class."""
    one = fitted(WIRE) if wire is None else wire
    frame = LineFrame(np.eye(3), 1.0, np.zeros(3), "m")
    return Survey(frame, (line_of([one], structures),), cloud(groups), "test", **more)


EXACT = SamplingConfig(point_m=1e-9, share=1e-9, bar_share=1e-9, leaves_m=1e-9)
"""Obstacles end at their points."""


def measured(survey: Survey, **settings: Any) -> Clearances:
    return measure_clearances(survey, ClearanceConfig(**settings))[0]


def first(survey: Survey, **settings: Any) -> WireClearance:
    return measured(survey, **settings).wires[0]


def said(survey: Survey) -> list[Finding]:
    return list(measure_clearances(survey, CONFIG)[1])


def brute(wire: Wire, points: np.ndarray, count: int = 20_000) -> np.ndarray:
    """Distance of each point from the wire, against samples 1 cm apart or closer."""
    line = wire.points(np.linspace(0, wire.base.length_m, count))
    return np.array([np.linalg.norm(line - point, axis=1).min() for point in points])


@pytest.mark.parametrize("name", SHAPES)
def test_points_are_as_far_from_a_wire_as_brute_force_says(name: str) -> None:
    wire = SHAPES[name]
    random = np.random.default_rng(3)
    points = wire.points(random.uniform(-10, wire.base.length_m + 10, 200)) + random.normal(size=(200, 3)) * 6
    distance, s = onto_wire(wire, points)
    assert np.abs(distance - brute(wire, points)).max() < 1e-3
    assert np.abs(np.linalg.norm(points - wire.points(s), axis=1) - distance).max() < 1e-3


@pytest.mark.parametrize("chunk", [61, 500_000])
def test_the_least_distances_are_those_of_brute_force(monkeypatch: pytest.MonkeyPatch, chunk: int) -> None:
    monkeypatch.setattr(room, "CHUNK", chunk)
    survey = corridor(count=500)
    survey = replace(survey, cloud=replace(survey.cloud, sigma_m=None))
    swings = replace(survey.lines[0].spans[0], wires=tuple(swung(one, 0.5, 1.0) for one in survey.wires))
    survey = replace(survey, lines=(replace(survey.lines[0], spans=(*survey.spans, replace(swings, id=2))),))
    found, counted = measured(survey), obstacles(survey, CONFIG.obstacles)
    assert [one.span for one in found.wires] == [1, 1, 1, 2, 2, 2]
    for one, known in zip(found.wires, survey.wires, strict=True):
        for group in GROUPS:
            distance = brute(known, survey.cloud.xyz[counted[group]], 8000)
            place = one.least(group)
            assert place is not None
            assert place.distance_m == pytest.approx(distance.min(), abs=1e-3)
            assert np.array_equal(place.on_obstacle, survey.cloud.xyz[counted[group][distance.argmin()]])
            assert np.linalg.norm(place.on_wire - place.on_obstacle) == pytest.approx(
                place.distance_m, abs=1e-3
            )
            assert place.class_code in CLASSES[group]


def test_the_profile_holds_the_least_distance_of_the_points_beside_each_station() -> None:
    survey = corridor(count=1500)
    profile, wire = first(survey).profile, survey.wires[0]
    trees = survey.cloud.xyz[obstacles(survey, CONFIG.obstacles)["vegetation"]]
    s = np.clip(wire.base.local(trees)[:, 0], 0, wire.base.length_m)
    station = np.rint(s / wire.base.length_m * (len(profile.s_m) - 1)).astype(int)
    distance = brute(wire, trees, 8000)
    for k, value in enumerate(profile.distance_m["vegetation"]):
        if np.isnan(value):
            assert not (station == k).any()
        else:
            assert value == pytest.approx(distance[station == k].min(), abs=1e-3)


def test_heights_above_a_sloping_plane_are_exact() -> None:
    """Ground z = 2 + 0.1 x + 0.2 y: the least height is where the wire's slope is the plane's."""
    random = np.random.default_rng(4)
    ground = np.stack([random.uniform(-15, 115, 9000), random.uniform(-15, 15, 9000), np.zeros(9000)], 1)
    ground[:, 2] = 2 + 0.1 * ground[:, 0] + 0.2 * ground[:, 1]
    one, wire = first(survey_of({2: ground})), fitted(WIRE)
    s = np.linspace(0, wire.base.length_m, 10_000)
    line = wire.points(s)
    height = line[:, 2] - 2 - 0.1 * line[:, 0]
    assert one.vertical is not None
    assert one.vertical.distance_m == pytest.approx(height.min(), abs=1e-3)
    assert one.vertical.s_m == pytest.approx(s[height.argmin()], abs=0.5)
    assert np.nanmax(np.abs(one.profile.ground_z - 2 - 0.1 * one.profile.points[:, 0])) < 1e-6
    assert not np.isnan(one.profile.ground_z).any()
    across = one.least("ground")
    assert across is not None
    assert across.distance_m == pytest.approx(height.min() / np.sqrt(1 + 0.1**2 + 0.2**2), abs=0.02)
    assert across.measure == "distance" and one.vertical.measure == "vertical"


def test_where_no_ground_is_near_none_is_made_up() -> None:
    at = stations(WIRE, 0.5)
    strip = np.stack(np.meshgrid(np.linspace(0, 30, 60), np.linspace(-9, 9, 30)), -1).reshape(-1, 2)
    ground = np.column_stack([strip, np.full(len(strip), 3.0)])
    z, _ = ground_under(WIRE, at, ground, np.arange(len(ground)), None, CONFIG.ground)
    assert np.allclose(z[(at > 0.5) & (at < 29.5)], 3.0) and np.isnan(z[at > 30.5]).all()
    beyond = np.concatenate([ground, ground + np.array([70.0, 0.0, 0.0])])  # and 40 m between
    z, _ = ground_under(WIRE, at, beyond, np.arange(len(beyond)), None, CONFIG.ground)
    assert np.allclose(z[(at < 39) | (at > 61)], 3.0) and np.isnan(z[(at > 41) & (at < 59)]).all()
    for few in (ground[:0], ground[:2], np.array([[10.0, 0, 0], [20.0, 0, 0], [30.0, 0, 0]])):
        assert np.isnan(ground_under(WIRE, at, few, np.arange(len(few)), None, CONFIG.ground)[0]).all()
    assert first(survey_of({5: ground})).vertical is None


def test_stated_deviations_of_distances_are_the_true_ones() -> None:
    """Over many noisy fits of one wire, beside it, below it and askew."""
    offsets = np.array([[0.0, 4.0, 0.0], [0.0, 0.0, -6.0], [0.0, 3.0, -3.0]])
    trees = {5: WIRE.points(np.array([15.0, 50.0, 90.0])) + offsets}
    found, stated = [], []
    for seed in range(60):
        unsorted = first(survey_of(trees, fitted(WIRE, 0.1, seed)), sampling=EXACT).places["vegetation"]
        places = sorted(unsorted, key=lambda place: float(place.on_obstacle[0]))
        found.append([place.distance_m for place in places])
        stated.append([place.sigma_m for place in places])
    assert np.std(found, axis=0) == pytest.approx(np.mean(stated, axis=0), rel=0.3)


def test_the_deviation_of_the_cloud_adds_to_that_of_the_wire() -> None:
    groups = {5: np.array([[40.0, 2.0, 12.0]])}
    survey = survey_of(groups)
    stated = replace(survey, cloud=cloud(groups, sigma_m=np.array([0.3])))
    one, two = (first(each, sampling=EXACT).least("vegetation") for each in (survey, stated))
    assert one is not None and two is not None
    assert two.sigma_m == pytest.approx(np.hypot(one.sigma_m, 0.3))
    alone = first(survey).least("vegetation")
    assert alone is not None and alone.sigma_m == pytest.approx(
        np.hypot(one.sigma_m, np.hypot(0.03, 0.45 * 1.5)), rel=1e-3
    ), "a single point does not show how far its plant reaches"
    assert any("no standard deviations" in finding.what for finding in said(survey))
    assert not any("no standard deviations" in finding.what for finding in said(stated))


def test_what_belongs_to_the_line_is_no_obstacle() -> None:
    above = WIRE.points(np.linspace(1, 99, 50)) + np.array([0, 0, 0.4])
    near_tower, far = np.array([[3.0, 2.0, 15.0]]), np.array([[50.0, 3.0, 12.0]])
    for code, group in ((6, "structures"), (1, "other")):
        one = first(survey_of({code: np.concatenate([near_tower, far])}))
        assert [place.on_obstacle.tolist() for place in one.places[group]] == far.tolist()
    tower = Structure(1, np.array([52.0, 3.0, 0.0]), 10.0, 0.1, "given")
    assert not first(survey_of({6: far}, structures=(tower,))).places["structures"]
    assert not first(survey_of({1: above})).places["other"]
    touching = first(survey_of({5: np.concatenate([near_tower, above])})).least("vegetation")
    assert touching is not None and touching.distance_m < 0.41  # a tree that touches counts
    for code, group in ((9, "ground"), (11, "ground"), (17, "other"), (26, "other"), (200, "other")):
        place = first(survey_of({code: far})).places[group][0]
        assert place.class_code == code
    for code in (7, 13, 14, 15, 16, 18):
        assert not any(first(survey_of({code: far})).places.values())
    labelled = replace(survey_of({5: far}), cloud=cloud({5: far}, wire=np.array([1])))
    assert not first(labelled).places["vegetation"]


def test_what_is_beyond_an_end_counts_and_what_is_far_beside_does_not() -> None:
    beyond = survey_of({5: np.array([[103.0, 0.0, 24.0]])})
    place = first(beyond).least("vegetation")
    assert place is not None
    assert place.distance_m == pytest.approx(5.0, abs=1e-3) and place.s_m == pytest.approx(100.0, abs=1e-3)
    cloud = replace(beyond.cloud, sigma_m=np.full(len(beyond.cloud.xyz), 0.1))
    of_images = first(replace(beyond, cloud=cloud))
    assert not of_images.places["vegetation"]  # it may be of a support that is not seen
    aside = survey_of({5: np.array([[50.0, CONFIG.obstacles.reach_m + 1, 12.0]])})
    assert not first(aside).places["vegetation"]
    wider = ObstacleConfig(reach_m=CONFIG.obstacles.reach_m + 2)
    assert measured(aside, obstacles=wider).wires[0].places["vegetation"]


def test_places_are_distinct_and_the_nearest_comes_first() -> None:
    random = np.random.default_rng(5)
    crowns = [np.array([x, 2.0, top]) - random.uniform(0, 1, (300, 3)) for x, top in ((20, 12.0), (60, 14.0))]
    one = first(survey_of({5: np.concatenate(crowns)}))
    places = one.places["vegetation"]
    assert len(places) == 2 and places[0].distance_m < places[1].distance_m
    assert places[0].on_obstacle[0] == pytest.approx(59.5, abs=0.6)
    flat = np.stack(np.meshgrid(np.arange(0, 100, 0.5), np.arange(-9, 9, 0.5)), -1).reshape(-1, 2)
    level = first(survey_of({2: np.column_stack([flat, np.zeros(len(flat))])}))
    assert len(level.places["ground"]) == 1  # the lowest point of the wire, and no neighbour
    equal = np.array([2.0, 2.0, 5.0, 1.0, 1.0, np.inf, np.inf, np.inf, np.inf, 4.0, np.inf])
    assert _lowest(equal, CONFIG.apart_m / 2, CONFIG) == [3, 0, 9]
    assert _lowest(np.ones(11), CONFIG.apart_m / 2, CONFIG) == [0, 3, 6, 9]
    for found in measured(corridor()).wires:
        for group in GROUPS:
            s = np.sort([place.s_m for place in found.places[group]])
            distance = [place.distance_m for place in found.places[group]]
            assert (np.diff(s) > CONFIG.apart_m - 1).all() and distance == sorted(distance)


def test_the_least_places_are_the_nearest_of_every_wire_and_group() -> None:
    found = measured(corridor())
    least = found.least_places()
    assert len(least) == 3 * (len(GROUPS) + 1)
    for place in found.all_places():
        of_it = [
            one for one in least if (one.wire, one.to, one.measure) == (place.wire, place.to, place.measure)
        ]
        assert len(of_it) == 1 and of_it[0].distance_m <= place.distance_m


def moved(survey: Survey, turn: np.ndarray, shift: np.ndarray) -> Survey:
    """The same survey in a LineFrame of another origin and azimuth."""

    def rebased(wire: Wire) -> Wire:
        a, b = ((turn[:2, :2] @ end + shift[:2]) for end in (wire.base.a, wire.base.b))
        up = np.array([0.0, 0.0, shift[2], shift[2], 0.0, 0.0])
        return replace(wire, base=Base(a, b), theta=wire.theta + up)

    line, span = survey.lines[0], survey.spans[0]
    structures = tuple(replace(one, foot=turn @ one.foot + shift) for one in survey.structures)
    spans = (replace(span, wires=tuple(rebased(one) for one in span.wires)),)
    cloud = replace(survey.cloud, xyz=survey.cloud.xyz @ turn.T + shift)
    return replace(survey, lines=(replace(line, structures=structures, spans=spans),), cloud=cloud)


def test_clearances_do_not_depend_on_where_the_world_is() -> None:
    c, s = np.cos(0.7), np.sin(0.7)
    turn, shift = np.array([[c, -s, 0], [s, c, 0], [0, 0, 1.0]]), np.array([5e5, 5.7e6, 300.0])
    survey = corridor()
    here, there = measured(survey), measured(moved(survey, turn, shift))
    for one, other in zip(here.all_places(), there.all_places(), strict=True):
        assert (one.wire, one.to, one.measure) == (other.wire, other.to, other.measure)
        assert other.on_wire == pytest.approx(turn @ one.on_wire + shift, abs=1e-3)
        assert other.distance_m == pytest.approx(one.distance_m, abs=1e-3)
        assert other.sigma_m == pytest.approx(one.sigma_m, abs=1e-4)


def test_verdicts_are_on_phases_and_on_what_the_requirement_is_for() -> None:
    survey = corridor(count=600)
    found = measured(survey, clearance_m=5.0)
    for place in found.all_places():
        verdict = found.verdict(place)
        if place.kind == "shield":
            assert verdict is None
        elif place.distance_m < 4.5:
            assert verdict == "closer than required"
        elif place.distance_m > 5.5:
            assert verdict == "clear"
    assert {place.kind for place in found.all_places()} == {"phase", "shield"}
    assert found.requirement is not None
    only = replace(found, requirement=replace(found.requirement, applies_to=("vegetation",)))
    phases = [place for place in only.all_places() if place.kind == "phase"]
    assert all((only.verdict(place) is None) == (place.to != "vegetation") for place in phases)
    free = measured(survey)
    assert all(free.verdict(place) is None for place in free.all_places())


def test_the_state_of_the_line_and_what_is_missing_are_said() -> None:
    groups = {5: np.array([[40.0, 2.0, 12.0]]), 7: np.zeros((3, 3)), 14: np.zeros((2, 3))}
    assert measured(survey_of(groups)).state == "as surveyed"
    state, *more = said(survey_of(groups))
    assert state.kind == "state of the line" and {one.kind for one in more} == {"clearances"}
    assert "as surveyed; the conductors' temperature is not known" in state.what
    text = " ".join(one.what for one in more)
    assert "no points of ground, buildings, other things as obstacles to the wires" in text
    assert "3 of class 7" in text and "class 14" not in text
    assert "at 31.5 degrees Celsius" in said(survey_of(groups, temperature_c=31.5))[0].what
    required = measure_clearances(survey_of(groups), ClearanceConfig(voltage_kv=345.0))[1]
    asked = [one.what for one in required if one.kind == "required clearance"]
    assert asked[0].startswith("Required: 1.31 m to vegetation (") and "phase conductors only" in asked[0]
    assert len(asked) > 1 and any("flash-over distance" in caveat for caveat in asked[1:])


def test_a_survey_without_scale_has_no_clearances() -> None:
    with pytest.raises(SurveyError, match="has no scale, so that clearances in metres cannot be measured"):
        survey = survey_of({2: np.zeros((3, 3))})
        measured(replace(survey, frame=replace(survey.frame, unit="unscaled")))


def test_an_empty_cloud_gives_no_places() -> None:
    found = measured(survey_of({2: np.empty((0, 3))}))
    assert found.all_places() == () and np.isnan(found.wires[0].profile.ground_z).all()


def test_points_that_are_known_to_metres_only_are_no_obstacles() -> None:
    """Of such points the nearest would always be a wrong one; all that are left out are reported."""
    crown = [[50.0, 0.0, 12.5], [49.6, 0.5, 11.8], [50.0, -0.5, 11.8]]
    places = np.array([*crown, [50.0, 1.0, 15.6], [50.0, 0.0, 0.0], [49.0, 0.0, 15.0]])
    labels = np.array([5, 5, 5, 5, 2, 2], np.uint8)
    sigma = np.array([0.2, 0.2, 0.2, 3.0, 0.5, 1.5])
    survey = replace(survey_of({5: places}), cloud=Cloud(places, labels, np.zeros(6, np.int64), None, sigma))
    plant, ground = (first(survey).least(group) for group in ("vegetation", "ground"))
    assert plant is not None and plant.distance_m == pytest.approx(3.5, abs=1e-3)
    assert ground is not None and ground.distance_m == pytest.approx(16, abs=1e-3)
    assert any("2 of 6 points are no obstacles" in finding.what for finding in said(survey))
    plant = first(replace(survey, cloud=replace(survey.cloud, sigma_m=None))).least("vegetation")
    assert plant is not None and plant.distance_m < 1.1


def test_vegetation_of_images_at_a_support_may_be_the_support() -> None:
    """It is no obstacle, which is reported; that of a laser is one."""
    places = np.array([[2.0, 0.0, 17.0], [97.5, 1.0, 17.0], [10.0, 0.0, 12.0]])
    cloud = Cloud(places, np.full(3, 5, np.uint8), np.zeros(3, np.int64), None, np.full(3, 0.1))
    survey = replace(survey_of({5: places}), cloud=cloud)
    place = first(survey).least("vegetation")
    assert place is not None and np.array_equal(place.on_obstacle, places[2])
    assert any("2 points of vegetation within 4 m of structures" in one.what for one in said(survey))
    laser = replace(survey, cloud=replace(cloud, sigma_m=None))
    assert len(first(laser).places["vegetation"]) == 3
    assert not any("images do not separate" in one.what for one in said(laser))


@pytest.mark.parametrize(
    ("colour", "seen", "depth_m", "counts"),
    [
        ((70, 110, 60), 9, 0.3, True),
        ((120, 124, 118), 9, 3.0, False),
        ((70, 110, 60), 1, 0.3, False),
        ((70, 110, 60), 1, 3.0, True),
    ],
    ids=["green", "grey", "green that one image sees", "and of which more is seen below"],
)
def test_what_is_green_at_a_support_is_a_plant(
    colour: tuple[int, int, int], seen: int, depth_m: float, counts: bool
) -> None:
    """A bush below a lower arm, or a part of the lattice."""
    plan, heights = np.random.default_rng(2).normal(0, 0.2, (300, 2)), np.linspace(7 - depth_m, 7, 300)
    places = np.column_stack([plan + np.array([2.0, 0.0]), heights])
    n = len(places)
    cloud = Cloud(
        places, np.full(n, 5, np.uint8), np.zeros(n, np.int64), np.tile(np.array(colour, np.uint8), (n, 1)),
        np.full(n, 0.1), seen=np.full(n, seen), past=np.zeros(n, np.int64),
    )  # fmt: skip
    survey = replace(survey_of({5: places}), cloud=cloud)
    assert (first(survey).least("vegetation") is not None) == counts
    left = any(f"{n} points of vegetation within 4 m of structures" in one.what for one in said(survey))
    assert left != counts


def test_a_wire_with_open_ends_has_clearances_between_them() -> None:
    """The same as those of the whole wire where it is known, and no sag."""
    random = np.random.default_rng(6)
    xy = random.uniform([-15, -12], [115, 12], (12_000, 2))
    groups = {2: np.column_stack([xy, 0.02 * xy[:, 0]]), 5: np.array([[50.0, 2.0, 11.0], [45.0, -3.0, 9.0]])}
    whole, seen = fitted(WIRE, 0.05), Open("not filmed")
    piece = replace(whole.between(30.0, 70.0), ends=(seen, seen))
    assert piece.sag is None and piece.open is not None
    one, other = first(survey_of(groups, whole)), first(survey_of(groups, piece))
    places = [(one.vertical, other.vertical, CONFIG.station_m)]  # which is where a station is
    places += [
        (*pair, 1e-3) for pair in zip(one.places["vegetation"], other.places["vegetation"], strict=True)
    ]
    for all_of_it, part, off_m in places:
        assert all_of_it is not None and part is not None
        assert part.distance_m == pytest.approx(all_of_it.distance_m, abs=1e-3)
        assert part.s_m + 30 == pytest.approx(all_of_it.s_m, abs=off_m)
        assert part.sigma_m == pytest.approx(all_of_it.sigma_m, rel=1e-2)
    assert len(other.profile.s_m) == 81 and np.isfinite(other.profile.ground_z).all()
    loose = replace(piece, ends=(whole.ends[0], seen))
    assert first(survey_of(groups, loose)).vertical is not None


def test_a_wire_with_swing_has_the_distances_of_its_own_curve() -> None:
    """Brute force over the curve, the vertical below it, and the deviation of swing and offsets together."""
    random = np.random.default_rng(7)
    upright = hang((0.0, 0.0, 30.0), (90.0, 40.0, 34.0), 6.0)
    wire = swung(upright, 0.5, 1.0, -2.0)
    L = np.tril(random.normal(size=(6, 6)))
    wire = replace(wire, covariance=1e-4 * L @ L.T)
    xy = random.uniform([-15, -15], [105, 60], (4000, 2))
    ground = np.column_stack([xy, 0.05 * xy[:, 0] - 0.1 * xy[:, 1]])
    trees = wire.points(random.uniform(0, wire.base.length_m, 300)) + random.normal(size=(300, 3)) * [3, 3, 2]
    trees[:, 2] -= 6
    survey = survey_of({2: ground, 5: trees}, wire)
    one, config = first(survey, sampling=EXACT), CONFIG.obstacles
    for group, index in obstacles(survey, config).items():
        place = one.least(group)
        if len(index):
            assert place is not None
            assert place.distance_m == pytest.approx(
                brute(wire, survey.cloud.xyz[index], 8000).min(), abs=1e-3
            )
    assert first(survey_of({5: trees}, upright)).places["vegetation"][0].distance_m > 0
    points, z = one.profile.points, one.profile.ground_z
    assert np.abs(points - wire.points(one.profile.s_m)).max() < 1e-9
    assert np.abs(z - 0.05 * points[:, 0] + 0.1 * points[:, 1]).max() < 0.01
    s = np.linspace(0, wire.base.length_m, 10_000)
    line = wire.points(s)
    height = line[:, 2] - 0.05 * line[:, 0] + 0.1 * line[:, 1]
    assert one.vertical is not None and one.vertical.distance_m == pytest.approx(height.min(), abs=0.01)

    place = one.places["vegetation"][0]
    draws = random.multivariate_normal(wire.theta, wire.covariance, 400)
    near = place.s_m + np.linspace(-3, 3, 2001)
    lines = (replace(wire, theta=theta).points(near) for theta in draws)
    drawn = [np.linalg.norm(each - place.on_obstacle, axis=1).min() for each in lines]
    assert np.std(drawn) == pytest.approx(place.sigma_m, rel=0.1)


def test_only_points_that_cannot_be_nearest_are_left_out_of_the_comparison() -> None:
    """At each station of every shape, steep and swung ones too, whatever lies beside and beyond it."""
    random = np.random.default_rng(8)
    for wire in SHAPES.values():
        length, at = wire.base.length_m, stations(wire, 5.0)
        middles = wire.points(random.uniform(-10, length + 10, 500))
        points = middles + random.normal(size=(500, 3)) * random.uniform(0.3, 12, (500, 1))
        found = room.nearest_along(wire, at, points, np.arange(500), 50.0, (20.0, 20.0))
        distance, s = brute(wire, points), wire.base.local(points)[:, 0]
        station = np.rint(np.clip(s, 0, length) / length * (len(at) - 1)).astype(int)
        inside = (s >= -20) & (s <= length + 20)
        for k, value in enumerate(found.distance_m):
            assert value == pytest.approx(distance[inside & (station == k)].min(), abs=1e-3)


def test_below_a_steep_wire_a_point_is_nearer_than_it_is_high() -> None:
    """5 m straight below the wire is nearer to it than 4.5 m aside."""
    wire, at = SHAPES["steep"], np.array([0.0, 50.0])
    offsets = np.array([[0, 0, -5], [-0.6 * 4.5, 0.8 * 4.5, 0]])
    below, aside = wire.points(np.array([40.0, 41.0])) + offsets
    found = room.nearest_along(wire, at, np.array([below, aside]), np.arange(2), 50.0, (0.0, 0.0))
    assert found.index.tolist() == [-1, 0]
    assert found.distance_m[1] == pytest.approx(brute(wire, below[None])[0], abs=1e-3)


def test_rules_hold_the_settings() -> None:
    text = " ".join(rules(ObstacleConfig(reach_m=33.0, support_m=7.5, own_m=0.7, max_sigma_m=1.3)).values())
    for said_of in ("within 33 m of it", "within 7.5 m of a structure's foot", "within 0.7 m", "than 1.3 m"):
        assert said_of in text


@pytest.mark.parametrize(
    ("config", "wrong", "text"),
    [
        (ClearanceConfig, {"station_m": 0.0}, "station_m > 0"),
        (ClearanceConfig, {"max_places": 0}, "max_places >= 1"),
        (ObstacleConfig, {"reach_m": -1.0}, "reach_m > 0"),
        (ObstacleConfig, {"max_sigma_m": 0.0}, "max_sigma_m > 0"),
        (GroundSectionConfig, {"cell_m": 0.0}, "0 < cell_m <= side_m"),
        (GroundSectionConfig, {"scatter_cells": 3}, "scatter_cells of 4 or more"),
        (GroundSectionConfig, {"max_gap_m": -1.0}, "below_plants_m of 0 or more"),
    ],
)
def test_settings_that_measure_nothing_are_refused(config: Any, wrong: dict[str, Any], text: str) -> None:
    with pytest.raises(ConfigError, match=text):
        config(**wrong)
