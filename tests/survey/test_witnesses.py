"""Points that too few images see are possible obstacles, not obstacles; what was not seen is told apart."""

from dataclasses import replace

import numpy as np
import pytest
from tests.support.catenary_surveys import fitted, line_of
from tests.survey.test_clearance import WIRE, survey_of

from plnerf.errors import ConfigError
from plnerf.line.cloud import GROUND, HIGH_VEGETATION, LOW_VEGETATION, NOISE, NOT_JUDGED, VEGETATION, Cloud
from plnerf.line.ends import Attached, Open
from plnerf.line.survey import Survey
from plnerf.line.wire import Wire
from plnerf.survey.clearance import measure_clearances
from plnerf.survey.config_ground import ClearanceConfig, CoverageConfig
from plnerf.survey.config_obstacles import FloatingConfig, ObstacleConfig
from plnerf.survey.coverage import about_coverage, coverage_of
from plnerf.survey.floating import floats
from plnerf.survey.possible import POSSIBLE
from plnerf.survey.stereo import witnesses as witnesses_of
from plnerf.survey.stereo.config import WitnessConfig
from plnerf.survey.stereo.depth import DepthMap
from plnerf.survey.stereo.stereo_views import View
from plnerf.survey.stereo.witnesses import Sight, with_witnesses, witnesses

CONFIG = WitnessConfig()
WIDE, TALL, FOCAL = 240, 160, 200.0
DOWN = np.diag([1.0, -1.0, -1.0])
"""Looking straight down, x to the right."""


def above(x: float, y: float = 0.0, z: float = 40.0) -> View:
    """A camera above a place."""
    centre = np.array([x, y, z])
    return View(DOWN, centre, np.full(2, FOCAL), np.array([WIDE, TALL]) / 2, np.zeros(5), WIDE, TALL)


def sight(view: View, z: float = 0.0, box: tuple[float, float, float, float] | None = None) -> Sight:
    """Of a flat floor at z, and a box on it by its x, y, half side and top."""
    rays = view.rays()
    t = (z - view.centre[2]) / rays[..., 2]
    if box is not None:
        x, y, half, top = box
        to_top = (top - view.centre[2]) / rays[..., 2]
        at = view.centre + to_top[..., None] * rays
        t = np.where((np.abs(at[..., :2] - [x, y]) <= half).all(-1), to_top, t)
    return Sight.of(view, DepthMap(t, np.full(t.shape, 0.05)))


TREE = (2.0, 1.0, 2.0, 6.0)


def counts(points: list[list[float]], sights: list[Sight], sigma: float = 0.1) -> list[tuple[int, int]]:
    at = np.array(points, np.float64)
    seen, past = witnesses(at, np.full(len(at), sigma), sights, CONFIG)
    return list(zip(seen.tolist(), past.tolist(), strict=True))


def test_images_see_a_thing_or_past_it() -> None:
    """A crown's top is seen by all, what floats in the air is seen past, what a crown hides is neither."""
    sights = [sight(above(x), box=TREE) for x in (-4.0, -1.0, 2.0, 5.0, 8.0)]
    top, floating, hidden, floor = [2, 1, 6], [-6, -3, 6], [2, 1, 2], [-6, -3, 0]
    assert counts([top, floating, hidden, floor], sights) == [(5, 0), (0, 5), (0, 0), (5, 0)]


def test_images_from_about_one_direction_make_the_same_mistakes() -> None:
    """Three that are next to each other count as one, until another sees it from elsewhere."""
    near = [sight(above(x), box=TREE) for x in (1.0, 2.0, 3.0)]
    assert counts([[2, 1, 6]], near) == [(1, 0)]
    assert counts([[2, 1, 6]], [*near, sight(above(8.0), box=TREE)]) == [(4, 0)]


def test_silent_images_and_those_that_look_elsewhere_are_no_witnesses() -> None:
    view = above(0.0)
    silent = Sight.of(view, DepthMap(np.full((TALL, WIDE), np.nan), np.full((TALL, WIDE), np.nan)))
    assert counts([[0, 0, 6]], [silent, sight(above(500.0))]) == [(0, 0)]


