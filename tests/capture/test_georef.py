"""A reconstruction finds its place on the earth, says what held it there, and what was not to be trusted."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from tests.capture.test_exif import HERE, photo

from plnerf.capture import georef
from plnerf.capture.accuracy import accuracy_text
from plnerf.capture.control import nearest_point, read_gcp_list, split
from plnerf.capture.exif import PhotoFacts, read_facts
from plnerf.capture.georef import Anchor, ControlError, georeference
from plnerf.capture.gravity import gravity_from_gimbal, up_in_camera
from plnerf.capture.heights import heights_of, with_heights
from plnerf.capture.local_frame import LocalFrame
from plnerf.capture.references import Reference, References, from_photos, read_geo_txt
from plnerf.capture.similarity import Similarity
from plnerf.errors import CaptureError

PLACE = LocalFrame("EPSG:25832", (10.5, 51.5, 300.0))


def flown(
    local: np.ndarray, accuracy_m: float = 0.02, seed: int = 0
) -> tuple[dict[str, np.ndarray], References, Similarity]:
    """Centres in a reconstruction of its own, their stated positions, and what links the two."""
    random = np.random.default_rng(seed)
    to_metres = Similarity(7.0, Rotation.random(random_state=seed).as_matrix(), random.normal(size=3))
    centres = ((local - to_metres.shift) @ to_metres.R) / to_metres.scale
    stated = PLACE.to_crs(local + accuracy_m * random.normal(size=local.shape))
    names = [f"{i:03d}.jpg" for i in range(len(local))]
    rows = {name: Reference(tuple(xyz), (accuracy_m,) * 3) for name, xyz in zip(names, stated, strict=True)}  # type: ignore[misc]
    return dict(zip(names, centres, strict=True)), References(PLACE.crs, rows, "a test"), to_metres


def curve() -> np.ndarray:
    s = np.linspace(0, 3, 40)
    return np.stack([40 * s, 25 * np.sin(s), 60 + 4 * np.cos(2 * s)], 1)


def test_it_lies_where_it_was_flown() -> None:
    centres, references, truth = flown(curve())
    found = georeference(centres, references)
    assert found.held_by == "positions" and found.fit.inlier.all()
    things = np.random.default_rng(1).normal(size=(50, 3)) * 30 + [60, 0, 20]
    x = ((things - truth.shift) @ truth.R) / truth.scale
    crs = found.frame.to_crs(found.fit.similarity(x))
    assert np.abs(PLACE.to_local(crs) - things).max() < 0.15
    summary = found.summary()
    assert summary["residual_median_m"] < 0.06 and summary["positions"] == 40 and not summary["not_trusted"]
    assert summary["crs"] == "EPSG:25832" and summary["metres_per_unit"] == pytest.approx(7.0, rel=1e-3)


def test_wrong_positions_are_named() -> None:
    centres, references, _ = flown(curve())
    rows = dict(references.by_name)
    for name in ("003.jpg", "017.jpg", "030.jpg"):
        x, y, z = rows[name].xyz
        rows[name] = replace(rows[name], xyz=(x + 80.0, y, z - 30))
    found = georeference(centres, replace(references, by_name=rows))
    assert found.summary()["not_trusted"] == ["003.jpg", "017.jpg", "030.jpg"]
    assert found.summary()["residual_worst_m"] < 0.12


def test_a_place_that_few_positions_agree_on_is_none() -> None:
    """Some always agree, with a reconstruction of any shape: more than half must."""
    centres, references, _ = flown(curve())
    off = np.random.default_rng(3).normal(size=(40, 3))
    for right in (15, 25):
        wrong = {name: centres[name] + off[i] for i, name in enumerate(centres) if i >= right}
        if right < 20:
            with pytest.raises(CaptureError, match=r"Of 40 positions only 15 agree .* it is bent or put"):
                georeference({**centres, **wrong}, references)
        else:
            assert georeference({**centres, **wrong}, references).fit.inlier.sum() == right


def test_a_straight_track_needs_gravity_and_says_so() -> None:
    straight = np.stack([np.linspace(0, 200, 40), np.linspace(0, 80, 40), np.full(40, 30.0)], 1)
    centres, references, truth = flown(straight)
    alone = georeference(centres, references)
    assert alone.held_by == "positions alone, the roll is open" and alone.fit.roll_sigma_deg > 1
    random = np.random.default_rng(2)
    angles = np.stack([random.uniform(-60, 0, 40), random.normal(size=40)], 1)
    heading = Rotation.from_euler("z", random.uniform(0, 360, (40, 1)), degrees=True).as_matrix()
    R = []
    for (pitch, roll), turn in zip(angles, heading, strict=True):
        up = up_in_camera(float(pitch), float(roll))
        level = Rotation.align_vectors([[0, 0, 1.0]], up[None])[0].as_matrix()  # camera to a level world
        R.append(truth.R.T @ turn @ level)
    gravity = gravity_from_gimbal(np.array(R), angles + random.normal(size=angles.shape))
    assert gravity is not None and gravity.scatter_deg < 3
    assert np.degrees(np.arccos(gravity.up @ truth.R.T @ [0, 0, 1.0])) < 0.5
    found = georeference(centres, references, gravity)
    assert found.held_by == "positions and the gimbal's angles"
    beside = np.array([[100.0, 60.0, 10.0]])
    x = ((beside - truth.shift) @ truth.R) / truth.scale
    assert np.abs(PLACE.to_local(found.frame.to_crs(found.fit.similarity(x))) - beside).max() < 0.4


@pytest.mark.parametrize(
    ("pitch", "roll", "up"),
    [(0, 0, (0, -1, 0)), (-90, 0, (0, 0, -1)), (90, 0, (0, 0, 1)), (0, 90, (-1, 0, 0)), (0, -90, (1, 0, 0))],
)
def test_up_as_a_camera_sees_it(pitch: float, roll: float, up: tuple[float, ...]) -> None:
    assert up_in_camera(float(pitch), float(roll)) == pytest.approx(up, abs=1e-12)


def test_gimbals_that_disagree_say_nothing() -> None:
    R = Rotation.random(30, random_state=0).as_matrix()
    assert gravity_from_gimbal(R, np.zeros((30, 2))) is None
    assert gravity_from_gimbal(R[:2], np.zeros((2, 2))) is None


def test_photos_positions_are_collected_with_what_was_wrong(tmp_path: Path) -> None:
    facts: dict[str, PhotoFacts] = {"good.jpg": photo(tmp_path, HERE), "none.jpg": photo(tmp_path)}
    flat = {tag: value for tag, value in HERE.items() if tag not in (5, 6)}
    facts["flat.jpg"] = photo(tmp_path, flat)
    facts["zero.jpg"] = photo(tmp_path, {**HERE, 2: (0.0, 0.0, 0.0), 4: (0.0, 0.0, 0.0)})
    found = from_photos(facts)
    assert list(found.by_name) == ["good.jpg"] and found.crs == "EPSG:4326"
    assert [problem.split(":")[0] for problem in found.problems] == ["flat.jpg", "zero.jpg"]


def test_geo_txt_of_odm(tmp_path: Path) -> None:
    path = tmp_path / "geo.txt"
    path.write_text(
        "WGS84 UTM 32N\n\nA.JPG 600000.5 5700000.25 310\n"
        "b.jpg 600010 5700000 311 10 -90 0 0.02 0.05\nc.jpg 1 2 3\n"
    )
    found = read_geo_txt(path, ["a.jpg", "sub/b.jpg"])
    assert found.crs == "EPSG:32632" and set(found.by_name) == {"a.jpg", "sub/b.jpg"}
    assert found.by_name["a.jpg"] == Reference((600000.5, 5700000.25, 310.0), (3.0, 3.0, 10.0))
    assert found.by_name["sub/b.jpg"].sigma_m == (0.02, 0.02, 0.05)
    assert found.problems == ("c.jpg: named in geo.txt, but there is no such image",)


@pytest.mark.parametrize(
    ("text", "why"),
    [
        ("", "needs a first line with a coordinate reference system"),
        ("EPSG:32632\n", "has 1 lines"),
        ("EPSG:1\na.jpg 1 2 3\n", "cannot be used"),
        ("EPSG:32632\na.jpg 1 2\n", r"line 2 should be `image x y z"),
        ("EPSG:32632\na.jpg 1 2 nan\n", r"line 2 should be"),
        ("EPSG:32632\na.jpg 1 2 3 nan nan nan inf 1\n", r"line 2 should be"),
        ("EPSG:32632\na.jpg 1 2" + 9_999 * " x", r"line 2 should be"),
        ("EPSG:32632\nz.jpg 1 2 3\n", "none is among the 1 images here"),
        ("EPSG:32632\n" + 9_999 * "z" + " 1 2 3\n", "none is among the 1 images here"),
    ],
)
def test_a_geo_txt_that_cannot_be_used_says_why(text: str, why: str, tmp_path: Path) -> None:
    (tmp_path / "geo.txt").write_text(text)
    with pytest.raises(CaptureError, match=why) as caught:
        read_geo_txt(tmp_path / "geo.txt", ["a.jpg"])
    assert len(str(caught.value)) < 1000


def test_no_position_for_any_posed_image_is_told() -> None:
    centres, references, _ = flown(curve())
    with pytest.raises(CaptureError, match="None of the 40 images with a pose has a position from a test"):
        georeference(centres, replace(references, by_name={}))


def test_positions_as_close_as_they_are_good_hold_no_scale() -> None:
    close = 0.02 * curve()  # 2.4 m long
    centres, references, _ = flown(close, accuracy_m=0.01)
    assert georeference(centres, references).fit.scale_sigma == pytest.approx(
        0.01 / np.sqrt(((close - close.mean(0)) ** 2).sum()), rel=0.1
    )
    rows = {name: replace(row, sigma_m=(3.0, 3.0, 10.0)) for name, row in references.by_name.items()}
    with pytest.raises(CaptureError, match=r"lie within 2\.\d+ m and are good to 3 m, .* scale to \d+% only"):
        georeference(centres, replace(references, by_name=rows))
    first = next(iter(references.by_name.values()))
    rows = dict.fromkeys(references.by_name, first)
    with pytest.raises(CaptureError, match="All 40 positions are the same, so that they hold no scale"):
        georeference(centres, replace(references, by_name=rows))


@pytest.mark.data
def test_real_photos_positions_are_a_track(shared_data: Path) -> None:
    """70 photos along a road, some 10 m apart: the distances are those of a drone and of no other mistake."""
    facts = {path.name: read_facts(path) for path in sorted((shared_data / "seneca").glob("*.jpg"))}
    found = from_photos(facts)
    assert len(found.by_name) == 70 and not found.problems
    stated = np.array([reference.xyz for reference in found.by_name.values()])
    local = LocalFrame(found.crs, tuple(np.median(stated, 0))).to_local(stated)
    steps = np.linalg.norm(np.diff(local[:, :2], axis=0), axis=1)
    assert 5 < np.median(steps) < 60 and np.abs(local[:, 2]).max() < 40


GCP = """EPSG:25832
600000 5700000 300 10.5 20.5 A.jpg p1
600000 5700000 300 30 40 b.jpg p1
600050 5700000 301 11 12 a.jpg p2
600050 5700000 301 13 14 c.jpg p2
600050 5700020 301 1 2 a.jpg lonely
"""


def test_gcp_list_of_odm(tmp_path: Path) -> None:
    (tmp_path / "gcp_list.txt").write_text(GCP)
    found = read_gcp_list(tmp_path / "gcp_list.txt", ["a.jpg", "b.jpg"])
    assert found.crs == "EPSG:25832" and [point.name for point in found.points] == ["p1"]
    assert found.points[0].seen_px == {"a.jpg": (10.5, 20.5), "b.jpg": (30.0, 40.0)}
    assert found.points[0].xyz == (600000.0, 5700000.0, 300.0)
    assert [problem.split(":")[0] for problem in found.problems] == ["c.jpg", "p2", "lonely"]


@pytest.mark.parametrize(
    ("line", "why"),
    [
        ("x y z 1 2 a.jpg p3", r"line 7 should be `x y z pixel_x"),
        ("1 2 nan 4 5 a.jpg p3", r"line 7 should be `x y z pixel_x"),
        ("1 2 x" + 9_999 * " 4", r"line 7 should be `x y z pixel_x"),
        ("1 2 3 4 a.jpg", r"line 7 should be `x y z pixel_x pixel_y image"),
        ("600000 5700000 302 1 2 b.jpg p1", r"line 7: control point p1 is at .* here and at .* before"),
    ],
)
def test_a_gcp_list_that_cannot_be_used_says_why(line: str, why: str, tmp_path: Path) -> None:
    (tmp_path / "gcp_list.txt").write_text(GCP + line + "\n")
    with pytest.raises(CaptureError, match=why) as caught:
        read_gcp_list(tmp_path / "gcp_list.txt", ["a.jpg", "b.jpg"])
    assert len(str(caught.value)) < 1000


def test_rays_meet_where_they_are_nearest() -> None:
    random = np.random.default_rng(8)
    x, centres = np.array([1.0, 2.0, 3.0]), random.normal(size=(5, 3)) * 4
    assert nearest_point(centres, x - centres) == pytest.approx(x)
    apart = np.array([[0.0, 0.0, 1.0], [0.0, 0.0, -1.0]])
    assert nearest_point(apart, np.array([[1.0, 0, 0], [0, 1.0, 0]])) == pytest.approx([0, 0, 0])


def test_roles_of_control_points_are_stated_or_counted(tmp_path: Path) -> None:
    rows = [f"{k} 0 0 {px} 1 {name}.jpg p{k}" for k in range(6) for px, name in ((1, "a"), (2, "b"))]
    rows[2] += " check"
    rows[4], rows[5] = f"{rows[4]} Control", f"{rows[5]} wrong"
    path = tmp_path / "gcp_list.txt"
    path.write_text("\n".join(["EPSG:25832", *rows]))
    found = read_gcp_list(path, ["a.jpg", "b.jpg"])
    assert found.problems == ("p2: 'wrong' is no role (control, check) and is not considered",)

    def checks(every: int) -> list[str]:
        return [one.name for one in split(found, every).points if one.role == "check"]

    assert checks(0) == ["p1"] and checks(2) == ["p1", "p3", "p5"] and checks(4) == ["p1", "p5"]
    path.write_text("\n".join(["EPSG:25832", *rows, "1 0 0 3 1 a.jpg p1 control"]))
    with pytest.raises(CaptureError, match="p1 is a control point here and a check point before"):
        read_gcp_list(path, ["a.jpg", "b.jpg"])


def on_the_ground(
    truth: Similarity, ground: np.ndarray, height_m: float = 0.0, crs: str = PLACE.crs
) -> list[Anchor]:
    """Places of the ground in the reconstruction, with surveyed heights that are off."""
    surveyed = PLACE.to_crs(ground) + np.array([0.0, 0.0, height_m])
    x = ((ground - truth.shift) @ truth.R) / truth.scale
    return [
        Anchor(f"p{k}", x[k], tuple(xyz), (0.02,) * 3, crs, "control") for k, xyz in enumerate(surveyed)
    ]


SIX = np.array([[20.0, 40, 0], [100, 50, 2], [80, -20, 1], [30, -20, 3], [60, 10, 0], [10, 0, 1]])


def test_points_held_back_say_how_accurate_it_is() -> None:
    """Half of 80 points hold the scene; the others' RMSE are those of the errors that they were given."""
    centres, references, truth = flown(curve())
    random = np.random.default_rng(5)
    ground = random.uniform([0, -40, 0], [120, 40, 4], (80, 3))
    error = random.normal(size=(80, 3)) * [0.03, 0.04, 0.06]
    points = [
        replace(one, role="check" if k % 2 else "control", x=one.x + truth.R.T @ off / truth.scale)
        for k, (one, off) in enumerate(zip(on_the_ground(truth, ground), error, strict=True))
    ]
    found = georeference(centres, references, None, points)
    summary = found.summary()
    check, true = summary["check"], np.sqrt((error[1::2] ** 2).mean(0))
    assert check["n"] == summary["control"]["n"] == 40 and len(summary["points"]) == 80
    assert check["rmse_h_m"] == pytest.approx(np.hypot(*true[:2]), abs=0.01)
    assert check["rmse_v_m"] == pytest.approx(true[2], abs=0.01)
    assert check["rmse_h_m"] == pytest.approx(np.hypot(check["rmse_east_m"], check["rmse_north_m"]))
    assert found.source == "a test and 40 control points" and "p1" not in found.names
    alone = georeference(centres, references, None, [replace(one, role="check") for one in points]).summary()
    assert alone["control"] is None and alone["check"]["n"] == 80 and alone["source"] == "a test"
    said = accuracy_text("check", check)
    assert said.startswith("Check points, n = 40: RMSE_H 0.0") and "asks" not in said
    assert "n = 6 (the standard asks for 30)" in accuracy_text("check", check | {"n": 6})


