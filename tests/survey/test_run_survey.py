"""From a cloud, a scene or a run to a survey: values, from end to end."""

import dataclasses
import json
import sys
from pathlib import Path

import numpy as np
import pytest
from tests.support.drawn import draw, hanging, polyline, scene_of, two_passes
from tests.support.lidar_clouds import line
from tests.support.tiny_run import Recorder, tiny_config
from tests.survey.lidar.test_las import write_las

from plnerf.cli.main import main
from plnerf.line.ends import Attached, Evidence, Open
from plnerf.line.files import read_survey
from plnerf.line.survey import Survey
from plnerf.line.wire import Wire
from plnerf.survey.config import SurveyConfig
from plnerf.survey.lidar.point_cloud import PointCloud, read_cloud
from plnerf.survey.run import survey_cloud, survey_run, survey_scene
from plnerf.survey.wire_evidence import WireEvidenceConfig, by_images, by_points, points_on
from plnerf.survey.wire_points import WirePointsConfig
from plnerf.train.loop import train
from plnerf.train.run import TrainedRun, open_run

RD = np.array([230_000.0, 570_000.0, 0.0])
SMALL = SurveyConfig(pictures=2)


@pytest.fixture(scope="module")
def run(built_tiny_scene: Path, tmp_path_factory: pytest.TempPathFactory) -> TrainedRun:
    folder = tmp_path_factory.mktemp("survey") / "run"
    return open_run(train(tiny_config(built_tiny_scene, steps=3), folder, Recorder()))


def cloud_of(xyz: np.ndarray) -> PointCloud:
    return PointCloud(xyz, "EPSG:28992", Path("line.laz"))