def test_uncertain_points_are_seen_at_greater_distances() -> None:
    """3 m above the floor: past it where the point is exact, at it where it may be 2 m off."""
    one = [sight(above(0.0))]
    assert counts([[0, 0, 3]], one, 0.05) == [(0, 1)] and counts([[0, 0, 3]], one, 2.0) == [(1, 0)]


def clump(at: tuple[float, float, float], size_m: float, random: np.random.Generator) -> np.ndarray:
    return np.array(at) + random.uniform(-size_m / 2, size_m / 2, (60, 3))


def test_tips_of_conifers_and_bits_beside_a_crown_are_plants() -> None:
    random = np.random.default_rng(1)
    floor = np.column_stack([random.uniform(-20, 20, (4000, 2)), np.zeros(4000)])
    tip = np.array([0, 0, 5]) + random.normal(0, (0.1, 0.1, 0.4), (60, 3))
    crown = clump((8, 0, 5), 2.5, random)
    near, far = clump((8, 0, 8), 0.3, random), clump((8, 0, 9.9), 0.3, random)
    wire = np.linspace([5, 3, 5], [10, 3.2, 5.2], 60)  # within a bit's reach of the crown
    xyz = np.concatenate([floor, tip, crown, near, far, wire])
    label = np.repeat([GROUND, HIGH_VEGETATION], [len(floor), 300]).astype(np.uint8)
    cloud = Cloud(xyz, label, np.zeros(len(xyz), np.int64))
    index = np.arange(len(floor), len(xyz))
    found = floats(cloud, index, FloatingConfig()).reshape(5, 60)
    assert found.all(1).tolist() == found.any(1).tolist() == [False, False, False, True, True]
    found = floats(cloud, index, FloatingConfig(upright_deg=89.0, bit_m=1.0)).reshape(5, 60)
    assert found.all(1).tolist() == [True, False, True, True, True]
    for wrong in ({"upright_deg": 90.0}, {"bit_m": -1.0}):
        with pytest.raises(ConfigError, match="upright_deg"):
            FloatingConfig(**wrong)


def test_what_is_thin_and_in_the_air_is_no_plant() -> None:
    """What is on the ground, is a crown, or hangs together with one is."""
    random = np.random.default_rng(0)
    floor = np.column_stack([random.uniform(-20, 20, (4000, 2)), np.zeros(4000)])
    plants = [
        clump((0, 0, 5), 0.35, random), clump((8, 0, 5), 2.5, random), clump((8, 0, 6.7), 0.35, random),
        clump((-8, 0, 1), 0.35, random),
    ]  # fmt: skip
    wire = np.linspace([-8, -8, 9], [-4, -6, 9.2], 60) + random.normal(0, 0.05, (60, 3))
    plants.append(wire)
    xyz = np.concatenate([floor, *plants])
    label = np.repeat([GROUND, HIGH_VEGETATION], [len(floor), 300]).astype(np.uint8)
    cloud = Cloud(xyz, label, np.zeros(len(xyz), np.int64))
    found = floats(cloud, np.arange(len(floor), len(xyz)), FloatingConfig()).reshape(5, 60)
    assert found.all(1).tolist() == [True, False, False, False, True] and not found[1:4].any()
    for strays, thin in ((2, True), (30, False)):
        above = xyz.copy()
        above[-60 : -60 + strays, 2] += 0.8  # of the wire's
        beside = floats(replace(cloud, xyz=above), np.arange(len(floor), len(xyz)), FloatingConfig())
        assert beside[-60:].all() == beside[-60:].any() == thin
    assert not floats(cloud, np.arange(0), FloatingConfig()).any()
    only = Cloud(xyz[-300:], label[-300:], np.zeros(300, np.int64))
    assert not floats(only, np.arange(300), FloatingConfig()).any()  # how high they are is not known
    with pytest.raises(ConfigError, match="share"):
        FloatingConfig(share=0.0)
    with pytest.raises(ConfigError, match="cell_m"):
        FloatingConfig(cell_m=0.0)


