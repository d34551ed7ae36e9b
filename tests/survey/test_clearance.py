"""Clearances: as brute force finds them, exact on surfaces of a formula, and as uncertain as they say."""

from dataclasses import replace

import numpy as np
import pytest
from tests.support.catenary_surveys import UTM, cloud, conductor, corridor

from plnerf.errors import SurveyError
from plnerf.line.catenary import Catenary, hang
from plnerf.survey import obstacles as room
from plnerf.survey.clearance import APART_M, Clearances, _lowest, measure_clearances
from plnerf.survey.ground_section import ground_under
from plnerf.survey.model import Cloud, Survey, Tower
from plnerf.survey.obstacles import CLASSES, obstacles, onto_wire, stations
from plnerf.survey.thresholds import GROUPS, own_requirement

ZERO = np.zeros(3)
WIRE = hang((0.0, 0.0, 20.0), (100.0, 0.0, 20.0), 4.0)
SHAPES = {
    "level": WIRE,
    "steep": hang((0.0, 0.0, 10.0), (40.0, 30.0, 60.0), 4.0),
    "deep": hang((0.0, 0.0, 30.0), (30.0, 0.0, 28.0), 12.0),
    "far away": hang((500_000.0, 5_700_000.0, 110.0), (500_180.0, 5_700_090.0, 104.0), 5.0),
}


def survey_of(groups: dict[int, np.ndarray], wire: Catenary = WIRE, **more: object) -> Survey:
    own = {"towers": (), "unit": "m", "crs": None, "origin": None, "source": "test"} | more
    return Survey(conductors=(conductor(wire),), cloud=cloud(groups), **own)  # type: ignore[arg-type]


def brute(wire: Catenary, points: np.ndarray, count: int = 20_000) -> np.ndarray:
    """Distance of each point from the wire, against samples 1 cm apart or closer."""
    line = wire.points(np.linspace(0, wire.span_m, count))
    return np.array([np.linalg.norm(line - point, axis=1).min() for point in points])


@pytest.mark.parametrize("name", SHAPES)
def test_points_are_as_far_from_a_wire_as_brute_force_says(name: str) -> None:
    wire = SHAPES[name]
    random = np.random.default_rng(3)
    points = wire.points(random.uniform(-10, wire.span_m + 10, 200)) + random.normal(size=(200, 3)) * 6
    distance, s = onto_wire(wire, points)
    assert np.abs(distance - brute(wire, points)).max() < 1e-3
    assert np.abs(np.linalg.norm(points - wire.points(s), axis=1) - distance).max() < 1e-3


@pytest.mark.parametrize("chunk", [61, 500_000])
def test_the_least_distances_are_those_of_brute_force(monkeypatch: pytest.MonkeyPatch, chunk: int) -> None:
    monkeypatch.setattr(room, "CHUNK", chunk)
    survey = corridor(count=500)
    survey = replace(survey, cloud=replace(survey.cloud, sigma_m=None))
    found, counted = measure_clearances(survey), obstacles(survey)
    for one, known in zip(found.conductors, survey.conductors, strict=True):
        for group in GROUPS:
            distance = brute(known.fit.curve, survey.cloud.xyz[counted[group]], 8000)
            place = one.least(group)
            assert place is not None
            assert place.distance_m == pytest.approx(distance.min(), abs=1e-3)
            assert np.array_equal(place.obstacle, survey.cloud.xyz[counted[group][distance.argmin()]])
            assert np.linalg.norm(place.wire - place.obstacle) == pytest.approx(place.distance_m, abs=1e-3)
            assert place.class_code in CLASSES[group]


