"""Buildings and straight things are no plants, plants stay plants, and given classes count on request."""

import numpy as np
import pytest
from tests.support import lidar_clouds as made

from plnerf.errors import ConfigError
from plnerf.line.cloud import BUILDING, GROUND, HIGH_VEGETATION, LOW_NOISE, NO_WIRE, NOISE, UNCLASSIFIED
from plnerf.survey.lidar.config import LidarConfig
from plnerf.survey.lidar.config_things import ThingsConfig
from plnerf.survey.lidar.find import Found, find_lines
from plnerf.survey.lidar.things import under_roofs

HOUSE, BOOM = np.array([45.0, -20.0]), np.array([70.0, 20.0])
FEW, MANY = np.array([60.0, 31.0]), np.array([88.0, -18.0])
PLANTS = [3, 4, 5]


def house(random: np.random.Generator, at: np.ndarray, per_m2: float = 8.0) -> tuple[np.ndarray, np.ndarray]:
    """Roof and walls, 12 m by 8 m: eaves at 5 m, ridge at 7.5 m above the lowest ground."""
    xy = random.uniform([-6.0, -4.0], [6.0, 4.0], (int(96 * per_m2), 2))
    foot = made.relief(at[None])[0]
    roof = np.column_stack([at + xy, foot + 7.5 - 2.5 * np.abs(xy[:, 1]) / 4.0])
    side = random.choice([-4.0, 4.0], 300)
    along, up = random.uniform([-6.0, 1.0], [6.0, 5.0], (300, 2)).T
    wall = np.column_stack([at[0] + along, at[1] + side, foot + up])
    return roof + 0.03 * random.normal(size=roof.shape), wall + 0.03 * random.normal(size=wall.shape)


@pytest.fixture(scope="module")
def line() -> made.Line:
    """A span, trees, a house (6), and a boom that rises from 4 to 9 m over 14 m (26)."""
    random = np.random.default_rng(3)
    built = made.line(np.array([[0.0, 0.0], [110.0, 20.0]]))
    for part in house(random, HOUSE):
        built.add(part, 6)
    foot = np.append(BOOM, made.relief(BOOM[None])[0])
    ends = (foot + np.array([[0.0, 0.0, 4.0], [13.0, 0.0, 9.0]]))[None]
    built.add(made.bars(ends, 12.0, 0.06, random), 26)
    for place, up, count, code in ((FEW, 15.0, 6, 18), (MANY, 15.0, 60, 45), (MANY, -4.0, 3, 7)):
        foot = np.append(place, made.relief(place[None])[0] + up)
        points = foot + random.uniform(-1.5, 1.5, (count, 3))
        built.add(points[:2] if code == 18 else points, code)
    return built


@pytest.fixture(scope="module")
def found(line: made.Line) -> Found:
    return find_lines(line.xyz, LidarConfig())


def test_roofs_and_what_is_under_them_are_buildings_and_trees_are_none(line: made.Line, found: Found) -> None:
    label, truth = found.cloud.label, line.truth
    roof = (truth == 6) & (line.xyz[:, 2] > made.relief(HOUSE[None])[0] + 4.9)
    assert (label[roof] == BUILDING).mean() > 0.99
    assert (label[truth == 6] == BUILDING).mean() > 0.95
    assert not (label[truth == 5] == BUILDING).any() and np.isin(label[truth == 5], PLANTS).mean() > 0.98
    assert (label[truth == 2] == GROUND).mean() > 0.97


@pytest.mark.parametrize("shift_m", [0.0, 0.2, 0.4, 0.6, 0.8])
def test_a_house_is_one_wherever_the_squares_begin(shift_m: float) -> None:
    """Of a roof 4 m wide 2.5 m were flat, three squares of a metre or two: a third of it to all was found."""
    random = np.random.default_rng(7)
    parts = np.concatenate(house(random, HOUSE)) + np.array([shift_m, -shift_m, 0.0])
    above = parts[:, 2] - made.relief(HOUSE[None])[0]
    assert under_roofs(parts, above, LidarConfig().things).mean() > 0.98


def test_few_points_high_in_the_air_and_below_the_ground_are_noise(line: made.Line, found: Found) -> None:
    """They were plants: strays of a wire that was not followed came nearest to all other wires."""
    label, truth = found.cloud.label, line.truth
    assert (label[truth == 18] == NOISE).all() and (label[truth == 7] == LOW_NOISE).all()
    assert np.isin(label[truth == 45], PLANTS).all()
    standing = truth == 5
    assert not (label[standing] == NOISE).any()