def judged(seen: list[int], past: list[int], distances: list[float]) -> Survey:
    """Plants straight below the wire's lowest point, one for each, and what images see of them."""
    wire = fitted(WIRE)
    s = np.array([wire.lowest[0]])
    plants = wire.points(s) - np.array([[0.0, 0.0, d] for d in distances])
    survey = survey_of({HIGH_VEGETATION: plants})
    cloud = replace(
        survey.cloud, sigma_m=np.full(len(plants), 0.05), seen=np.array(seen), past=np.array(past)
    )
    return replace(survey, cloud=cloud)


@pytest.mark.parametrize(("seen", "past", "counts"), [
    (7, 0, True), (4, 3, True), (3, 2, True), (NOT_JUDGED, NOT_JUDGED, True),
    (2, 0, False), (4, 4, False), (2, 7, False), (0, 0, False),
])  # fmt: skip
def test_a_near_plant_counts_if_enough_images_see_it(seen: int, past: int, counts: bool) -> None:
    """Else the next one does, and the near one is possible, with the numbers of images and a finding."""
    survey = judged([seen, 9], [past, 0], [1.5, 4.0])
    found, findings = measure_clearances(survey, ClearanceConfig())
    least = found.wires[0].least("vegetation")
    assert least is not None and least.distance_m == pytest.approx(1.5 if counts else 4.0, abs=0.01)
    said = [one for one in findings if one.kind == POSSIBLE]
    if counts:
        assert found.possible == () and not said
    else:
        (one,) = found.possible
        assert (one.seen, one.past) == (seen, past) and one.place.distance_m == pytest.approx(1.5, abs=0.01)
        assert found.verdict(one.place) is None and "1.50 m from wire" in said[0].what


@pytest.mark.parametrize("is_open", [False, True])
def test_a_plant_where_a_wire_is_seen_last_may_be_a_structure(is_open: bool) -> None:
    """Only at an open end: there it is possible, however many images see it; elsewhere it counts."""
    wire = fitted(WIRE)
    if is_open:
        wire = replace(
            wire, ends=(wire.ends[0], Open("nothing")), evidence=replace(wire.evidence, seen_m=((0.0, 70.0),))
        )
    plants = wire.points(np.array([72.0, 40.0])) - np.array([[0.0, 0.0, 1.5], [0.0, 0.0, 4.0]])
    survey = survey_of({HIGH_VEGETATION: plants}, wire)
    nine, none = np.array([9, 9]), np.array([0, 0])
    survey = replace(survey, cloud=replace(survey.cloud, sigma_m=np.full(2, 0.05), seen=nine, past=none))
    found, _ = measure_clearances(survey, ClearanceConfig())
    least = found.wires[0].least("vegetation")
    assert least is not None and least.distance_m == pytest.approx(4.0 if is_open else 1.5, abs=0.05)
    assert [one.at_open_end for one in found.possible] == [True] * is_open


@pytest.mark.parametrize(("label", "aside_m", "counts"), [
    (LOW_VEGETATION, 1.5, True), (VEGETATION, 1.5, True), (VEGETATION, 0.5, False),
    (HIGH_VEGETATION, 1.5, False),
])  # fmt: skip
def test_a_bush_where_a_wire_is_seen_last_is_no_structure(label: int, aside_m: float, counts: bool) -> None:
    """Where something high stands nearby, it may be a structure's foot."""
    wire = fitted(WIRE)
    wire = replace(
        wire, ends=(wire.ends[0], Open("nothing")), evidence=replace(wire.evidence, seen_m=((0.0, 70.0),))
    )
    high, bush = wire.points(np.array([72.0 + aside_m, 72.0])) - np.array([[0.0, 0.0, 5.0], [0.0, 0.0, 9.0]])
    high, bush = high[None], bush[None]
    same = label == HIGH_VEGETATION
    parts = {HIGH_VEGETATION: np.concatenate([high, bush])} if same else {label: bush, HIGH_VEGETATION: high}
    survey = survey_of(parts, wire)
    nine, none = np.array([9, 9]), np.array([0, 0])
    survey = replace(survey, cloud=replace(survey.cloud, sigma_m=np.full(2, 0.05), seen=nine, past=none))
    found, _ = measure_clearances(survey, ClearanceConfig())
    least = found.wires[0].least("vegetation")
    assert (least is not None) == counts
    if least is not None:
        assert least.distance_m == pytest.approx(9.0, abs=0.05)


