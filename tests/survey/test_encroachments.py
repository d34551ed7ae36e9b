"""Each object that comes too near is one record, with every way in which it does; nothing else is listed."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from plnerf.errors import ConfigError
from plnerf.line.cloud import BUILDING, GROUND, HIGH_VEGETATION, Cloud
from plnerf.line.encroachments import Encroachment, Encroachments
from plnerf.line.ends import Attached, Quantity
from plnerf.line.files import read_survey, write_survey_json
from plnerf.line.frame import LineFrame
from plnerf.line.hang import hang
from plnerf.line.line import Line, Span, Structure
from plnerf.line.states import Load, State, States, WireState
from plnerf.line.survey import Survey
from plnerf.survey.clearance import measure_clearances
from plnerf.survey.config_encroachments import EncroachmentConfig
from plnerf.survey.config_ground import ClearanceConfig
from plnerf.survey.config_rules import RulesConfig
from plnerf.survey.encroachments import find_encroachments
from plnerf.survey.single_objects import dense_groups, outline_of, separated, wire_like

FRAME = LineFrame(np.eye(3), 1.0, np.zeros(3), "m", "EPSG:25832")
SPREAD = np.diag([0.05, 0.05, 0.04, 0.04, 0.02, 0.0]) ** 2
CLEARANCE = ClearanceConfig(clearance_m=3.0)
GROWING = EncroachmentConfig(growth_m=0.5, growth_years=4.0, growth_sigma=0.1)
STORM = Load("storm", 5.0, 500.0)
PLACES = {
    "too near": (60.0, 0.5, 9.0, 1.5), "grows": (100.0, 0.0, 6.2, 1.5), "falls": (140.0, 15.0, 20.5, 1.5),
    "in the storm": (100.0, 5.8, 10.2, 1.0), "clear": (160.0, 20.0, 9.0, 1.5), "bush": (80.0, 1.0, 1.5, 1.0),
}  # fmt: skip
"""Along and across the wire, height and radius of trees below a wire that hangs from 15 m down to 10 m."""


def crown(x: float, y: float, height: float, radius: float, count: int = 1500) -> np.ndarray:
    """Points on and in the upper 0.6 of a tree, dense to its outside."""
    random = np.random.default_rng(int(10 * x + y))
    at = random.normal(size=(count, 3))
    at /= np.linalg.norm(at, axis=1, keepdims=True)
    low = 0.4 * height
    return np.array([x, y, (low + height) / 2]) + at * [radius, radius, (height - low) / 2]


@cache
def survey() -> Survey:
    """A wire of 200 m with a storm that swings it by 45 degrees, over flat ground, trees and a house."""
    ends = Attached(1, np.array([0, 0, 15.0]), 0.05), Attached(2, np.array([200.0, 0, 15]), 0.05)
    wire = replace(hang(ends[0].point, ends[1].point, 5.0, id=1, kind="phase"), ends=ends, covariance=SPREAD)
    masts = tuple(Structure(k, end.point * [1, 1, 0], 18.0, 0.1, "") for k, end in enumerate(ends, 1))
    ground = np.stack(np.meshgrid(np.arange(-10, 211, 1.5), np.arange(-45, 46, 1.5)), -1).reshape(-1, 2)
    x, y = np.meshgrid(np.arange(118, 124.1, 0.25), np.arange(-4, 2.1, 0.25))
    parts = {
        GROUND: np.column_stack([ground, np.zeros(len(ground))]),
        HIGH_VEGETATION: np.concatenate([crown(*one) for one in PLACES.values()]),
        BUILDING: np.column_stack([x.ravel(), y.ravel(), np.full(x.size, 8.0)]),
    }
    label = np.concatenate([np.full(len(one), code, np.uint8) for code, one in parts.items()])
    cloud = Cloud(np.concatenate(list(parts.values())), label, np.zeros(len(label), np.int64))
    line = Line(1, masts, (Span(1, (1, 2), (wire,)),))
    found = Survey(FRAME, (line,), cloud, "made up")
    clearances, _ = measure_clearances(found, CLEARANCE)
    theta = wire.theta + np.array([0, 0, 0, 0, 0, np.pi / 4])
    q = Quantity(5.0, 0.05)
    blown = State(STORM, (WireState(1, theta, SPREAD, q, q, q, q, None, 200.0),))
    return replace(found, clearances=clearances, states=States((blown,), Quantity(20.0, 3.0), "given", ()))


def records(of: Survey, config: EncroachmentConfig = GROWING) -> dict[str, Encroachment]:
    """By what was planted where they are; two of one place, or one of none, fail."""
    found = find_encroachments(of, [], CLEARANCE, RulesConfig(), config)
    assert found is not None
    named: dict[str, Encroachment] = {}
    for one in found.records:
        near = [name for name, (x, y, *_) in PLACES.items() if np.hypot(*(one.highest[:2] - [x, y])) < 2]
        name = "house" if one.object == "building" else near[0]
        assert name not in named
        named[name] = one
    return named


def test_every_object_too_near_is_one_record_and_nothing_else_is_listed() -> None:
    named = records(survey())
    assert named.keys() == {"too near", "grows", "falls", "in the storm", "house"}
    ways = {name: one.ways for name, one in named.items()}
    assert ways["too near"][0] == ways["house"][0] == "as surveyed"
    assert ways["grows"] == ("grow-in",) and ways["falls"] == ("fall-in",)
    assert ways["in the storm"][0] == "blow-out" and "as surveyed" not in ways["in the storm"]
    assert [one.id for one in sorted(named.values(), key=lambda one: one.priority)] == [1, 2, 3, 4, 5]
    assert named["falls"].priority == 3 and named["in the storm"].priority == 2


def test_distances_are_those_of_the_bodies() -> None:
    named = records(survey())
    house = named["house"]  # its edge is right below the wire, at 8 m, where that hangs at 10.2 m
    assert house.vertical.value == pytest.approx(house.on_wire[2] - 8.0, abs=1e-6)
    assert house.radial.value == pytest.approx(house.vertical.value, abs=0.05)
    assert house.outline.min(0) == pytest.approx([118, -4])
    assert house.outline.max(0) == pytest.approx([124, 2])
    assert house.height_m == pytest.approx(8.0, abs=0.01)
    fall = named["falls"].first
    foot, place = np.array([140.0, 15.0, 0.0]), fall.on_wire
    assert fall.distance.value == pytest.approx(np.linalg.norm(place - foot) - 20.5, abs=0.25)
    assert fall.on_object == pytest.approx(foot, abs=0.2)
    assert fall.distance.sigma > 0.3  # the stem is not seen
    grows = named["grows"].first
    assert grows.distance.value == pytest.approx(named["grows"].radial.value - 2.0, abs=1e-4)
    assert grows.years is not None
    assert grows.years.value == pytest.approx((named["grows"].radial.value - 3.0) / 0.5, abs=1e-4)
    assert grows.distance.sigma > named["grows"].radial.sigma


def test_what_is_not_known_is_said_and_not_guessed() -> None:
    calm = replace(survey(), states=None)
    found = find_encroachments(calm, [], CLEARANCE, RulesConfig(), EncroachmentConfig())
    assert found is not None
    said = " ".join(found.not_examined)
    assert "Blow-out" in said and "Growth" in said and "sag" in said
    assert {one.first.way for one in found.records} == {"as surveyed", "fall-in"}
    label = np.where(calm.cloud.label == GROUND, np.uint8(18), calm.cloud.label)
    bare = replace(calm, cloud=replace(calm.cloud, label=label))
    found = find_encroachments(bare, [], CLEARANCE, RulesConfig(), EncroachmentConfig())
    assert found is not None and "no ground is known below them" in " ".join(found.not_examined)
    assert "fall-in" not in {one.first.way for one in found.records}
    free = replace(calm, clearances=None)
    assert find_encroachments(free, [], ClearanceConfig(), RulesConfig(), EncroachmentConfig()) is None


def test_scattered_points_of_images_are_no_plants() -> None:
    """A dozen wrong matches in the air would be a tree as high as the highest of them."""
    one, random = survey(), np.random.default_rng(4)
    wrong = np.array([40.0, -3.0, 0.0]) + random.uniform([-1, -1, 1], [1, 1, 12], (12, 3))
    cloud = one.cloud
    n = len(cloud.xyz) + len(wrong)
    known = Cloud(
        np.concatenate([cloud.xyz, wrong]),
        np.concatenate([cloud.label, np.full(len(wrong), HIGH_VEGETATION, np.uint8)]), np.zeros(n, np.int64),
    )  # fmt: skip
    seen = replace(
        known, sigma_m=np.full(n, 0.1), seen=np.full(n, 6), past=np.zeros(n, np.int64)
    )  # fmt: skip
    of_laser, of_images = (
        find_encroachments(replace(one, cloud=each), [], CLEARANCE, RulesConfig(), GROWING)
        for each in (known, seen)
    )
    assert of_laser is not None and of_images is not None
    assert len(of_laser.records) > len(of_images.records) == len(records(one))
    assert any("scattered" in text for text in of_images.not_examined)
    assert not any("scattered" in text for text in of_laser.not_examined)


def test_a_few_points_beside_a_crown_are_no_plant() -> None:
    """Those of the crown are none of theirs."""
    tree, random = crown(0.0, 0.0, 12.0, 1.5), np.random.default_rng(1)
    few = random.uniform([2.0, -0.3, 2.0], [2.6, 0.3, 13.0], (14, 3))
    number = np.repeat([1, 0], [len(few), len(tree)])
    xyz = np.concatenate([few, tree])
    assert dense_groups(xyz, number, 1.2, EncroachmentConfig()).tolist() == [True, False]
    assert dense_groups(few, 0 * number[:14], 1.2, replace(GROWING, min_around=3)).tolist() == [True]


def test_a_wire_that_was_not_found_is_no_plant() -> None:
    """Bushes in a row are as narrow and level, but on the ground; below a crown's top is the crown."""
    random = np.random.default_rng(2)
    along = np.column_stack([random.uniform(0, 8, 60), random.normal(0, 0.2, 60), random.normal(0, 0.2, 60)])
    hanging, bushes = along + np.array([0.0, 0.0, 30.0]), along + np.array([0.0, 20.0, 1.2])
    tree = crown(40.0, 0.0, 30.0, 1.5)
    xyz = np.concatenate([hanging, bushes, tree[tree[:, 2] >= 25], tree[tree[:, 2] < 25]])
    parts = [len(hanging), len(bushes), int((tree[:, 2] >= 25).sum()), int((tree[:, 2] < 25).sum())]
    assert wire_like(xyz, xyz[:, 2], np.repeat(range(4), parts)).tolist() == [True, False, False, False]
    assert wire_like(xyz[:0], xyz[:0, 2], np.zeros(0, np.int64)).tolist() == []


