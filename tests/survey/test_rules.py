"""Clearances by rule: each object, direction and state is measured as it is, judged by the rows for it."""

import json
from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest
from pyproj import Transformer
from tests.support.states import HOT

from plnerf.errors import ConfigError
from plnerf.line.cloud import BUILDING, GROUND, HIGH_VEGETATION, Cloud
from plnerf.line.ends import Attached, Quantity
from plnerf.line.frame import LineFrame
from plnerf.line.hang import hang
from plnerf.line.line import Line, Span, Structure
from plnerf.line.rules import Judged, RuleReport
from plnerf.line.states import Load, State, States, WireState
from plnerf.line.survey import Survey
from plnerf.survey.clearance import measure_clearances
from plnerf.survey.config_ground import ClearanceConfig
from plnerf.survey.config_rules import RulesConfig
from plnerf.survey.rule_scene import kinds_of
from plnerf.survey.rules import judge_rules

EAST, NORTH = 450_000.0, 5_650_000.0
FRAME = LineFrame(np.eye(3), 1.0, np.array([EAST, NORTH, 0.0]), "m", "EPSG:25832+7837")
ANY = "name = 'a rule'\nsource = 'a page'\ndate = '2026'\n"
TREE = np.array([100.0, 3.0, 6.0])
"""Beside the middle of the wire, whose lowest point is at 10 m."""
SPREAD = np.diag([0.05, 0.05, 0.04, 0.04, 0.02, 0.0]) ** 2


def row(what: str, direction: str, distance: float, more: str = "") -> str:
    text = f"object = '{what}'\ndirection = '{direction}'\ndistance = {distance}\n"
    return f"[[row]]\n{text}read_in = 'here'\n{more}\n"


@cache
def survey() -> Survey:
    """A wire from (0, 0, 15) to (200, 0, 15) that hangs down to 10 m over flat ground at 0, with a shield
    wire above; a tree of one point; a house of 4 by 4 m and 7 m high around (150, 12); one line crosses
    below it.
    """
    first, last = Attached(1, np.array([0, 0, 15.0]), 0.1), Attached(2, np.array([200.0, 0, 15]), 0.1)
    wire = replace(hang(first.point, last.point, 5.0, id=1, ends=(first, last)), covariance=SPREAD)
    shield = replace(hang((0.0, 0.0, 20.0), (200.0, 0.0, 20.0), 3.0, id=2), kind="shield")
    masts = tuple(Structure(k, np.array([x, 0, 0.0]), 22.0, 0.1, "") for k, x in ((1, 0.0), (2, 200.0)))
    line = Line(1, masts, (Span(1, (1, 2), (wire, shield)),))
    lower = hang((50.0, -40.0, 9.0), (50.0, 40.0, 9.0), 2.0, id=3, kind="communication")
    crossing = Line(2, (), (Span(2, (None, None), (lower,)),))
    ground = np.stack(np.meshgrid(np.arange(-10, 211, 1.0), np.arange(-30, 31, 1.0)), -1).reshape(-1, 2)
    x, y = np.meshgrid(np.linspace(148, 152, 9), np.linspace(10, 14, 9))
    roof = np.column_stack([x.ravel(), y.ravel(), np.full(81, 7.0)])
    xyz = np.concatenate([np.column_stack([ground, np.zeros(len(ground))]), TREE[None], roof])
    label = np.array([GROUND] * len(ground) + [HIGH_VEGETATION] + [BUILDING] * 81, np.uint8)
    return Survey(FRAME, (line, crossing), Cloud(xyz, label, np.zeros(len(xyz), np.int64)), "here")


def judged(tmp: Path, text: str, of: Survey | None = None, kv: float = 110.0, **more: object) -> RuleReport:
    path = tmp / "rules.toml"
    path.write_text(ANY + text, encoding="utf-8")
    config = RulesConfig(path, kv, **more)  # type: ignore[arg-type]
    report, _ = judge_rules(of or survey(), ClearanceConfig(), config)
    assert report is not None
    return report


def only(report: RuleReport, state: str = "as surveyed") -> Judged:
    (one,) = (one for one in report.judged if one.state == state and one.line == 1)
    return one


def hot(load: Load = HOT, deeper: float = 1.0, swing: float = 0.0) -> Survey:
    """With a state in which the phase wire hangs deeper, or swung to the left."""
    wire = survey().wires[0]
    theta = wire.theta + np.array([0, 0, 0, 0, deeper, swing])
    state = WireState(1, theta, wire.covariance, *[Quantity(1.0, 0.1)] * 4, None, 200.0)
    states = States((State(load, (state,)),), Quantity(20.0, 1.0), "given", ())
    return replace(survey(), states=states)