@pytest.mark.parametrize(("along_m", "aside_m", "below_m", "counts"), [
    (1.0, 6.0, 2.0, False), (1.0, 6.0, -2.0, False), (2.0, 6.0, 2.0, True), (1.0, 11.0, 2.0, True),
    (1.0, 6.0, 4.0, True),
])  # fmt: skip
def test_what_may_be_a_crossarm_has_no_verdict(
    along_m: float, aside_m: float, below_m: float, counts: bool
) -> None:
    wire = fitted(WIRE)
    base, held = wire.base, wire.points(np.array([wire.base.length_m]))[0]
    wire = replace(wire, ends=(wire.ends[0], Attached(2, held, 0.05)))
    plant = held + np.array([*(aside_m * base.n - along_m * base.u), -below_m])
    survey = survey_of({HIGH_VEGETATION: plant[None]}, wire)
    nine, none = np.array([9]), np.array([0])
    survey = replace(survey, cloud=replace(survey.cloud, sigma_m=np.full(1, 0.05), seen=nine, past=none))
    found, findings = measure_clearances(survey, ClearanceConfig())
    assert (found.wires[0].least("vegetation") is not None) == counts
    assert [one.at_structure for one in found.possible] == [True] * (not counts)
    assert any("may be a part of it" in one.what for one in findings) != counts


@pytest.mark.parametrize(("seen_to_m", "beside_m", "counts"), [
    (70.0, (), False), (73.0, (), False), (74.0, (), True), (70.0, (73.0,), False), (70.0, (74.0,), True),
    (70.0, (0.0,), False), (70.0, (74.0, 70.0), False), (70.0, (74.0, 74.0), True),
    (70.0, (74.0, 0.0), True),
])  # fmt: skip
def test_what_half_of_the_wires_are_seen_to_pass_is_no_structure(
    seen_to_m: float, beside_m: tuple[float, ...], counts: bool
) -> None:
    """A plant at 72 m: it counts where half of the wires, that one and those beside it, are seen for 1.5 m
    beyond it; of a wire that no image is known to show (0) the curve goes on, but says nothing."""

    def seen_to(wire: Wire, end_m: float) -> Wire:
        evidence = replace(wire.evidence, seen_m=((0.0, end_m),) if end_m else ())
        return replace(wire, ends=(wire.ends[0], Open("nothing")), evidence=evidence)

    wire = fitted(WIRE)
    across = np.array([6.0, 6.0, 0.0, 0.0, 0.0, 0.0])
    beside = [replace(wire, id=2 + k, theta=wire.theta + (k + 1) * across) for k in range(len(beside_m))]
    wires = [seen_to(one, end_m) for one, end_m in zip([wire, *beside], (seen_to_m, *beside_m), strict=True)]
    plants = wire.points(np.array([72.0, 40.0])) - np.array([[0.0, 0.0, 1.5], [0.0, 0.0, 4.0]])
    survey = replace(survey_of({HIGH_VEGETATION: plants}), lines=(line_of(wires),))
    nine, none = np.array([9, 9]), np.array([0, 0])
    survey = replace(survey, cloud=replace(survey.cloud, sigma_m=np.full(2, 0.05), seen=nine, past=none))
    found, _ = measure_clearances(survey, ClearanceConfig())
    least = found.wires[0].least("vegetation")
    assert least is not None and least.distance_m == pytest.approx(1.5 if counts else 4.0, abs=0.05)
    assert [one.at_open_end for one in found.possible] == [True] * (not counts)


