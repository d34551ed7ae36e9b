"""Conductors and supports of clouds without classes: all that are there, nothing that is not."""

from pathlib import Path

import laspy
import numpy as np
import pytest
from scipy.spatial import cKDTree
from tests.support import lidar_clouds as made

from plnerf.errors import ConfigError, SurveyError
from plnerf.line.cloud import (
    CONDUCTOR,
    GROUND,
    HIGH_VEGETATION,
    LOW_VEGETATION,
    NO_WIRE,
    NOISE,
    SHIELD,
    TOWER,
    UNCLASSIFIED,
    VEGETATION,
)
from plnerf.line.ends import Attached, Open
from plnerf.line.frame import LineFrame
from plnerf.line.line import Structure
from plnerf.line.wire import Wire
from plnerf.survey.lidar.checks import distinct
from plnerf.survey.lidar.config import LidarConfig, SpanConfig, TrackConfig
from plnerf.survey.lidar.find import Found, find_lines

FEET = np.array([[0.0, 0.0], [110.0, 20.0], [215.0, 70.0]])
"""A line that bends by 15 degrees."""


CONFIG = LidarConfig()


def find(xyz: np.ndarray, config: LidarConfig = CONFIG) -> Found:
    return find_lines(xyz, config)


def wires_of(found: Found) -> list[Wire]:
    return [wire for line in found.lines for wire in line.wires]


def structures_of(found: Found) -> list[Structure]:
    return [structure for line in found.lines for structure in line.structures]


def texts(found: Found) -> list[str]:
    return [finding.text for finding in found.findings]


def sag_of(wire: Wire) -> float:
    sag = wire.sag
    assert sag is not None, wire.open
    return sag.value


@pytest.fixture(scope="module")
def line() -> made.Line:
    return made.line(FEET)


@pytest.fixture(scope="module")
def found(line: made.Line) -> Found:
    return find(line.xyz)


def apart(one: Wire, wire: Wire) -> float:
    """Greatest distance of a found curve from a true wire, but for the last metre at its ends."""
    points = one.points(np.linspace(1, one.base.length_m - 1, 50))
    return float(cKDTree(wire.polyline(0.01)).query(points)[0].max())


def matched(found: Found, wires: list[Wire]) -> dict[int, tuple[Wire, float]]:
    """For each true wire the found one that is nearest to it, each at most once."""
    pairs: dict[int, tuple[Wire, float]] = {}
    for one in wires_of(found):
        off = [apart(one, wire) for wire in wires]
        k = int(np.argmin(off))
        assert k not in pairs, f"wires {pairs[k][0].id} and {one.id} are both wire {k}"
        pairs[k] = one, off[k]
    return pairs


def test_every_wire_of_a_line_is_found_once(line: made.Line, found: Found) -> None:
    pairs = matched(found, line.wires)
    assert len(pairs) == len(line.wires) == 14
    for k, (one, off) in pairs.items():
        wire = line.wires[k]
        assert off < 0.06
        assert one.kind == wire.kind
        assert sag_of(one) == pytest.approx(sag_of(wire), abs=0.03)
        assert one.length_m == pytest.approx(wire.length_m, abs=1.0)  # from structure to structure
        assert one.evidence.coverage > 0.9 and one.notes == () and one.open is None
        assert one.evidence.residual_across_m < 0.04 and one.evidence.residual_up_m < 0.04
    assert [wire.id for wire in wires_of(found)] == list(range(1, 15))
    assert found.findings == ()


def test_wires_in_the_wind_are_followed(line: made.Line) -> None:
    """Phases swing by 8 degrees, shields by 16: upright curves would miss them by 15 cm."""
    windy = made.blown(line, 8.0)
    pairs = matched(find(windy.xyz), windy.wires)
    assert len(pairs) == len(windy.wires) == 14
    for k, (one, off) in pairs.items():
        wire = windy.wires[k]
        assert off < 0.06 and one.kind == wire.kind and one.notes == ()
        assert one.swing_deg is not None and wire.swing_deg is not None and one.swing_deg.sigma < 2
        turned = np.sign(one.base.u @ wire.base.u)
        assert abs(turned * one.swing_deg.value - wire.swing_deg.value) < 4 * one.swing_deg.sigma
        assert sag_of(one) == pytest.approx(sag_of(wire), abs=0.03)