@pytest.mark.parametrize(
    ("what", "direction", "distance"),
    [
        ("ground", "vertical", 10.0),
        ("vegetation", "radial", 5.0),  # 3 across, 4 up
        ("vegetation", "horizontal", 3.0),
        ("building", "radial", np.hypot(10.0, 11.15 - 7.0)),  # of the roof's near corner, at x = 148
        ("building", "horizontal", 10.0),
        ("line", "vertical", 11.25 - 7.0),  # at a quarter of the span; the other's lowest point
    ],
)
def test_distances_are_those_of_the_scene(
    tmp_path: Path, what: str, direction: str, distance: float
) -> None:
    """The curve is a catenary: at a quarter of the span it hangs 1.25 m (and a hair) above its lowest."""
    lower = "[[row]]\nobject='vegetation'\ndirection='vertical'\ndistance=9.0\nread_in='x'\n" + (
        "[[row]]\nobject='building'\ndirection='vertical'\ndistance=9.0\nread_in='x'\n"
    )
    report = judged(tmp_path, row(what, direction, 1.0) + lower)
    (one,) = (one for one in report.judged if one.rule == 1)
    assert one.wire == 1 and abs(one.distance.value - distance) < 0.03
    assert one.distance.sigma > 0.01 and one.verdict == "clear"


def with_tree(xyz: list[float], sigma_m: float | None = None) -> Survey:
    """With one more tree of nine points, 0.4 m apart; sigma_m: of all points, if stated."""
    cloud = survey().cloud
    x, y = np.meshgrid(np.linspace(-0.4, 0.4, 3), np.linspace(-0.4, 0.4, 3))
    tree = np.column_stack([x.ravel(), y.ravel(), np.zeros(9)]) + xyz
    label = np.concatenate([cloud.label, np.full(9, HIGH_VEGETATION, np.uint8)])
    points = np.concatenate([cloud.xyz, tree])
    sigma = None if sigma_m is None else np.full(len(points), sigma_m)
    return replace(survey(), cloud=Cloud(points, label, np.zeros(len(points), np.int64), sigma_m=sigma))


@pytest.mark.parametrize(
    ("tree", "sigma_m"),
    [([60.0, 2.0, 9.0], None), ([203.0, 0.0, 12.0], None), ([60.0, 2.0, 9.0], 0.2), ([130.0, 1.0, 8.0], 0.2)],
)
def test_distances_in_space_and_their_intervals_are_those_of_the_clearances(
    tmp_path: Path, tree: list[float], sigma_m: float | None
) -> None:
    """Of points that state deviations and that do not, and of a tree beyond the end of the line, which those
    of a laser are."""
    found = with_tree(tree, sigma_m)
    one = only(judged(tmp_path, row("vegetation", "radial", 3.0), found))
    clearances, _ = measure_clearances(found, ClearanceConfig())
    least = clearances.wires[0].least("vegetation")
    assert least is not None and np.array_equal(one.on_object, least.on_obstacle)
    assert one.distance.value == least.distance_m
    assert one.distance.sigma == pytest.approx(least.sigma_m)


def test_a_house_far_below_is_no_matter_of_its_distance_in_plan(tmp_path: Path) -> None:
    """Where its vertical clearance holds, that counts."""
    near = row("building", "vertical", 9.0) + row("building", "horizontal", 5.0)
    assert [one.rule for one in judged(tmp_path, near).judged] == [2]  # 4.25 m below: not clear of it
    clear = row("building", "vertical", 2.0) + row("building", "horizontal", 5.0)
    report = judged(tmp_path, clear)
    assert report.judged == () and "no building is near" in report.not_judged[1].why


def test_margin_and_verdict_are_of_the_required_distance(tmp_path: Path) -> None:
    verdicts = {9.0: "clear", 9.98: "within its uncertainty", 11.0: "closer than required"}
    for required, verdict in verdicts.items():
        report = judged(tmp_path, row("ground", "vertical", required))
        one = only(report)
        assert one.verdict == verdict
        assert report.margin(one).value == pytest.approx(one.distance.value - required)
        assert report.margin(one).sigma == one.distance.sigma
    assert abs(one.distance.half_95 - 1.96 * np.hypot(0.04 / np.sqrt(2), 0.02)) < 0.02


def test_states_are_judged_by_the_rows_that_are_for_them(tmp_path: Path) -> None:
    rows = "".join(row("ground", "vertical", 9.5, f"states = ['{kind}']") for kind in ("still", "ice"))
    report = judged(tmp_path, rows, hot())
    assert [(one.rule, one.state) for one in report.judged] == [
        (1, "as surveyed"), (1, "75 °C"), (2, "as surveyed")
    ]  # fmt: skip
    surveyed, later = report.judged[:2]
    assert surveyed.verdict == "clear" and later.verdict == "closer than required"
    assert later.distance.value == pytest.approx(surveyed.distance.value - 1.0, abs=0.02)
    assert [one.why for one in report.not_judged] == [
        "no state of ice was computed: it was judged as surveyed only (--conductor, --states)"
    ]


