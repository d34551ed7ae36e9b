"""Detected wires are read where they were found of the same images, poses and settings, and only there."""

import json
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from tests.train.test_guidance import wire_of

from plnerf.detect.config import DetectConfig
from plnerf.detect.kept_wires import KeptWires
from plnerf.line.files import write_wires
from plnerf.line.frame import LineFrame
from plnerf.line.wire import Wire
from plnerf.scene.fingerprint import listing_sha256
from plnerf.scene.formats import read_listing
from plnerf.scene.scene import Scene, load_scene


@pytest.fixture
def scene(tiny_scene: Path) -> Scene:
    return load_scene(tiny_scene)


@pytest.fixture
def detections(monkeypatch: pytest.MonkeyPatch) -> list[DetectConfig]:
    """The settings of each detection, which finds one wire."""
    asked: list[DetectConfig] = []

    def detect(scene: Scene, config: DetectConfig, progress: object) -> tuple[Wire, ...]:
        asked.append(config)
        return (wire_of(scene, 1 / 3),)

    monkeypatch.setattr("plnerf.detect.kept_wires.detect_wires", detect)
    return asked


def test_what_is_read_is_what_was_detected(
    scene: Scene, tmp_path: Path, detections: list[DetectConfig]
) -> None:
    find = KeptWires(tmp_path / "wires.json", "of the scene")
    (first,), (again,) = find(scene, DetectConfig()), find(scene, DetectConfig())
    assert len(detections) == 1
    assert np.array_equal(first.theta, again.theta) and np.array_equal(first.covariance, again.covariance)
    assert (first.evidence, first.ends) == (again.evidence, again.ends)


def _cut(find: KeptWires) -> KeptWires:
    find.path.write_text(find.path.read_text()[:-20])
    return find


def _of_another_frame(find: KeptWires) -> KeptWires:
    data = json.loads(find.path.read_text())
    data["frame"]["scale"] *= 2
    find.path.write_text(json.dumps(data))
    return find


@pytest.mark.parametrize(
    "change",
    [lambda find: replace(find, scene_sha256="of another"), _cut, _of_another_frame],
    ids=["scene", "cut", "frame"],
)
def test_other_inputs_are_detected_anew(
    change: Callable[[KeptWires], KeptWires], scene: Scene, tmp_path: Path, detections: list[DetectConfig]
) -> None:
    find = KeptWires(tmp_path / "wires.json", "of the scene")
    find(scene, DetectConfig())
    find = change(find)
    for _ in range(2):  # the second reads what the first wrote
        find(scene, DetectConfig())
    assert len(detections) == 2


def test_other_settings_and_foreign_files_are_detected_anew(
    scene: Scene, tmp_path: Path, detections: list[DetectConfig]
) -> None:
    find, other = KeptWires(tmp_path / "wires.json", "of the scene"), DetectConfig().along(30.0)
    for config in (DetectConfig(), other, other):
        find(scene, config)
    assert detections == [DetectConfig(), other]
    write_wires(find.path, (), LineFrame.of_scene(scene.frames), {})  # without a fingerprint
    assert find(scene, other) and len(detections) == 3


def test_the_fingerprint_of_a_scene_is_of_what_it_shows(tiny_scene: Path, tmp_path: Path) -> None:
    before = listing_sha256(read_listing(tiny_scene))
    moved = tiny_scene.rename(tmp_path / "moved")
    assert listing_sha256(read_listing(moved)) == before
    data = json.loads((moved / "transforms.json").read_text())
    data["frames"][0]["transform_matrix"][0][3] += 1e-6
    (moved / "transforms.json").write_text(json.dumps(data))
    posed = listing_sha256(read_listing(moved))
    photos = sorted((moved / "images").iterdir())
    photos[0].write_bytes(photos[1].read_bytes())
    assert len({before, posed, listing_sha256(read_listing(moved))}) == 3