def test_the_line_is_numbered_along_itself(line: made.Line, found: Found) -> None:
    (one,) = found.lines
    assert one.id == 1 and [s.id for s in one.structures] == [1, 2, 3] and [s.id for s in one.spans] == [1, 2]
    assert [span.structures for span in one.spans] == [(1, 2), (2, 3)]
    assert [len(span.wires) for span in one.spans] == [7, 7]
    assert (np.diff([structure.foot[0] for structure in one.structures]) > 50).all()
    for span in one.spans:
        across = [
            wire.points(np.array([wire.base.length_m / 2]))[0] @ [-0.3, 0.95, 0.0] for wire in span.wires
        ]
        assert across == sorted(across, reverse=True)  # from the left to the right


def test_wires_end_at_the_structures_that_hold_them(found: Found) -> None:
    feet = {structure.id: structure for structure in structures_of(found)}
    for span in found.lines[0].spans:
        for wire in span.wires:
            for end, structure, s in zip(wire.ends, span.structures, (0.0, wire.base.length_m), strict=True):
                assert isinstance(end, Attached) and end.structure == structure
                assert (end.point == wire.points(np.array([s]))[0]).all()
                assert feet[end.structure].sigma_m == CONFIG.structure.sigma_m
                clamped = wire.kind == "shield"
                assert end.sigma_m == getattr(CONFIG.structure, "clamped_sigma_m" if clamped else "sigma_m")
            span_m = np.linalg.norm(feet[span.structures[1]].foot[:2] - feet[span.structures[0]].foot[:2])
            assert wire.span_m is not None and wire.span_m.value == pytest.approx(span_m, abs=3.5)


def test_structures_stand_where_the_towers_do(line: made.Line, found: Found) -> None:
    structures = structures_of(found)
    assert len(structures) == 3
    for foot in line.feet:
        off = [np.linalg.norm(structure.foot - foot) for structure in structures]
        assert min(off) < 0.6
        assert structures[int(np.argmin(off))].height_m == pytest.approx(35, abs=0.7)
    assert all("points" in structure.evidence and structure.kind == "unknown" for structure in structures)
    a, b = np.diff(FEET, axis=0)
    bend = np.degrees(np.arccos(a @ b / np.linalg.norm(a) / np.linalg.norm(b)))
    assert structures[1].line_angle_deg == pytest.approx(bend, abs=2.0)
    assert structures[0].line_angle_deg is None and structures[2].line_angle_deg is None


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
    pairs = {wire.id: k for k, (wire, _) in matched(found, line.wires).items()}
    on = (found.cloud.wire != NO_WIRE) & away
    named = np.array([pairs[name] for name in found.cloud.wire[on]])
    assert (named == line.owner[on]).mean() > 0.995  # of twins, each its own


def test_order_and_duplicates_change_nothing(line: made.Line, found: Found) -> None:
    order = np.random.default_rng(5).permutation(np.repeat(np.arange(len(line.xyz)), 2))
    again = find(line.xyz[order])
    assert (again.cloud.label == found.cloud.label[order]).all()
    assert (again.cloud.wire == found.cloud.wire[order]).all()
    for one, other in zip(wires_of(found), wires_of(again), strict=True):
        assert (one.theta == other.theta).all() and one.evidence == other.evidence
    heights = [structure.height_m for structure in structures_of(found)]
    assert [structure.height_m for structure in structures_of(again)] == heights