def test_a_crossing_is_judged_in_the_states_that_one_of_its_wires_has(tmp_path: Path) -> None:
    rules = row("line", "vertical", 2.0)
    report = judged(tmp_path, rules, hot())
    lower = {one.state: one.distance.value for one in report.judged}
    assert lower["75 °C"] == pytest.approx(lower["as surveyed"] - 0.75, abs=0.02)  # at a quarter of the span
    nothing = replace(hot(), states=States((State(HOT, ()),), Quantity(20.0, 1.0), "given", ()))
    report = judged(tmp_path, rules, nothing)
    assert [one.state for one in report.judged] == ["as surveyed"]
    assert report.not_judged[0].why.startswith("no state of still or wind or ice was computed: it was judged")


def test_a_wire_blown_out_comes_nearer_to_what_stands_beside_it(tmp_path: Path) -> None:
    storm = hot(Load("storm", 5.0, 400.0), 0.0, 0.5)  # to the left, where the tree is
    report = judged(tmp_path, row("vegetation", "radial", 3.0, "states = ['wind']"), storm)
    assert only(report).verdict == "clear"
    one = only(report, "storm")
    y, z = 5.0 * np.sin(0.5), 15.0 - 5.0 * np.cos(0.5)
    assert one.distance.value == pytest.approx(np.hypot(3.0 - y, z - 6.0), abs=0.03)


def test_kinds_of_loads() -> None:
    assert kinds_of(Load("", 75.0)) == ("still",)
    assert kinds_of(Load("", 5.0, -300.0)) == ("wind",)
    assert kinds_of(Load("", 5.0, 300.0, 10.0)) == ("wind", "ice")
    assert kinds_of(Load("", 5.0, 0.0, 10.0)) == ("ice",)


def test_shield_wires_are_not_judged(tmp_path: Path) -> None:
    report = judged(tmp_path, row("ground", "vertical", 6.0))
    assert {one.wire for one in report.judged if one.line == 1} == {1}


MAP = {
    "road": ("LineString", [[30.0, -40.0], [30.0, 40.0]]),
    "rail": ("LineString", [[-50.0, -12.0], [250.0, -12.0]]),
    "building": ("Polygon", [[[90.0, 2.0], [110.0, 2.0], [110.0, 8.0], [90.0, 8.0], [90.0, 2.0]]]),
}


def write_map(path: Path, epsg: int = 4326, of: str = "class", **extra: object) -> Path:
    """Of a road across the line at x = 30, a railway 12 m beside it, and a house below the tree's point."""
    pytest.importorskip("pyogrio", reason="plnerf[gis] is not installed")
    import pyogrio
    import shapely

    to = Transformer.from_crs("EPSG:25832", f"EPSG:{epsg}", always_xy=True)
    shapes, kinds = [], []
    for kind, (name, coordinates) in MAP.items():
        local = shapely.from_geojson(json.dumps({"type": name, "coordinates": coordinates}))
        onto = shapely.transform(
            local, lambda xy: np.stack(to.transform(xy[:, 0] + EAST, xy[:, 1] + NORTH), 1)
        )
        shapes.append(shapely.to_wkb(onto))
        kinds.append(kind.upper())
    data = [np.array(kinds, object), *(np.array(value) for value in extra.values())]
    pyogrio.raw.write(
        path, np.array(shapes, object), data, [of, *extra], geometry_type="Unknown", crs=f"EPSG:{epsg}",
        driver={".gpkg": "GPKG", ".geojson": "GeoJSON"}[path.suffix],
    )  # fmt: skip
    return path


@pytest.mark.parametrize(("name", "epsg"), [("map.geojson", 4326), ("map.gpkg", 25832), ("map.gpkg", 3857)])
def test_maps_are_laid_over_the_survey(tmp_path: Path, name: str, epsg: int) -> None:
    """Of longitudes, of the survey's own CRS and of another; the road is at x = 27 to 33."""
    path = write_map(tmp_path / name, epsg)
    rules = row("road", "vertical", 7.0) + row("rail", "horizontal", 10.0) + row("rail", "vertical", 8.0)
    report = judged(tmp_path, rules + row("water", "vertical", 8.0), objects=(path,))
    over, beside = report.judged
    wire = survey().wires[0]
    assert over.distance.value == pytest.approx(float(wire.at(np.array([33.0]))[0, 1]), abs=0.03)
    assert 32.0 < over.on_wire[0] < 33.5 and over.on_object[2] == pytest.approx(0.0, abs=1e-6)
    assert beside.distance.value == pytest.approx(12.0 - 1.5, abs=0.03)  # the railway is 3 m wide
    whys = {one.rule: one.why for one in report.not_judged}
    assert whys[3].startswith("no rail is near or below")
    assert whys[4] == "no water of a map is given (--objects)"
    assert dict(report.objects) == {"road": 1, "rail": 1, "building": 1}