def test_what_is_straight_over_metres_is_no_plant(line: made.Line, found: Found) -> None:
    boom = line.truth == 26
    assert (found.cloud.label[boom] == UNCLASSIFIED).mean() > 0.95
    long = find_lines(line.xyz, LidarConfig(things=ThingsConfig(straight_m=20.0)))
    assert np.isin(long.cloud.label[boom], PLANTS).mean() > 0.95


def test_a_boom_is_one_through_a_crown_and_over_a_roof() -> None:
    """Its half beyond a crown was a plant, and its end over a roof a building; a crown alone has no booms."""
    random = np.random.default_rng(6)
    built = made.line(np.array([[0.0, 0.0], [110.0, 20.0]]))
    for part in house(random, HOUSE):
        built.add(part, 6)
    foot = np.append(HOUSE + np.array([3.0, 0.0]), made.relief(HOUSE[None])[0])
    boom = made.bars((foot + np.array([[0.0, 0.0, 7.6], [16.0, 0.0, 8.6]]))[None], 7.0, 0.06, random)
    built.add(boom, 26)
    crown = foot + np.array([11.5, 0.0, 8.0]) + random.uniform(-1.6, 1.6, (260, 3))
    built.add(crown, 5)
    label = find_lines(built.xyz, LidarConfig()).cloud.label
    assert (label[built.truth == 26] == UNCLASSIFIED).mean() > 0.98
    assert np.isin(label[len(built.xyz) - len(crown) :], PLANTS).mean() > 0.85, "but for what is on its axis"
    roof = (built.truth == 6) & (built.xyz[:, 2] > foot[2] + 4.9)
    assert (label[roof] == BUILDING).mean() > 0.97


@pytest.mark.parametrize("setting", [{"min_roof_m2": 120.0}, {"max_rms_m": 0.005}, {"roof_from_m": 9.0}])
def test_settings_decide_what_is_a_roof(setting: dict[str, float], line: made.Line) -> None:
    label = find_lines(line.xyz, LidarConfig(things=ThingsConfig(**setting))).cloud.label
    assert np.isin(label[line.truth == 6], PLANTS).mean() > 0.9


def test_a_rough_crown_as_wide_as_a_house_is_no_building() -> None:
    """A hedge top and a dense canopy, sampled from above: 0.25 m of roughness over 12 m by 12 m."""
    random = np.random.default_rng(4)
    built = made.line(np.array([[0.0, 0.0], [110.0, 20.0]]))
    xy = HOUSE + random.uniform(-6, 6, (1500, 2))
    wave = 0.25 * np.sin(3 * xy[:, 0]) * np.sin(3 * xy[:, 1])
    canopy = np.column_stack([xy, made.relief(HOUSE[None])[0] + 6 + wave + 0.1 * random.normal(size=1500)])
    built.add(canopy, 5)
    label = find_lines(built.xyz, LidarConfig()).cloud.label
    assert (label[built.truth == 5] != BUILDING).all()
    assert np.isin(label[built.truth == 5], PLANTS).mean() > 0.98


def test_classes_of_the_file_count_on_request(line: made.Line, found: Found) -> None:
    """Water, buildings and further classes stay so; noise takes no part; wires are found as before."""
    given = line.truth.astype(np.uint8)
    given[np.isin(given, [13, 14, 15])] = 1  # they are found, not read
    low = (line.truth == 2) & (np.linalg.norm(line.xyz[:, :2] - np.array([20.0, 30.0]), axis=1) < 8)
    given[low] = 9
    given[np.flatnonzero(given == 5)[::7]] = 0  # left open: by its height and shape
    birds = np.random.default_rng(5).uniform([0, -9, 60], [110, 30, 61], (400, 3))
    xyz = np.concatenate([line.xyz, birds])
    classes = np.append(given, np.full(400, NOISE, np.uint8))
    used = find_lines(xyz, LidarConfig(), given=classes)
    label = used.cloud.label[: len(given)]
    assert (used.cloud.label[len(given) :] == NOISE).all()
    wires, before = ([wire for one in some.lines for wire in one.wires] for some in (used, found))
    assert len(wires) == len(before) == len(line.wires)
    free = ~np.isin(line.truth, [13, 14, 15]) & (used.cloud.wire[: len(given)] == NO_WIRE) & (label != 15)
    for code in (2, 6, 9, 26):
        assert (label[free & (given == code)] == code).all()
    assert (label[free & (given == 5)] == HIGH_VEGETATION).all()
    assert np.isin(label[free & (given == 0) & (line.truth == 5)], PLANTS).mean() > 0.98


def test_settings_of_things_are_checked() -> None:
    with pytest.raises(ConfigError, match=r"3 <= min_neighbours <= neighbours, but got .*min_neighbours=30"):
        ThingsConfig(min_neighbours=30)