@pytest.mark.parametrize(("grey", "along_m", "counts"), [
    (False, 5.0, True), (True, 5.0, False), (True, 9.0, True), (False, 3.0, False), (True, -2.0, True),
])  # fmt: skip
def test_what_is_not_green_beyond_an_open_end_may_be_a_structure_at_twice_the_distance(
    grey: bool, along_m: float, counts: bool
) -> None:
    """Two wires end at 60 m; the curve of the third goes on past the thing, 6 m beside it."""
    wire, loose = fitted(WIRE), Open("nothing")
    ends = [replace(wire.evidence, seen_m=((0.0, end_m),)) for end_m in (60.0, 60.0, wire.base.length_m)]
    across = np.array([6.0, 6.0, 0.0, 0.0, 0.0, 0.0])
    wires = [
        replace(wire, id=1 + k, theta=wire.theta + k * across, ends=(wire.ends[0], loose), evidence=end)
        for k, end in enumerate(ends)
    ]
    wires = [wires[0].between(0.0, 60.0), wires[1].between(0.0, 60.0), wires[2]]
    place = wire.points(np.array([60.0 + along_m]))
    plants = np.repeat(place, 3, 0) + np.array([[0.0, 6.0, -2.0], [0.0, 6.1, -2.0], [0.0, 6.2, -2.0]])
    survey = replace(survey_of({HIGH_VEGETATION: plants}), lines=(line_of(wires),))
    colours = np.tile((90, 90, 90) if grey else (60, 120, 50), (3, 1)).astype(np.uint8)
    nine, none = np.full(3, 9), np.zeros(3, int)
    cloud = replace(survey.cloud, sigma_m=np.full(3, 0.05), seen=nine, past=none, rgb=colours)
    found, _ = measure_clearances(replace(survey, cloud=cloud), ClearanceConfig())
    assert (found.wires[2].least("vegetation") is not None) == counts


def test_what_is_no_nearer_than_what_counts_is_not_listed() -> None:
    """Farther away, or nearer by less than both may be off, or more than are to be listed."""
    assert measure_clearances(judged([1, 9], [0, 0], [6.0, 4.0]), ClearanceConfig())[0].possible == ()
    assert measure_clearances(judged([1, 9], [0, 0], [3.95, 4.0]), ClearanceConfig())[0].possible == ()
    few = ClearanceConfig(obstacles=ObstacleConfig(max_possible=0))
    assert measure_clearances(judged([1, 9], [0, 0], [1.0, 4.0]), few)[0].possible == ()


def test_wires_ground_and_noise_are_not_judged() -> None:
    one = {HIGH_VEGETATION: [[0.0, 0, 6]], GROUND: [[0.0, 0, 0]], NOISE: [[0.0, 0, 9]]}
    survey = survey_of({label: np.array(places) for label, places in one.items()})
    found = with_witnesses(survey.cloud, [sight(above(0.0))], CONFIG)
    assert found.seen is not None and found.past is not None
    by_label = dict(zip(found.label.tolist(), zip(found.seen, found.past, strict=True), strict=True))
    assert by_label == {HIGH_VEGETATION: (0, 1), GROUND: (NOT_JUDGED,) * 2, NOISE: (NOT_JUDGED,) * 2}
    assert with_witnesses(survey.cloud, [], CONFIG).seen is None


def covered(ground_to: float = 1e9) -> Survey:
    """A wire with ground below it, up to a station."""
    wire = fitted(WIRE)
    floor = float(wire.points(np.linspace(0, wire.base.length_m, 50))[:, 2].min()) - 8.0
    along, across = np.arange(0, wire.base.length_m, 1.0), np.arange(-8, 8.5, 1.0)
    s, y = (one.ravel() for one in np.meshgrid(along, across))
    ground = wire.base.place(s, np.stack([y, np.full(len(y), floor)], 1))[s <= ground_to]
    return survey_of({GROUND: ground}, wire)


