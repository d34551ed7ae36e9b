"""Conductors and supports of clouds without classes: all that are there, nothing that is not."""

from pathlib import Path

import laspy
import lidar_clouds as made
import numpy as np
import pytest
from scipy.spatial import cKDTree

from plnerf.errors import SurveyError
from plnerf.line.catenary import Catenary
from plnerf.survey.lidar.checks import distinct
from plnerf.survey.lidar.find import Found, find_conductors
from plnerf.survey.model import (
    CONDUCTOR,
    GROUND,
    HIGH_VEGETATION,
    LOW_VEGETATION,
    NO_WIRE,
    SHIELD,
    TOWER,
    UNCLASSIFIED,
    VEGETATION,
    Conductor,
)

FEET = np.array([[0.0, 0.0], [110.0, 20.0], [215.0, 70.0]])
"""A line that bends by 15 degrees."""


@pytest.fixture(scope="module")
def line() -> made.Line:
    return made.line(FEET)


@pytest.fixture(scope="module")
def found(line: made.Line) -> Found:
    return find_conductors(line.xyz)


def apart(one: Conductor, wire: Catenary) -> float:
    """Greatest distance of a found curve from a true wire, but for the last metre at its ends."""
    points = one.fit.curve.points(np.linspace(1, one.fit.curve.span_m - 1, 50))
    return float(cKDTree(wire.polyline(0.01)).query(points)[0].max())


def matched(found: Found, wires: list[Catenary]) -> dict[int, tuple[Conductor, float]]:
    """For each true wire the conductor that is nearest to it, each at most once."""
    pairs: dict[int, tuple[Conductor, float]] = {}
    for conductor in found.conductors:
        off = [apart(conductor, wire) for wire in wires]
        k = int(np.argmin(off))
        assert k not in pairs, f"conductors {pairs[k][0].id} and {conductor.id} are both wire {k}"
        pairs[k] = conductor, off[k]
    return pairs


def test_every_wire_of_a_line_is_found_once(line: made.Line, found: Found) -> None:
    pairs = matched(found, line.wires)
    assert len(pairs) == len(line.wires) == 14
    for k, (conductor, off) in pairs.items():
        curve, wire = conductor.fit.curve, line.wires[k]
        assert off < 0.06
        assert conductor.kind == line.kinds[k]
        assert curve.sag_m == pytest.approx(wire.sag_m, abs=0.03)
        assert curve.length_m == pytest.approx(wire.length_m, abs=1.0)  # from support to support
        assert conductor.coverage > 0.9 and conductor.note is None
        assert conductor.fit.residual_across_m < 0.04 and conductor.fit.residual_up_m < 0.04
    assert [c.id for c in found.conductors] == list(range(1, 15))
    assert [c.span for c in found.conductors] == [0] * 7 + [1] * 7
    assert found.notes == ()


def test_supports_stand_where_the_towers_do(line: made.Line, found: Found) -> None:
    assert len(found.towers) == 3
    for foot in line.feet:
        off = [np.linalg.norm(tower.foot - foot) for tower in found.towers]
        assert min(off) < 0.6
        assert found.towers[int(np.argmin(off))].height_m == pytest.approx(35, abs=0.7)


def test_points_are_labelled_as_what_they_are(line: made.Line, found: Found) -> None:
    label, truth = found.cloud.label, line.truth
    away = cKDTree(line.xyz[truth == 15]).query(line.xyz)[0] > 3.0  # of the towers, where wires are clamped
    for code, ours in ((14, CONDUCTOR), (13, SHIELD)):
        assert (label[(truth == code) & away] == ours).mean() > 0.97
        assert (truth[(label == ours) & away] == code).mean() > 0.999
    assert (label[truth == 2] == GROUND).mean() > 0.97
    assert (label[truth == 15] == TOWER).mean() > 0.9
    assert np.isin(label[truth == 5], [LOW_VEGETATION, VEGETATION, HIGH_VEGETATION]).mean() > 0.98
    assert ((found.cloud.wire != NO_WIRE) == np.isin(label, [CONDUCTOR, SHIELD])).all()
    pairs = {conductor.id: k for k, (conductor, _) in matched(found, line.wires).items()}
    on = (found.cloud.wire != NO_WIRE) & away
    named = np.array([pairs[name] for name in found.cloud.wire[on]])
    assert (named == line.owner[on]).mean() > 0.995  # of twins, each its own