def test_a_file_gives_them_back(tmp_path) -> None:
    found = find_encroachments(survey(), [], CLEARANCE, RulesConfig(), GROWING)
    write_survey_json(tmp_path / "survey.json", replace(survey(), encroachments=found))
    back = read_survey(tmp_path / "survey.json").encroachments
    assert isinstance(back, Encroachments) and found is not None and len(back.records) == 5
    for one, other in zip(found.records, back.records, strict=True):
        assert one.ways == other.ways and one.first.years == other.first.years
        assert np.array_equal(one.outline, other.outline) and np.array_equal(one.highest, other.highest)
        assert one.radial == other.radial and one.first.distance == other.first.distance


def test_crowns_that_touch_are_apart_and_one_crown_is_one() -> None:
    two = np.concatenate([crown(0, 0, 10, 2.0), crown(4.7, 0, 9, 2.0)])
    number = separated(two, two[:, 2], EncroachmentConfig())
    assert len(set(number)) == 2 and (number[two[:, 0] < 2.1] == number[0]).all()
    rough = crown(0, 0, 10, 2.5) + np.random.default_rng(0).normal(0, 0.2, (1500, 3))
    assert len(set(separated(rough, rough[:, 2], EncroachmentConfig()))) == 1
    box = np.random.default_rng(1).uniform(0, 4, (400, 3))
    boxes = np.concatenate([box + np.array([k * 7, 0, 0]) for k in range(3)])
    assert len(set(separated(boxes, None, EncroachmentConfig()))) == 3


def test_an_outline_is_convex_and_of_few_points_a_square() -> None:
    points = np.random.default_rng(2).normal(size=(60, 3))
    corners = outline_of(points)
    edges = np.roll(corners, -1, 0) - corners
    following = np.roll(edges, -1, 0)
    assert (edges[:, 0] * following[:, 1] > edges[:, 1] * following[:, 0]).all()
    assert outline_of(points[:1]).shape == (4, 2)


def test_settings_that_cannot_be_are_refused() -> None:
    for growth in (-1.0, float("nan"), float("inf")):
        with pytest.raises(ConfigError, match="growth_m of 0 or more"):
            EncroachmentConfig(growth_m=growth)
    with pytest.raises(ConfigError, match="growth_years"):
        EncroachmentConfig(growth_sigma=float("nan"))
    with pytest.raises(ConfigError, match="cell_m"):
        EncroachmentConfig(cell_m=0.0)
    with pytest.raises(ConfigError, match="around_m"):
        EncroachmentConfig(around_m=0.0)