def test_what_stands_on_a_building_of_the_map_is_the_building(tmp_path: Path) -> None:
    path = write_map(tmp_path / "map.gpkg", 25832)
    rules = row("vegetation", "radial", 3.0) + row("building", "radial", 3.0)
    without = judged(tmp_path, rules)
    assert np.allclose(without.judged[0].on_object, TREE) and without.judged[1].distance.value > 9
    report = judged(tmp_path, rules, objects=(path,))
    (one,) = report.judged
    assert one.rule == 2 and np.allclose(one.on_object, TREE)
    assert report.not_judged[0].why.startswith("no vegetation is near")


def test_only_what_lies_near_the_line_counts(tmp_path: Path) -> None:
    """A map may be of a country: of this line, its objects lie 5 km away."""
    path = write_map(tmp_path / "map.gpkg", 25832)
    away = replace(survey(), frame=replace(FRAME, origin_world=np.array([EAST + 5000.0, NORTH, 0.0])))
    report = judged(tmp_path, row("road", "vertical", 7.0), away, objects=(path,))
    assert report.objects == () and report.not_judged[0].why.startswith("no road is near or below")


def test_a_width_of_the_map_counts(tmp_path: Path) -> None:
    path = write_map(tmp_path / "map.gpkg", 25832, width_m=[20.0, 8.0, 0.0])
    report = judged(tmp_path, row("rail", "horizontal", 5.0), objects=(path,))
    assert report.judged[0].distance.value == pytest.approx(8.0, abs=0.01)


def test_what_is_wrong_with_a_map_is_named(tmp_path: Path) -> None:
    path = write_map(tmp_path / "map.gpkg", 25832, of="type")
    rules = row("road", "vertical", 7.0)
    with pytest.raises(ConfigError, match=r"no object whose attribute 'class' is road, .*object-field"):
        judged(tmp_path, rules, objects=(path,))
    assert judged(tmp_path, rules, objects=(path,), object_field="type").judged
    broken = tmp_path / "broken.gpkg"
    broken.write_text("no map")
    with pytest.raises(ConfigError, match=r"broken.gpkg cannot be read"):
        judged(tmp_path, rules, objects=(broken,))
    with pytest.raises(ConfigError, match=r"There is no map .*none.gpkg"):
        judged(tmp_path, rules, objects=(tmp_path / "none.gpkg",))
    nowhere = replace(survey(), frame=replace(FRAME, crs=None))
    path = write_map(tmp_path / "good.gpkg", 25832)
    config = RulesConfig(tmp_path / "rules.toml", 110.0, (path,))
    report, findings = judge_rules(nowhere, ClearanceConfig(), config)  # what took minutes is not lost
    assert report is not None and not report.judged
    assert f"{path} cannot be laid over the survey, whose coordinate" in findings[0].text


def test_rows_for_an_area_count_where_it_is_named(tmp_path: Path) -> None:
    rules = row("ground", "vertical", 14.0, "area = 'residential'")
    report = judged(tmp_path, rules)
    assert not report.judged and "--rules.areas 'residential'" in report.not_judged[0].why
    assert only(judged(tmp_path, rules, areas=("residential",))).verdict == "closer than required"
    with pytest.raises(ConfigError, match=r"no rules for the area 'town', but for residential"):
        RulesConfig(tmp_path / "rules.toml", 110.0, areas=("town",))  # before anything is surveyed


def test_rows_hold_up_to_their_altitude(tmp_path: Path) -> None:
    report = judged(tmp_path, row("ground", "vertical", 7.0, "altitude_up_to = 10"))
    assert not report.judged and "holds up to 10 m above the sea, but the line is at 20 m" in (
        report.not_judged[0].why
    )


def test_findings_say_what_was_not_compared(tmp_path: Path) -> None:
    config = RulesConfig(Path("gb-50545"), 220.0)
    report, findings = judge_rules(survey(), ClearanceConfig(), config)
    assert report is not None and report.rules[0].required_m == 6.5  # not residential
    assert any("8 of the 8 rules of GB 50545-2010 (example) have" in one.text for one in findings)
    assert judge_rules(survey(), ClearanceConfig(), RulesConfig()) == (None, ())