def test_the_profile_holds_the_least_distance_of_the_points_beside_each_station() -> None:
    survey = corridor(count=1500)
    profile, curve = measure_clearances(survey).conductors[0].profile, survey.conductors[0].fit.curve
    trees = survey.cloud.xyz[obstacles(survey)["vegetation"]]
    s = np.clip((trees[:, :2] - curve.a[:2]) @ curve.direction, 0, curve.span_m)
    station = np.rint(s / curve.span_m * (len(profile.s_m) - 1)).astype(int)
    distance = brute(curve, trees, 8000)
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
    one = measure_clearances(survey_of({2: ground})).conductors[0]
    curve = conductor(WIRE).fit.curve
    s = np.linspace(0, curve.span_m, 10_000)
    line = curve.points(s)
    height = line[:, 2] - 2 - 0.1 * line[:, 0]
    assert one.vertical is not None
    assert one.vertical.distance_m == pytest.approx(height.min(), abs=1e-3)
    assert one.vertical.s_m == pytest.approx(s[height.argmin()], abs=0.5)
    assert np.nanmax(np.abs(one.profile.ground_z - 2 - 0.1 * one.profile.wire[:, 0])) < 1e-6
    assert not np.isnan(one.profile.ground_z).any()
    across = one.least("ground")
    assert across is not None
    assert across.distance_m == pytest.approx(height.min() / np.sqrt(1 + 0.1**2 + 0.2**2), abs=0.02)
    assert across.measure == "distance" and one.vertical.measure == "vertical"


def test_where_no_ground_is_near_none_is_made_up() -> None:
    at = stations(WIRE, 0.5)
    strip = np.stack(np.meshgrid(np.linspace(0, 30, 60), np.linspace(-9, 9, 30)), -1).reshape(-1, 2)
    ground = np.column_stack([strip, np.full(len(strip), 3.0)])
    z, _ = ground_under(WIRE, at, ground, np.arange(len(ground)), None)
    assert np.allclose(z[(at > 0.5) & (at < 29.5)], 3.0) and np.isnan(z[at > 30.5]).all()
    beyond = np.concatenate([ground, ground + np.array([70.0, 0.0, 0.0])])  # and 40 m between
    z, _ = ground_under(WIRE, at, beyond, np.arange(len(beyond)), None)
    assert np.allclose(z[(at < 39) | (at > 61)], 3.0) and np.isnan(z[(at > 41) & (at < 59)]).all()
    for few in (ground[:0], ground[:2], np.array([[10.0, 0, 0], [20.0, 0, 0], [30.0, 0, 0]])):
        assert np.isnan(ground_under(WIRE, at, few, np.arange(len(few)), None)[0]).all()
    assert measure_clearances(survey_of({5: ground})).conductors[0].vertical is None


def test_stated_deviations_of_distances_are_the_true_ones() -> None:
    """Over many noisy fits of one wire, beside it, below it and askew."""
    offsets = np.array([[0.0, 4.0, 0.0], [0.0, 0.0, -6.0], [0.0, 3.0, -3.0]])
    survey = survey_of({5: WIRE.points(np.array([15.0, 50.0, 90.0])) + offsets})
    found, said = [], []
    for seed in range(60):
        noisy = replace(survey, conductors=(conductor(WIRE, noise_m=0.1, seed=seed),))
        places = measure_clearances(noisy).conductors[0].places["vegetation"]
        places = sorted(places, key=lambda place: float(place.obstacle[0]))
        found.append([place.distance_m for place in places])
        said.append([place.sigma_m for place in places])
    assert np.std(found, axis=0) == pytest.approx(np.mean(said, axis=0), rel=0.3)


def test_the_deviation_of_the_cloud_adds_to_that_of_the_wire() -> None:
    groups = {5: np.array([[40.0, 2.0, 12.0]])}
    survey = survey_of(groups)
    alone = measure_clearances(survey)
    both = measure_clearances(replace(survey, cloud=cloud(groups, sigma_m=np.array([0.3]))))
    one, two = (found.conductors[0].least("vegetation") for found in (alone, both))
    assert one is not None and two is not None
    assert two.sigma_m == pytest.approx(np.hypot(one.sigma_m, 0.3))
    assert any("no standard deviations" in note for note in alone.notes)
    assert not any("no standard deviations" in note for note in both.notes)