def test_a_moved_line_is_found_moved(line: made.Line) -> None:
    """Turned, and in national coordinates, which LineFrame takes off again."""
    c, s = np.cos(np.radians(131.0)), np.sin(np.radians(131.0))
    turn, shift = np.array([[c, -s, 0], [s, c, 0], [0, 0, 1]]), np.array([2e5, 5.7e6, 40.0])
    world = line.xyz @ turn.T + shift
    frame = LineFrame.of_cloud(world, None)
    moved = find(frame.from_world(world))
    assert len(wires_of(moved)) == 14 and len(structures_of(moved)) == 3
    truth = [cKDTree(frame.from_world(wire.polyline(0.01) @ turn.T + shift)) for wire in line.wires]
    seen = set()
    for one in wires_of(moved):
        points = one.points(np.linspace(1, one.base.length_m - 1, 50))
        off = [float(tree.query(points)[0].max()) for tree in truth]
        k = int(np.argmin(off))
        assert off[k] < 0.07 and one.kind == line.wires[k].kind
        seen.add(k)
    assert len(seen) == 14


def test_level_spans_in_a_straight_line_are_told_apart(monkeypatch: pytest.MonkeyPatch) -> None:
    """The slope breaks by 6 % only, and the sag is 0.7 m."""
    monkeypatch.setattr(made, "relief", lambda xy: np.zeros(len(xy)))
    level = made.line(np.array([[0.0, 0.0], [90.0, 0.0], [180.0, 0.0]]), seed=1)
    found = find(level.xyz)
    pairs = matched(found, level.wires)
    assert len(pairs) == 14 and max(off for _, off in pairs.values()) < 0.06
    assert len(structures_of(found)) == 3
    assert all(wire.notes == () and wire.open is None for wire in wires_of(found))
    assert structures_of(found)[1].line_angle_deg == pytest.approx(0.0, abs=1.0)


def test_part_of_a_span_is_found_and_has_no_sag(line: made.Line) -> None:
    part = line.xyz[(line.xyz[:, 0] > 45) & (line.xyz[:, 0] < 150)]
    found = find(part)
    assert len(structures_of(found)) == 1 and len(matched(found, line.wires)) == 14
    first, last = found.lines[0].spans
    assert first.structures == (None, 1) and last.structures == (1, None)
    for span, open_end in ((first, 0), (last, 1)):
        for wire in span.wires:
            assert wire.ends[open_end] == Open("the cloud ends there")
            assert isinstance(wire.ends[1 - open_end], Attached)
            name = ("first", "last")[open_end]
            assert wire.open == f"the {name} end is open (the cloud ends there)"
            assert wire.sag is None and wire.span_m is None and wire.p_m is None


@pytest.mark.parametrize(("beyond_m", "spans"), [(14.0, 1), (45.0, 2)])
def test_a_stub_at_the_cloud_s_edge_is_no_span(line: made.Line, beyond_m: float, spans: int) -> None:
    """The first span up to its second structure, and a little or more of the second one."""
    u = line.feet[1][:2] - line.feet[0][:2]
    along = (line.xyz[:, :2] - line.feet[1][:2]) @ (u / np.linalg.norm(u))
    cut = line.xyz[along < beyond_m]
    found = find(cut)
    per_span = len({wire.id for wire in line.wires}) // (len(line.feet) - 1)
    assert [len(one.wires) for line in found.lines for one in line.spans] == [per_span] * spans
    assert len(structures_of(found)) == 2
    beyond = (along[along < beyond_m] > 3.0) & np.isin(line.truth[along < beyond_m], [13, 14])
    assert (np.isin(found.cloud.label[beyond], [13, 14])).mean() > 0.9
    said = [one.what for one in found.findings if one.kind == "stubs"]
    if spans == 1:
        assert set(found.cloud.wire[beyond]) == {NO_WIRE}
        assert len(said) == 1 and f"{per_span} wires go on for 1" in said[0] and "no spans" in said[0]
    else:
        assert not said


