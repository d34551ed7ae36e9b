"""How accurate wires are when the poses come from structure from motion, in place of exact ones.

    python benchmarks/sfm_span.py OUT            # renders the span, flown so that its passes share features
    python benchmarks/sfm_span.py OUT --scene S  # takes a scene that `plnerf synth` made

OUT/flight/    the rendered scene, with exact poses
OUT/photos/    its images with the focal length in EXIF, and geo.txt: centres as RTK states them, with noise
OUT/scene/     what `plnerf capture` makes of them, and the true wires in its frame (truth.json)

Printed: camera centres and directions against the true ones, and the wires that are detected, as they are and
refitted to the images, with the captured and with the exact poses, against the true ones.
"""

import argparse
import json
import tempfile
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from plnerf.capture.capture import CaptureConfig, capture
from plnerf.capture.local_frame import LocalFrame
from plnerf.capture.sfm import SfmConfig
from plnerf.capture.similarity import Similarity
from plnerf.capture.summary import read_report, summary
from plnerf.detect.detect import detect_wires
from plnerf.scene.files import write_text
from plnerf.scene.formats import read_listing
from plnerf.scene.listing import Listing
from plnerf.scene.scene import Scene, load_scene
from plnerf.score.truth import Truth, read_truth
from plnerf.score.wire_matches import Match, match_wires
from plnerf.survey.posed_photos import photos_of
from plnerf.survey.refine.config import RefineConfig
from plnerf.survey.refine.refine import refine_wires
from plnerf.synth.photos import PLACE, write_photos
from plnerf.synth.scene_options import SceneOptions, find_scene
from plnerf.synth.synthesize import synthesize


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("out", type=Path)
    parser.add_argument("--scene", type=Path, help="scene folder with exact poses, not rendered")
    parser.add_argument("--noise", type=float, default=0.02, help="of the stated positions, metres each axis")
    parser.add_argument("--seed", type=int, default=0, help="of that noise, and of structure from motion")
    parser.add_argument("--samples", type=int, default=16, help="per pixel, where it is rendered")
    parser.add_argument("--threads", type=int, default=-1, help="of structure from motion; 1 repeats exactly")
    given = parser.parse_args()
    given.out.mkdir(parents=True, exist_ok=True)
    flight = given.scene or given.out / "flight"
    if not flight.exists():
        synthesize(flight, SceneOptions(samples=given.samples).apply(find_scene("same-way")))
    exact = read_listing(flight)
    write_photos(flight, given.out / "photos", given.noise, given.seed)
    config = CaptureConfig(SfmConfig(seed=given.seed, threads=given.threads))
    path = capture(given.out / "photos", given.out / "scene", config).parent
    print(summary(read_report(path)))
    content = json.loads((path / "transforms.json").read_text())["plnerf"]
    if content["unit"] != "m":
        raise SystemExit("The captured scene is not metric, so that it cannot be compared with the truth.")
    frame = LocalFrame.from_json(content)
    truth = json.loads((flight / "truth.json").read_text())
    write_text(path / "truth.json", json.dumps(moved(truth, frame)) + "\n")
    print(cameras_off(read_listing(path), exact, frame))
    for name, folder in (("captured", path), ("exact", flight)):
        with tempfile.TemporaryDirectory() as store:
            scene = load_scene(folder, store=Path(store))
            print(wires_off(f"{name} poses", scene, read_truth(folder / "truth.json")))


def moved(truth: dict[str, Any], frame: LocalFrame) -> dict[str, Any]:
    """The truth of the synthetic world in the captured one's frame, without what is of its images."""

    def there(points: Any) -> Any:
        return frame.to_local(PLACE.to_crs(np.atleast_2d(points))).reshape(np.shape(points)).tolist()

    wires = []
    for wire in truth["conductors"]:
        points = {key: there(wire[key]) for key in ("a", "b", "lowest", "polyline")}
        flat = np.subtract(points["b"], points["a"])[:2]
        height = wire["z0_m"] + points["a"][2] - wire["a"][2]
        direction = (flat / np.linalg.norm(flat)).tolist()
        wires.append({**wire, **points, "direction": direction, "z0_m": height})
    towers = [
        {**tower, "foot": there(tower["foot"]), "attachments": there(tower["attachments"])}
        for tower in truth["towers"]
    ]
    kept = ("format_version", "scene", "generator", "unit", "seed", "config", "catenary", "seen_rule")
    world = {"world": "as transforms.json", **frame.to_json()}
    return {**{key: truth[key] for key in kept}, **world, "conductors": wires, "towers": towers}


def cameras_off(found: Listing, exact: Listing, frame: LocalFrame) -> str:
    """How far the poses are from the true ones, in the true world: no similarity is fitted."""
    true = {shot.path.name: shot.T_world_camera for shot in exact.shots}
    poses = np.stack([shot.T_world_camera for shot in found.shots])
    truths = np.stack([true[shot.path.name] for shot in found.shots])
    centres = PLACE.to_local(frame.to_crs(poses[:, :3, 3]))
    off = 100 * np.linalg.norm(centres - truths[:, :3, 3], axis=1)
    turn = Rotation.from_matrix(poses[:, :3, :3] @ truths[:, :3, :3].transpose(0, 2, 1)).magnitude()
    return (
        f"{len(poses)} of {len(true)} cameras; centres {np.median(off):.1f} cm off (median), "
        f"{off.max():.1f} cm (worst); directions {np.degrees(np.median(turn)):.3f} and "
        f"{np.degrees(turn.max()):.3f} degrees"
    )


def wires_off(title: str, scene: Scene, truth: Truth) -> str:
    """A table: every true wire and the certain one that is it, as detected and refitted."""
    photos = photos_of(scene)
    true = truth.moved(Similarity(*photos.frame.similarity)).wires
    certain = [wire for wire in detect_wires(scene) if wire.evidence.certain]
    refined = refine_wires(photos, certain, RefineConfig())
    before, after = (match_wires(wires, true).matches for wires in (certain, refined.wires))
    lines = [
        f"\n| wire, {title} | detected: across | up | sag error | refitted: across | up | sag error |",
        "| --- |" + " ---: |" * 6,
    ]
    for wire in true:
        lines.append(f"| {wire.name} | {_cells(before, wire.name)} | {_cells(after, wire.name)} |")
    lines.append(
        f"{len(certain)} certain wires; the images lie {refined.pose_residual_px:.2f} px off their poses"
    )
    return "\n".join(lines)


def _cells(matches: Sequence[Match], name: str | None) -> str:
    """Root mean squares across and up, and how much the sag along the common stretch is too large."""
    one = next((match for match in matches if match.wire == name), None)
    if one is None:
        return "missing | - | -"
    across, up, sag = 100 * one.rmse_across_m, 100 * one.rmse_up_m, 100 * one.sag_common_error_m
    return f"{across:.2f} cm | {up:.2f} cm | {sag:+.2f} cm"


if __name__ == "__main__":
    main()