def test_what_belongs_to_the_line_is_no_obstacle() -> None:
    above = WIRE.points(np.linspace(1, 99, 50)) + np.array([0, 0, 0.4])
    near_tower, far = np.array([[3.0, 2.0, 15.0]]), np.array([[50.0, 3.0, 12.0]])
    for code, group in ((6, "structures"), (1, "other")):
        one = measure_clearances(survey_of({code: np.concatenate([near_tower, far])})).conductors[0]
        assert [place.obstacle.tolist() for place in one.places[group]] == far.tolist()
    mid_span = survey_of({6: far}, towers=(Tower(np.array([52.0, 3.0, 0.0]), 10.0),))
    assert not measure_clearances(mid_span).conductors[0].places["structures"]
    assert not measure_clearances(survey_of({1: above})).conductors[0].places["other"]
    trees = measure_clearances(survey_of({5: np.concatenate([near_tower, above])}))
    assert trees.conductors[0].least("vegetation").distance_m < 0.41  # a tree that touches is told
    for code, group in ((9, "ground"), (11, "ground"), (17, "other"), (26, "other"), (200, "other")):
        assert measure_clearances(survey_of({code: far})).conductors[0].least(group).class_code == code
    for code in (7, 13, 14, 15, 16, 18):
        assert not any(measure_clearances(survey_of({code: far})).conductors[0].places.values())
    labelled = replace(survey_of({5: far}), cloud=cloud({5: far}, wire=np.array([1])))
    assert not measure_clearances(labelled).conductors[0].places["vegetation"]


def test_what_is_beyond_an_end_counts_and_what_is_far_beside_does_not() -> None:
    beyond = survey_of({5: np.array([WIRE.b]) + np.array([3.0, 0.0, 4.0])})
    place = measure_clearances(beyond).conductors[0].least("vegetation")
    assert place is not None
    assert place.distance_m == pytest.approx(5.0, abs=1e-3) and place.s_m == pytest.approx(100.0, abs=1e-3)
    cloud = replace(beyond.cloud, sigma_m=np.full(len(beyond.cloud.xyz), 0.1))
    of_images = measure_clearances(replace(beyond, cloud=cloud)).conductors[0]
    assert not of_images.places["vegetation"]  # it may be of a support that is not seen
    aside = survey_of({5: np.array([[50.0, room.REACH_M + 1, 12.0]])})
    assert not measure_clearances(aside).conductors[0].places["vegetation"]


def test_places_are_distinct_and_the_nearest_comes_first() -> None:
    random = np.random.default_rng(5)
    crowns = [np.array([x, 2.0, top]) - random.uniform(0, 1, (300, 3)) for x, top in ((20, 12.0), (60, 14.0))]
    one = measure_clearances(survey_of({5: np.concatenate(crowns)})).conductors[0]
    places = one.places["vegetation"]
    assert len(places) == 2 and places[0].distance_m < places[1].distance_m
    assert places[0].obstacle[0] == pytest.approx(59.5, abs=0.6)
    flat = np.stack(np.meshgrid(np.arange(0, 100, 0.5), np.arange(-9, 9, 0.5)), -1).reshape(-1, 2)
    level = measure_clearances(survey_of({2: np.column_stack([flat, np.zeros(len(flat))])}))
    assert len(level.conductors[0].places["ground"]) == 1  # the lowest point of the wire, and no neighbour
    equal = np.array([2.0, 2.0, 5.0, 1.0, 1.0, np.inf, np.inf, np.inf, np.inf, 4.0, np.inf])
    assert _lowest(equal, APART_M / 2) == [3, 0, 9]
    assert _lowest(np.ones(11), APART_M / 2) == [0, 3, 6, 9]
    for found in measure_clearances(corridor()).conductors:
        for group in GROUPS:
            s = np.sort([place.s_m for place in found.places[group]])
            distance = [place.distance_m for place in found.places[group]]
            assert (np.diff(s) > APART_M - 1).all() and distance == sorted(distance)


def test_one_tree_under_three_wires_is_one_of_the_worst_places() -> None:
    found = measure_clearances(corridor())
    worst = found.worst("vegetation", 3)
    assert worst[0].distance_m == min(one.least("vegetation").distance_m for one in found.conductors)
    for i, place in enumerate(worst):
        for other in worst[:i]:
            assert np.linalg.norm((place.obstacle - other.obstacle)[:2]) > APART_M
    assert found.worst("vegetation", 1) == worst[:1]


def test_clearances_do_not_depend_on_where_the_world_is() -> None:
    here, there = (measure_clearances(corridor(origin)) for origin in (ZERO, UTM + np.array([0, 0, 300.0])))
    for one, other in zip(here.all_places(), there.all_places(), strict=True):
        assert (one.conductor, one.to, one.measure) == (other.conductor, other.to, other.measure)
        assert other.distance_m == pytest.approx(one.distance_m, abs=1e-3)
        assert other.sigma_m == pytest.approx(one.sigma_m, abs=1e-4)