def test_lines_that_share_no_structure_are_two(line: made.Line) -> None:
    """Two lines side by side, 120 m apart, numbered one after the other."""
    both = np.concatenate([line.xyz, np.add(line.xyz, [0.0, 120.0, 0.0])])
    found = find(both)
    assert [one.id for one in found.lines] == [1, 2]
    assert [structure.id for structure in structures_of(found)] == [1, 2, 3, 4, 5, 6]
    assert [span.id for one in found.lines for span in one.spans] == [1, 2, 3, 4]
    assert [wire.id for wire in wires_of(found)] == list(range(1, 29))
    for one in found.lines:
        ids = {structure.id for structure in one.structures}
        assert all(set(span.structures) <= ids for span in one.spans)
        assert np.ptp([structure.foot[1] for structure in one.structures]) < 100


def test_a_wire_with_a_gap_names_the_stretches_where_it_is_seen(line: made.Line, found: Found) -> None:
    pairs = matched(found, line.wires)
    at = line.wires[2].base.local(line.xyz)[:, 0]
    again = find(line.xyz[(line.owner != 2) | (np.abs(at - 55) > 5)])
    before, after = pairs[2][0], matched(again, line.wires)[2][0]
    assert before.evidence.seen_m is None and before.evidence.coverage == 1
    (a, b), (c, d) = after.evidence.seen_m or ()
    assert 0 <= a < 8 and d > after.base.length_m - 8 and 10 <= c - b < 12
    assert c - b == pytest.approx(after.evidence.longest_gap_m, rel=1e-3)
    assert after.evidence.coverage == pytest.approx(1 - (c - b) / after.base.length_m, abs=0.01)


def test_points_far_away_and_points_beside_wires_change_no_wire(line: made.Line, found: Found) -> None:
    """A file's places left at 0, 0; noise half a metre from a wire, and a branch that reaches it."""
    random, (a, b) = np.random.default_rng(2), line.xyz[line.owner == 4][:2]
    noise = np.add([a, b], [0.0, 0.0, 0.6])
    branch = line.xyz[line.owner == 3][9] + np.linspace([0, 0, -0.5], [0, 0, -4], 12)
    branch += 0.05 * random.normal(size=(12, 3))
    more = np.concatenate([line.xyz, noise, branch, np.full((3, 3), -2e5)])
    again = find(more)
    assert texts(again) == ["3 points lie far away from the others in plan and are left out."]
    pairs = matched(again, line.wires)
    assert len(pairs) == 14 and max(off for _, off in pairs.values()) < 0.06
    added = again.cloud.label[len(line.xyz) :]
    assert (added[:2] == NOISE).all() and (added[-3:] == UNCLASSIFIED).all()
    assert (added[2:14] == HIGH_VEGETATION).all()


def test_wires_alone_are_found(line: made.Line) -> None:
    found = find(line.xyz[np.isin(line.truth, [13, 14])])
    pairs = matched(found, line.wires)
    assert len(pairs) == 14 and max(off for _, off in pairs.values()) < 0.07
    assert "shows no ground" in texts(found)[0]
    assert "1 of 1 structures by nothing but the wires that meet" in texts(found)[1]
    assert found.findings[1].where == ("structure 1",)
    (structure,) = structures_of(found)
    assert structure.evidence == "the wires that meet there" and structure.sigma_m == 1.0
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
    found = find(cloud.xyz)
    assert found.lines == ()
    assert (found.cloud.wire == NO_WIRE).all() and not np.isin(found.cloud.label, [13, 14, 15]).any()
    assert len(found.findings) == 1 and "No wires were found: of " in texts(found)[0]


def test_clouds_that_cannot_be_used_are_told(line: made.Line) -> None:
    with pytest.raises(SurveyError, match="The cloud holds no points"):
        find(np.empty((0, 3)))
    spoilt = line.xyz[:100].copy()
    spoilt[7, 2], spoilt[9, 0] = np.nan, np.inf
    with pytest.raises(SurveyError, match="2 of the cloud's 100 points have coordinates that are not finite"):
        find(spoilt)
    with pytest.raises(SurveyError, match=r"50000 points lie within 0 m of each other in plan"):
        find(np.tile([[5.0, 5.0, 5.0]], (50_000, 1)))
    degrees = line.xyz / [111_000.0, 111_000.0, 1.0] + [8.5, 47.2, 400.0]
    with pytest.raises(SurveyError, match=r"x \(8\..* to 8\..*\) and y \(47\..*\) look like degrees"):
        find(degrees)