def test_a_cloud_becomes_a_folder_with_a_report(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    made = line(np.array([[0.0, 0.0], [110.0, 20.0]]))
    cloud = write_las(tmp_path / "line.laz", made.xyz + RD)
    words = ["plnerf", "survey", str(cloud), "--voltage-kv", "230", "--temperature-c", "35"]
    monkeypatch.setattr(sys, "argv", words)
    main()
    folder = tmp_path / "line-survey"
    assert str(folder) in capsys.readouterr().out
    names = {path.name for path in folder.iterdir()}
    assert {"report.html", "survey.json", "cloud.laz", "conductors.csv", "conductors.geojson"} <= names
    survey = read_survey(folder / "survey.json")
    assert len(survey.wires) == len(made.wires) and len(survey.structures) == 2
    assert survey.frame.crs == "EPSG:28992" and survey.temperature_c == 35
    assert survey.settings["clearance"]["voltage_kv"] == 230
    sags = sorted(wire.sag.value for wire in survey.wires if wire.sag is not None)
    true = sorted(wire.sag.value for wire in made.wires if wire.sag is not None)
    # Ends lie where structures are seen, up to half a metre from the true ones: of sag that is 2 %.
    assert len(true) == len(made.wires) and sags == pytest.approx(true, rel=0.03)
    assert survey.clearances is not None and survey.clearances.requirement is not None
    assert survey.clearances.requirement.distance_m == pytest.approx(4.0 * 0.3048)
    assert any(survey.clearances.verdict(place) for place in survey.clearances.all_places())


def test_a_cloud_without_wires_says_so() -> None:
    made = line(np.array([[0.0, 0.0], [110.0, 20.0]]))
    survey = survey_cloud(cloud_of(made.xyz[np.isin(made.truth, (2, 5))] + RD))
    assert survey.wires == () and survey.structures == () and survey.clearances is None
    assert any("No wires were found" in finding.text for finding in survey.findings)
    assert len(survey.cloud.xyz) and not survey.from_images


def test_a_survey_does_not_depend_on_where_on_the_earth_it_is() -> None:
    made = line(np.array([[0.0, 0.0], [110.0, 20.0]]))
    here, there = survey_cloud(cloud_of(made.xyz)), survey_cloud(cloud_of(made.xyz + RD))
    assert len(here.wires) == len(there.wires)
    for one, other in zip(here.wires, there.wires, strict=True):
        ends = [survey.frame.to_world(wire.polyline()[[0, -1]]) for survey, wire in
                ((here, one), (there, other))]  # fmt: skip
        np.testing.assert_allclose(ends[1] - RD, ends[0], atol=1e-4)


def apart(wire: Wire, other: Wire) -> float:
    """The greatest distance of the one from the other, along the other."""
    points = other.polyline()
    return float(np.linalg.norm(wire.points(wire.base.local(points)[:, 0]) - points, axis=1).max())


def drawn(folder: Path) -> tuple[Survey, list[Wire]]:
    """A survey from images and poses of three wires drawn into pictures, in a scene of two metres."""
    wires = [hanging(-0.08, 0.05), hanging(0.06, 0.02, 0.03), hanging(0.0, 0.1, 0.05)]
    cameras = two_passes(10)
    scene = scene_of(folder, cameras, draw(cameras, [polyline(wire) for wire in wires]))
    refine = dataclasses.replace(SMALL.refine, diameter_m=0.006)
    return survey_scene(scene, dataclasses.replace(SMALL, refine=refine)), wires


@pytest.mark.slow
def test_a_scene_is_surveyed_without_training(tmp_path: Path) -> None:
    survey, wires = drawn(tmp_path)
    assert len(survey.wires) == len(wires) and survey.from_images and survey.wire_points is None
    assert [wire.id for wire in survey.wires] == [1, 2, 3]
    for wire in survey.wires:
        # No structure is in the pictures: the ends are open, so that no sag, span or p is stated.
        assert wire.sag is None and wire.span_m is None and wire.p_m is None
        assert all(isinstance(end, Open) for end in wire.ends) and wire.open
        nearest = min(apart(wire, true) for true in wires)
        assert nearest < 0.01  # three pixels
    assert any("no sag is stated" in finding.text for finding in survey.findings)
    assert len(survey.pictures) == 2 and len(survey.pictures[0].wires) == 3
    assert [wire.id for wire in survey.detected] == [1, 2, 3]
    assert json.dumps(dict(survey.settings))


@pytest.mark.slow
def test_a_curve_that_photos_show_nowhere_is_left_out(tmp_path: Path) -> None:
    """It was stated as a conductor, with a note that it stands out at 2 % of its places."""
    wires = [hanging(-0.08, 0.05), hanging(0.06, 0.02, 0.03), hanging(0.0, 0.1, 0.05)]
    known = [
        dataclasses.replace(one, evidence=dataclasses.replace(one.evidence, reach_m=0.01))
        for one in (*wires, hanging(0.14, -0.1, 0.02))
    ]
    cameras = two_passes(10)
    scene = scene_of(tmp_path, cameras, draw(cameras, [polyline(wire) for wire in wires]))
    refine = dataclasses.replace(SMALL.refine, diameter_m=0.006, piece_m=0.05)
    # These cameras stand far apart.  With wide pairs the wires that nobody knows of would be stereo points.
    pairs = dataclasses.replace(SMALL.stereo.pairs, wide_baseline=SMALL.stereo.pairs.max_baseline)
    config = dataclasses.replace(
        SMALL, refine=refine, stereo=dataclasses.replace(SMALL.stereo, pairs=pairs)
    )
    survey = survey_scene(scene, config, finder=lambda scene, config, progress: known)
    assert [min(apart(wire, true) for true in wires) < 0.01 for wire in survey.wires] == [True] * 3
    assert [wire.id for wire in survey.detected] == [1, 2, 3]
    assert any("were detected: 1. " in one.text for one in survey.findings)
    none = survey_scene(scene, config, finder=lambda scene, config, progress: known[3:])
    assert not none.wires and any("show no line that hangs" in one.text for one in none.findings)


def test_a_run_whose_preset_detected_no_wires_is_surveyed_by_detecting_them(run: TrainedRun) -> None:
    assert run.wires is None
    survey = survey_run(run, SMALL)
    assert survey.wires == () and survey.wire_points is not None
    assert any("show no line that hangs" in finding.text for finding in survey.findings)
    assert survey.made["preset"] == "pl-nerf, step 3"


def test_progress_ends_at_its_end(run: TrainedRun) -> None:
    told: list[tuple[int, int]] = []
    survey_run(run, SMALL, lambda done, of: told.append((done, of)))
    shares = [done / of for done, of in told]
    assert all(0 <= share <= 1 for share in shares) and len(told) > 10


def test_points_of_a_field_are_the_evidence_of_a_wire() -> None:
    wire = dataclasses.replace(hanging(0.0, 0.0), evidence=Evidence("9 images", 9))
    scaled = dataclasses.replace(
        wire,
        base=dataclasses.replace(wire.base, a=wire.base.a * 20, b=wire.base.b * 20),
        theta=wire.theta * [20, 20, 20, 20, 20, 1],
    )
    length = scaled.base.length_m
    points = scaled.points(np.linspace(0.0, length / 2, 400)) + np.array([0.0, 0.1, 0.0])
    found = by_points(scaled, points, WireEvidenceConfig())
    assert found.evidence.coverage == pytest.approx(0.5, abs=0.02)
    assert found.evidence.longest_gap_m == pytest.approx(length / 2, abs=0.5)
    assert found.evidence.residual_across_m == pytest.approx(0.1, abs=1e-3)
    assert found.evidence.source == "9 images, and 400 points of the field" and found.notes == ()
    assert points_on(scaled, points + np.array([0.0, 1.0, 0.0]), 0.25).sum() == 0
    none = by_points(scaled, np.zeros((0, 3)), WireEvidenceConfig())
    assert none.evidence.coverage == 0 and none.notes == ("The field shows no point of it.",)


def test_stretches_that_images_show_are_the_evidence_of_a_wire() -> None:
    wire = hanging(0.0, 0.0)
    length = wire.base.length_m
    seen = dataclasses.replace(wire.evidence, seen_m=((0.0, length / 4), (length / 2, length)))
    found = by_images(dataclasses.replace(wire, evidence=seen)).evidence
    assert found.coverage == pytest.approx(0.75) and found.longest_gap_m == pytest.approx(length / 4)
    nothing = by_images(dataclasses.replace(wire, evidence=dataclasses.replace(seen, seen_m=()))).evidence
    assert nothing.coverage == 0 and nothing.longest_gap_m == pytest.approx(length)


@pytest.mark.slow
def test_a_line_of_three_structures_has_its_spans_in_order(tmp_path: Path) -> None:
    made = line(np.array([[0.0, 0.0], [110.0, 20.0], [205.0, 90.0]]))
    survey = survey_cloud(read_cloud(write_las(tmp_path / "line.laz", made.xyz + RD)))
    assert [span.id for span in survey.spans] == [1, 2] and [one.id for one in survey.structures] == [1, 2, 3]
    assert [span.structures for span in survey.spans] == [(1, 2), (2, 3)]
    for span in survey.spans:
        for wire in span.wires:
            assert [end.structure for end in wire.ends if isinstance(end, Attached)] == list(span.structures)
            assert survey.span_of(wire.id) is span


def test_settings_that_cannot_be_are_refused() -> None:
    with pytest.raises(Exception, match="pictures of 0 or more"):
        SurveyConfig(pictures=-1)
    assert SurveyConfig(points=WirePointsConfig()).points == WirePointsConfig()