def test_order_and_duplicates_change_nothing(line: made.Line, found: Found) -> None:
    order = np.random.default_rng(5).permutation(np.repeat(np.arange(len(line.xyz)), 2))
    again = find_conductors(line.xyz[order])
    assert (again.cloud.label == found.cloud.label[order]).all()
    assert (again.cloud.wire == found.cloud.wire[order]).all()
    for one, other in zip(found.conductors, again.conductors, strict=True):
        assert (one.fit.q == other.fit.q).all() and one.evidence == other.evidence
    assert [t.height_m for t in again.towers] == [t.height_m for t in found.towers]


def test_a_moved_line_is_found_moved(line: made.Line) -> None:
    c, s = np.cos(np.radians(131.0)), np.sin(np.radians(131.0))
    turn, shift = np.array([[c, -s, 0], [s, c, 0], [0, 0, 1]]), np.array([2e5, 5.7e6, 40.0])
    moved = find_conductors(line.xyz @ turn.T + shift)
    wires = []
    for wire in line.wires:
        a, b = np.array([wire.a, wire.b]) @ turn.T + shift
        wires.append(Catenary(tuple(a.tolist()), tuple(b.tolist()), wire.p_m))
    pairs = matched(moved, wires)
    assert len(pairs) == 14 and max(off for _, off in pairs.values()) < 0.07
    assert all(conductor.kind == line.kinds[k] for k, (conductor, _) in pairs.items())
    assert len(moved.towers) == 3


def test_level_spans_in_a_straight_line_are_told_apart(monkeypatch: pytest.MonkeyPatch) -> None:
    """The slope breaks by 6 % only, and the sag is 0.7 m."""
    monkeypatch.setattr(made, "relief", lambda xy: np.zeros(len(xy)))
    level = made.line(np.array([[0.0, 0.0], [90.0, 0.0], [180.0, 0.0]]), seed=1)
    found = find_conductors(level.xyz)
    pairs = matched(found, level.wires)
    assert len(pairs) == 14 and max(off for _, off in pairs.values()) < 0.06
    assert len(found.towers) == 3 and all(c.note is None for c in found.conductors)


def test_part_of_a_span_is_found_and_told(line: made.Line) -> None:
    part = line.xyz[(line.xyz[:, 0] > 45) & (line.xyz[:, 0] < 150)]
    found = find_conductors(part)
    assert len(found.towers) == 1 and len(matched(found, line.wires)) == 14
    for conductor in found.conductors:
        end = "first" if conductor.span == 0 else "last"
        assert conductor.note == f"The cloud ends at its {end} end: its support there is not seen."


def test_points_far_away_and_points_beside_wires_change_no_wire(line: made.Line, found: Found) -> None:
    """A file's places left at 0, 0; noise half a metre from a wire, and a branch that reaches it."""
    random, (a, b) = np.random.default_rng(2), line.xyz[line.owner == 4][:2]
    noise = np.add([a, b], [0.0, 0.0, 0.6])
    branch = line.xyz[line.owner == 3][9] + np.linspace([0, 0, -0.5], [0, 0, -4], 12)
    branch += 0.05 * random.normal(size=(12, 3))
    more = np.concatenate([line.xyz, noise, branch, np.full((3, 3), -2e5)])
    again = find_conductors(more)
    assert again.notes == ("3 points lie far away from the others in plan and are left out.",)
    pairs = matched(again, line.wires)
    assert len(pairs) == 14 and max(off for _, off in pairs.values()) < 0.06
    added = again.cloud.label[len(line.xyz) :]
    assert (added[:2] == UNCLASSIFIED).all() and (added[-3:] == UNCLASSIFIED).all()
    assert (added[2:14] == HIGH_VEGETATION).all()


def test_wires_alone_are_found(line: made.Line) -> None:
    found = find_conductors(line.xyz[np.isin(line.truth, [13, 14])])
    pairs = matched(found, line.wires)
    assert len(pairs) == 14 and max(off for _, off in pairs.values()) < 0.07
    assert "shows no ground" in found.notes[0]
    assert "1 of 1 towers by nothing but the wires that meet" in found.notes[1]
    assert not np.isin(found.cloud.label, [GROUND, LOW_VEGETATION, VEGETATION, HIGH_VEGETATION, TOWER]).any()