def flown(survey: Survey, each: int = 3) -> list[Sight]:
    """Images of the floor along the wire, `each` at a place."""
    (wire,) = survey.wires
    floor = float(survey.cloud.xyz[:, 2].min())
    places = wire.points(np.arange(0.0, wire.base.length_m + 1, 5.0))
    return [sight(above(*place[:2], floor + 40.0), floor) for place in places for _ in range(each)]


def test_all_is_seen_where_images_show_ground_and_air() -> None:
    survey = covered()
    (one,) = coverage_of(survey, flown(survey), CoverageConfig())
    assert (one.ground > 0.99).all() and (one.air > 0.9).all() and one.silent == ()
    assert one.from_m[0] == 0 and one.length_m == pytest.approx(survey.wires[0].base.length_m)
    assert about_coverage([one], several_lines=False) == []


def test_ground_without_points_is_not_seen() -> None:
    survey = covered(ground_to=20.0)
    (one,) = coverage_of(survey, flown(survey), CoverageConfig())
    assert not one.no_ground[one.to_m <= 19].any() and one.no_ground[one.from_m >= 22].all()
    ((begin, end),) = one.silent
    assert 18 <= begin <= 23 and end == one.to_m[-1]
    (finding,) = about_coverage([one], several_lines=False)
    assert f"{begin:.0f} to {end:.0f} m" in finding.what and finding.degree == "harms"


def test_air_that_too_few_images_see_is_not_seen() -> None:
    """Two images everywhere are too few; without images nothing is stated of the air."""
    survey = covered()
    (one,) = coverage_of(survey, flown(survey, each=1)[:1], CoverageConfig())
    assert one.no_air.any() and not one.no_ground.any()
    (laser,) = coverage_of(survey, [], CoverageConfig())
    assert np.isnan(laser.air).all() and laser.silent == () and (laser.ground > 0.99).all()


def test_without_scale_there_is_no_coverage() -> None:
    survey = covered()
    unscaled = replace(survey, frame=replace(survey.frame, unit="unscaled"))
    assert coverage_of(unscaled, [], CoverageConfig()) == ()


def test_settings_that_mean_nothing_are_refused() -> None:
    with pytest.raises(ConfigError, match="window_cells"):
        WitnessConfig(window_cells=-1)
    with pytest.raises(ConfigError, match="min_share"):
        WitnessConfig(min_share=0.7)
    with pytest.raises(ConfigError, match="step_m"):
        CoverageConfig(step_m=0.0)
    with pytest.raises(ConfigError, match="least_share"):
        CoverageConfig(least_share=2.0)
    with pytest.raises(ConfigError, match="min_seen"):
        ObstacleConfig(min_seen=0)


def test_views_that_may_see_nothing_of_a_place_are_not_asked_and_change_nothing(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Points along a line past a camera and in a ring around it, in parts: all that it sees are judged."""
    view = View(np.eye(3), np.zeros(3), np.full(2, 40.0), np.array([32.0, 24.0]), np.zeros(5), 64, 48)
    sight = Sight.of(view, DepthMap(np.full((48, 64), 9.0), np.full((48, 64), 0.1)))
    turn = np.linspace(0, 2 * np.pi, 4000, endpoint=False)
    ring = np.column_stack([5 * np.sin(turn), 0.1 * np.cos(7 * turn), 5 * np.cos(turn)])
    line = np.column_stack([np.linspace(-60, 60, 4000), 0.0 * turn, 5.0 + 0.0 * turn])
    points = np.random.default_rng(0).permutation(np.concatenate([ring, line]))
    monkeypatch.setattr(witnesses_of, "CHUNK", 37)
    found = witnesses(points, np.zeros(len(points)), [sight], CONFIG)
    inside = view.project(points)[1]
    assert np.array_equal(found[1] == 1, inside) and 0 < inside.mean() < 0.5
    asked, judge = list[int](), witnesses_of.judged

    def counted(part: np.ndarray, *rest: object) -> object:
        asked.append(len(part))
        return judge(part, *rest)

    monkeypatch.setattr(witnesses_of, "judged", counted)
    witnesses(line, np.zeros(len(line)), [sight], CONFIG)
    assert 37 * len(asked) < 0.2 * len(line)