def test_heights_above_different_things_are_an_error_that_states_the_offset() -> None:
    centres, references, truth = flown(curve())
    with pytest.raises(ControlError) as raised:
        georeference(centres, references, None, on_the_ground(truth, SIX, -47.0))
    said = str(raised.value)
    assert "Of 6 control points only 0 agree with a test, and all differ alike: they lie 47.0" in said
    assert "m lower and 0.0" in said and "--height-datum" in said
    with pytest.raises(ControlError, match="only 0 agree"):
        georeference(centres, references, None, on_the_ground(truth, SIX, -47.0)[:1])
    checks = [replace(one, role="check") for one in on_the_ground(truth, SIX, 47.0)]
    told = georeference(centres, references, None, checks).summary()["check_points_off"]
    assert told.startswith(("47.0", "46.9")) and "m higher" in told


def above_the_ellipsoid(references: References) -> References:
    return replace(references, crs=with_heights(references.crs, "ellipsoid"))


def test_rtk_and_a_datum_meet_by_the_control_points_where_no_grid_is_installed(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Photos above the ellipsoid, control points above DHHN2016, 47 m lower: the offset is estimated, or the
    grid's; the survey's heights are those of the control points."""
    centres, references, truth = flown(curve())
    references = above_the_ellipsoid(references)
    points = on_the_ground(truth, SIX, -47.0, "EPSG:25832+7837")
    monkeypatch.setattr(georef, "datum_height_m", lambda crs, lon_lat: None)
    found = georeference(centres, references, None, points)
    summary = found.summary()
    assert found.frame.crs == "EPSG:25832+7837" and summary["control"]["rmse_v_m"] < 0.03
    assert found.positions_off is not None and found.positions_off.off_m[2] == pytest.approx(47.0, abs=0.03)
    assert summary["positions_trusted"] == 46
    ground = found.frame.to_crs(found.fit.similarity(np.stack([one.x for one in points])))
    assert ground == pytest.approx(np.array([one.xyz for one in points]), abs=0.05)
    checks = [replace(one, role="check") for one in points]
    with pytest.raises(ControlError, match=r"cannot be compared. Its grid .*de_bkg_gcg2016.tif"):
        georeference(centres, references, None, checks)

    monkeypatch.setattr(
        georef, "datum_height_m", lambda crs, lon_lat: np.full(len(lon_lat), 47.0 if "7837" in crs else 0.0)
    )
    found = georeference(centres, references, None, points)
    assert found.positions_off is None and found.fit.inlier.all()
    judged = georeference(centres, references, None, checks)
    assert judged.summary()["check"]["rmse_v_m"] < 0.05
    assert heights_of(judged.frame.crs).kind == "ellipsoid"


def test_control_points_that_agree_with_rtk_are_above_the_ellipsoid_too() -> None:
    centres, references, truth = flown(curve())
    found = georeference(centres, above_the_ellipsoid(references), None, on_the_ground(truth, SIX))
    assert heights_of(found.frame.crs).kind == "ellipsoid"
    plain = georeference(centres, references, None, on_the_ground(truth, SIX))
    assert plain.frame.crs == "EPSG:25832"
    rows = dict(list(references.by_name.items())[:4])  # fewer than the control points, 47 m above them
    few = above_the_ellipsoid(replace(references, by_name=rows))
    outvoted = georeference(centres, few, None, on_the_ground(truth, SIX, -47.0))
    assert outvoted.frame.crs == "EPSG:25832" and outvoted.positions_off is not None
    assert outvoted.positions_off.off_m[2] == pytest.approx(47.0, abs=0.1)


def test_poor_positions_give_way_to_control_points_and_their_offset_is_stated() -> None:
    """GPS without corrections: good to 10 m upright, and 47 m above what control points say."""
    centres, references, truth = flown(curve(), accuracy_m=1.0)
    rows = {name: replace(one, sigma_m=(3.0, 3.0, 10.0)) for name, one in references.by_name.items()}
    references = replace(references, by_name=rows)
    agreeing = georeference(centres, references, None, on_the_ground(truth, SIX))
    assert agreeing.positions_off is None
    found = georeference(centres, references, None, on_the_ground(truth, SIX, -47.0))
    assert found.summary()["control"]["rmse_v_m"] < 0.05
    assert found.positions_off is not None and found.positions_off.off_m[2] == pytest.approx(47.0, abs=1.0)
    assert "m higher" in found.summary()["positions_off"]


def test_control_points_that_are_wrong_each_in_its_own_way_are_an_error_if_they_are_most() -> None:
    centres, references, truth = flown(curve())
    points = on_the_ground(truth, SIX)
    for k, wrong in enumerate([(30.0, 5.0, -9.0), (-20.0, 8.0, 12.0), (3.0, -44.0, 1.0), (9.0, 9.0, 30.0)]):
        points[k] = replace(points[k], xyz=tuple(np.add(points[k].xyz, wrong)))
        if k == 1:
            found = georeference(centres, references, None, points)
            assert found.summary()["not_trusted"] == ["p0", "p1"]
            assert [one.trusted for one in found.points] == [False, False, True, True, True, True]
    with pytest.raises(ControlError, match=r"only 2 agree with a test within 4 .* off by p2 4\d\.\d\d m"):
        georeference(centres, references, None, points)


def test_control_points_hold_what_positions_do_not() -> None:
    """A straight track with poor positions, and four points on the ground: their turn, scale and CRS."""
    straight = np.stack([np.linspace(0, 200, 40), np.linspace(0, 80, 40), np.full(40, 30.0)], 1)
    centres, references, truth = flown(straight, accuracy_m=2.0)
    corners = np.array([[20.0, 40, 0], [150, 100, 2], [180, 20, 1], [30, -20, 3]])
    utm = LocalFrame("EPSG:32632", PLACE.origin)
    control = [
        Anchor(f"p{i}", ((place - truth.shift) @ truth.R) / truth.scale, tuple(xyz), (0.02,) * 3, utm.crs)
        for i, (place, xyz) in enumerate(zip(corners, utm.to_crs(corners), strict=True))
    ]
    found = georeference(centres, references, None, control)
    assert found.held_by == "positions" and found.frame.crs == "EPSG:32632"
    assert found.source == "a test and 4 control points" and found.fit.roll_sigma_deg < 0.1
    x = ((corners - truth.shift) @ truth.R) / truth.scale
    assert np.abs(utm.to_local(found.frame.to_crs(found.fit.similarity(x))) - corners).max() < 0.05
    alone = georeference({}, replace(references, by_name={}), None, control)
    assert alone.source == "4 control points" and alone.fit.inlier.all()