def test_nothing_else_is_a_wire() -> None:
    """A wood, a crane's boom and its jib, a bridge's rails, a fence, a house with its gutter and ridge."""
    random, cloud = np.random.default_rng(3), made.Line()
    made.ground(cloud, np.array([-60.0, -60.0]), np.array([160.0, 120.0]), random)
    for _ in range(25):
        made.tree(cloud, random.uniform([-50, 10], [90, 55]), random, random.uniform(6, 18))
    corners = np.array([[0, 0, 1], [0, 0.8, 1], [0, 0, 1.8], [0, 0.8, 1.8]])
    boom = np.stack([corners, np.add(corners, [22.0, 6.0, 16.0])], 1)
    cloud.add(made.bars(np.add(boom, [20, -30, 2]), 15.0, 0.02, random), 26)
    jib = np.array([[0, 0, 40.0], [0, 1.2, 40.0], [0, 0.6, 41.0]])
    cloud.add(made.bars(np.stack([jib, np.add(jib, [55.0, 10.0, 0.0])], 1), 12.0, 0.02, random), 26)
    rails = np.array([[[-50, y, 19.0], [90, y + 5, 19.0]] for y in (-25.0, -15.0)])
    cloud.add(made.bars(rails, 6.0, 0.02, random), 17)
    fence = np.array([[[-50, -20, z], [80, -20, z]] for z in (1.0, 1.5, 2.0)])
    fence[..., 2] += made.relief(fence[..., :2].reshape(-1, 2)).reshape(3, 2)
    cloud.add(made.bars(fence, 4.0, 0.02, random), 1)
    base = float(made.relief(np.array([[-30.0, -40.0]]))[0])
    across = random.uniform(-5, 5, 4000)
    roof = np.column_stack([random.uniform(-50, -12, 4000), -40 + across, base + 9 - 0.7 * np.abs(across)])
    cloud.add(roof, 6)
    gutters = np.array([[[-50, -40 + y, base + z], [-12, -40 + y, base + z]] for y, z in ((-5, 5.5), (0, 9))])
    cloud.add(made.bars(gutters, 6.0, 0.02, random), 6)
    found = find_conductors(cloud.xyz)
    assert found.conductors == () and found.towers == ()
    assert (found.cloud.wire == NO_WIRE).all() and not np.isin(found.cloud.label, [13, 14, 15]).any()
    assert len(found.notes) == 1 and "No wires were found: of " in found.notes[0]


def test_clouds_that_cannot_be_used_are_told(line: made.Line) -> None:
    with pytest.raises(SurveyError, match="The cloud holds no points"):
        find_conductors(np.empty((0, 3)))
    spoilt = line.xyz[:100].copy()
    spoilt[7, 2], spoilt[9, 0] = np.nan, np.inf
    with pytest.raises(SurveyError, match="2 of the cloud's 100 points have coordinates that are not finite"):
        find_conductors(spoilt)
    with pytest.raises(SurveyError, match=r"50000 points lie within 0 m of each other in plan"):
        find_conductors(np.tile([[5.0, 5.0, 5.0]], (50_000, 1)))
    degrees = line.xyz / [111_000.0, 111_000.0, 1.0] + [8.5, 47.2, 400.0]
    with pytest.raises(SurveyError, match=r"x \(8\..* to 8\..*\) and y \(47\..*\) look like degrees"):
        find_conductors(degrees)


def test_a_few_points_are_no_line() -> None:
    for count in (2, 5, 30):
        found = find_conductors(np.random.default_rng(count).uniform(0, 50, (count, 3)))
        assert found.conductors == () and len(found.cloud.label) == count and found.notes


def test_distinct_points_and_where_each_is() -> None:
    xyz = np.random.default_rng(1).integers(0, 3, (200, 3)).astype(float)
    points, which = distinct(xyz)
    assert (points[which] == xyz).all() and (points == np.unique(xyz, axis=0)).all()


@pytest.mark.data
@pytest.mark.parametrize(
    ("name", "conductors", "recall"), [("07CZ2_14.laz", 28, 0.99), ("12AN2_20.laz", 28, 0.98)]
)
def test_real_lines_are_found(shared_data: Path, name: str, conductors: int, recall: float) -> None:
    """The publisher's classes are the truth; they are used for nothing else."""
    cloud = laspy.read(shared_data / "lidar" / name)
    found = find_conductors(np.asarray(cloud.xyz))
    truth = np.asarray(cloud.classification)
    curves = np.concatenate([c.fit.curve.polyline(0.1) for c in found.conductors])
    assert (cKDTree(curves).query(cloud.xyz[truth == 14])[0] <= 0.25).mean() > recall
    assert len(found.conductors) == conductors and len(found.towers) == 1
    tower = cloud.xyz[truth == 15]
    assert np.linalg.norm(found.towers[0].foot[:2] - (tower.min(0) + tower.max(0))[:2] / 2) < 1.5
    labelled = found.cloud.wire != NO_WIRE
    near_tower = cKDTree(tower).query(cloud.xyz[labelled])[0] < 3.0
    assert (truth[labelled][~near_tower] == 14).mean() > 0.99