def test_verdicts_are_on_phases_and_on_what_the_requirement_is_for() -> None:
    survey = corridor(count=600)
    found = measure_clearances(survey, own_requirement(5.0))
    for place in found.all_places():
        verdict = found.verdict(place)
        if place.kind == "shield":
            assert verdict is None
        elif place.distance_m < 4.5:
            assert verdict == "closer than required"
        elif place.distance_m > 5.5:
            assert verdict == "clear"
    assert {place.kind for place in found.all_places()} == {"phase", "shield"}
    only = measure_clearances(survey, replace(own_requirement(5.0), applies_to=("vegetation",)))
    phases = [place for place in only.all_places() if place.kind == "phase"]
    assert all((only.verdict(place) is None) == (place.to != "vegetation") for place in phases)
    free = measure_clearances(survey)
    assert all(free.verdict(place) is None for place in free.all_places())


def test_the_state_of_the_line_and_what_is_missing_are_said() -> None:
    groups = {5: np.array([[40.0, 2.0, 12.0]]), 7: np.zeros((3, 3)), 14: np.zeros((2, 3))}
    found = measure_clearances(survey_of(groups))
    assert found.state == "as surveyed" and found.temperature_c is None
    said = " ".join(found.notes)
    assert "as surveyed; the conductors' temperature is not known" in said
    assert "No points of the cloud count as ground, structures, other things" in said
    assert "3 of class 7" in said and "class 14" not in said
    warm: Clearances = measure_clearances(survey_of(groups, temperature_c=31.5))
    assert warm.temperature_c == 31.5 and "at 31.5 degrees Celsius" in warm.notes[0]


def test_a_survey_without_scale_has_no_clearances() -> None:
    with pytest.raises(SurveyError, match="has no scale, so that clearances in metres cannot be told"):
        measure_clearances(survey_of({2: np.zeros((3, 3))}, unit="unscaled"))


def test_an_empty_cloud_gives_no_places() -> None:
    found = measure_clearances(survey_of({2: np.empty((0, 3))}))
    assert found.all_places() == () and np.isnan(found.conductors[0].profile.ground_z).all()


def test_points_that_are_known_to_metres_only_are_no_obstacles() -> None:
    """Of such points the nearest would always be a wrong one; all that are left out are told."""
    places = np.array([[50.0, 0.0, 12.5], [50.0, 1.0, 15.6], [50.0, 0.0, 0.0], [49.0, 0.0, 15.0]])
    labels = np.array([5, 5, 2, 2], np.uint8)
    sigma = np.array([0.2, 3.0, 0.5, 1.5])
    survey = replace(survey_of({5: places}), cloud=Cloud(places, labels, np.zeros(4, np.int64), None, sigma))
    found = measure_clearances(survey)
    plant, ground = (found.conductors[0].least(group) for group in ("vegetation", "ground"))
    assert plant is not None and plant.distance_m == pytest.approx(3.5, abs=1e-3)
    assert ground is not None and ground.distance_m == pytest.approx(16, abs=1e-3)
    assert any("2 of 4 points are no obstacles" in note for note in found.notes)
    certain = measure_clearances(replace(survey, cloud=replace(survey.cloud, sigma_m=None))).conductors[0]
    plant = certain.least("vegetation")
    assert plant is not None and plant.distance_m < 1.1


def test_vegetation_of_images_at_a_support_may_be_the_support() -> None:
    """It is no obstacle, and said; that of a laser is one."""
    places = np.array([[2.0, 0.0, 17.0], [97.5, 1.0, 17.0], [10.0, 0.0, 12.0]])
    cloud = Cloud(places, np.full(3, 5, np.uint8), np.zeros(3, np.int64), None, np.full(3, 0.1))
    survey = replace(survey_of({5: places}), cloud=cloud)
    found = measure_clearances(survey)
    place = found.conductors[0].least("vegetation")
    assert place is not None and np.array_equal(place.obstacle, places[2])
    assert any("2 points of vegetation within 4 m of supports" in note for note in found.notes)
    laser = measure_clearances(replace(survey, cloud=replace(cloud, sigma_m=None)))
    assert len(laser.conductors[0].places["vegetation"]) == 3
    assert not any("images do not tell" in note for note in laser.notes)