def test_a_few_points_are_no_line() -> None:
    for count in (2, 5, 30):
        found = find(np.random.default_rng(count).uniform(0, 50, (count, 3)))
        assert found.lines == () and len(found.cloud.label) == count and found.findings


@pytest.mark.parametrize("above_m", [0.0, 3.0])
def test_ground_alone_shows_no_line(above_m: float) -> None:
    """Bare, or with bushes that are too low for wires."""
    random, cloud = np.random.default_rng(1), made.Line()
    made.ground(cloud, np.zeros(2), np.array([60.0, 40.0]), random, density=4.0)
    bushes = cloud.xyz[:200] + np.array([0.0, 0.0, above_m])
    found = find(np.concatenate([cloud.xyz, bushes]))
    assert found.lines == () and (found.cloud.label != UNCLASSIFIED).all()
    assert texts(found) == [
        "No wires were found: the cloud shows nothing more than 4 m above the ground. Give the whole cloud, "
        "not its ground alone."
    ]


def test_distinct_points_and_where_each_is() -> None:
    xyz = np.random.default_rng(1).integers(0, 3, (200, 3)).astype(float)
    points, which = distinct(xyz)
    assert (points[which] == xyz).all() and (points == np.unique(xyz, axis=0)).all()


def test_settings_that_cannot_work_are_refused() -> None:
    with pytest.raises(ConfigError, match=r"low_m must be at most min_height_m \(4 m\), got 5"):
        LidarConfig(low_m=5.0)
    with pytest.raises(ConfigError, match="cell_m must be greater than 0, got 0"):
        SpanConfig(cell_m=0.0)
    with pytest.raises(ConfigError, match=r"min_overlap must lie between 0 and 1, got 1\.5"):
        SpanConfig(min_overlap=1.5)
    with pytest.raises(ConfigError, match="min_gate_m must be at most max_gate_m"):
        TrackConfig(min_gate_m=0.7)


def test_the_least_height_decides(line: made.Line) -> None:
    """Shields hang at 33 m, the arms at 20 and 26 m."""
    high = find(line.xyz, LidarConfig(min_height_m=28.0))
    assert {wire.kind for wire in wires_of(high)} == {"phase"} and len(wires_of(high)) == 2


@pytest.mark.slow
@pytest.mark.data
@pytest.mark.parametrize(
    ("name", "count", "recall"), [("07CZ2_14.laz", 28, 0.99), ("12AN2_20.laz", 14, 0.94)]
)
def test_real_lines_are_found(shared_data: Path, name: str, count: int, recall: float) -> None:
    """The publisher's classes are the truth; they are used for nothing else.

    Of the second, one span is cut off after 14 to 17 m: its 14 wires are no conductors of their own.
    """
    cloud = laspy.read(shared_data / "lidar" / name)
    xyz = LineFrame.of_cloud(np.asarray(cloud.xyz), None).from_world(np.asarray(cloud.xyz))
    found = find(xyz)
    truth = np.asarray(cloud.classification)
    curves = np.concatenate([wire.polyline(0.1) for wire in wires_of(found)])
    assert (cKDTree(curves).query(xyz[truth == 14])[0] <= 0.25).mean() > recall
    assert len(wires_of(found)) == count and len(structures_of(found)) == 1
    tower = xyz[truth == 15]
    foot = structures_of(found)[0].foot
    assert np.linalg.norm(foot[:2] - (tower.min(0) + tower.max(0))[:2] / 2) < 1.5
    labelled = found.cloud.wire != NO_WIRE
    near_tower = cKDTree(tower).query(xyz[labelled])[0] < 3.0
    assert (truth[labelled][~near_tower] == 14).mean() > 0.99
    assert all("the cloud ends there" in (wire.open or "") for wire in wires_of(found))
