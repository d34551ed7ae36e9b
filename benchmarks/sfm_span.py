"""How accurate conductors are when the poses come from structure from motion, in place of exact ones.

    python benchmarks/sfm_span.py OUT            # renders the span, flown so that its passes share features
    python benchmarks/sfm_span.py OUT --scene S  # takes a scene that `plnerf synth` made

OUT/flight/    the rendered scene, with exact poses
OUT/photos/    its images with the focal length in EXIF, and geo.txt: centres as RTK states them, with noise
OUT/scene/     what `plnerf capture` makes of them, and the true wires in its frame (truth.json)

Printed: camera centres and directions against the true ones, and the curves that are found at the start of
training, as they are and refitted, with the captured and with the exact poses, against the true wires.
"""

import argparse
import json
import tempfile
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float
from PIL import ExifTags, Image
from rich.console import Console
from scipy.spatial.transform import Rotation

from plnerf.capture.capture import CaptureConfig
from plnerf.capture.local_frame import LocalFrame
from plnerf.capture.report import capture_and_tell
from plnerf.capture.sfm import SfmConfig
from plnerf.detect.curves import Curve
from plnerf.detect.detect import find_curves
from plnerf.scene.files import write_text
from plnerf.scene.formats import read_listing
from plnerf.scene.listing import Listing
from plnerf.scene.scene import Scene, load_scene
from plnerf.survey.refine.curves import Line, refit_curves
from plnerf.synth.config import Pass
from plnerf.synth.options import SceneOptions, find_scene
from plnerf.synth.scene import synthesize

PLACE = LocalFrame("EPSG:4979", (10.0, 51.0, 250.0))
"""Where on the earth the synthetic world is put."""
FILM_DIAGONAL_MM = float(np.hypot(36, 24))
PASSES = (
    Pass("right", "phase A", -2.5, 0.8, -1.2, 0.74, 28.0, -4.0),
    Pass("left", "phase B", 2.4, 1.0, -1.2, 0.74, -28.0, -2.0),
    Pass("above", "shield", 0.0, 1.6, -1.2, 0.74, 0.0, -12.0),
)
"""All look the way out, and neighbours by 28 degrees apart, so that each shares features with the next."""


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
        span = SceneOptions(samples=given.samples).apply(find_scene("span"))
        synthesize(flight, replace(span, capture=replace(span.capture, passes=PASSES)))
    exact = read_listing(flight)
    write_photos(exact, given.out / "photos", given.noise, given.seed)
    config = CaptureConfig(SfmConfig(seed=given.seed, threads=given.threads))
    path = capture_and_tell(given.out / "photos", given.out / "scene", config, Console())
    content = json.loads((path / "transforms.json").read_text())["plnerf"]
    if content["unit"] != "m":
        raise SystemExit("The captured scene is not metric, so that it cannot be compared with the truth.")
    frame = LocalFrame.from_json(content)
    truth = json.loads((flight / "truth.json").read_text())
    write_text(path / "truth.json", json.dumps(moved(truth, frame)) + "\n")
    tell_cameras(read_listing(path), exact, frame)
    for name, folder, wires in (("captured", path, moved(truth, frame)), ("exact", flight, truth)):
        with tempfile.TemporaryDirectory() as store:
            scene = load_scene(folder, store=Path(store))
            tell_wires(f"{name} poses", scene, find_curves(scene), wires["conductors"])


def write_photos(exact: Listing, folder: Path, noise_m: float, seed: int) -> None:
    """The images as a camera with a known focal length and an RTK receiver leaves them."""
    folder.mkdir(exist_ok=True)
    centres = np.stack([shot.T_world_camera[:3, 3] for shot in exact.shots])
    off = noise_m * np.random.default_rng(seed).standard_normal(centres.shape)
    rows = [PLACE.crs]
    for shot, (x, y, z) in zip(exact.shots, PLACE.to_crs(centres + off), strict=True):
        lens, name = shot.intrinsics, shot.path.name
        with Image.open(shot.path) as image:
            exif = image.getexif()
            equivalent = round(FILM_DIAGONAL_MM * lens.fl_x / np.hypot(lens.width, lens.height))
            exif.get_ifd(ExifTags.IFD.Exif)[ExifTags.Base.FocalLengthIn35mmFilm] = equivalent
            image.save(folder / name, exif=exif, quality="keep")
        rows.append(f"{name} {x:.10f} {y:.10f} {z:.4f} 0 0 0 {noise_m} {noise_m}")
    write_text(folder / "geo.txt", "\n".join(rows) + "\n")


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


def tell_cameras(found: Listing, exact: Listing, frame: LocalFrame) -> None:
    """How far the poses are from the true ones, in the true world: no similarity is fitted."""
    true = {shot.path.name: shot.T_world_camera for shot in exact.shots}
    poses = np.stack([shot.T_world_camera for shot in found.shots])
    truths = np.stack([true[shot.path.name] for shot in found.shots])
    centres = PLACE.to_local(frame.to_crs(poses[:, :3, 3]))
    off = 100 * np.linalg.norm(centres - truths[:, :3, 3], axis=1)
    turn = Rotation.from_matrix(poses[:, :3, :3] @ truths[:, :3, :3].transpose(0, 2, 1)).magnitude()
    print(
        f"{len(poses)} of {len(true)} cameras; centres {np.median(off):.1f} cm off (median), "
        f"{off.max():.1f} cm (worst); directions {np.degrees(np.median(turn)):.3f} and "
        f"{np.degrees(turn.max()):.3f} degrees"
    )


def tell_wires(title: str, scene: Scene, curves: Sequence[Curve], wires: list[dict[str, Any]]) -> None:
    """A table: for each true wire the certain curve nearest to it, as found and refitted, from end to end."""
    print(f"\n| wire, {title} | found: across | up | sag error | refitted: across | up | sag error |")
    print("| --- |" + " ---: |" * 6)
    certain = [curve for curve in curves if curve.certain]
    refits, motion_px = refit_curves(scene, certain, 1.0)
    for wire in wires:
        line = np.array(wire["polyline"])
        rows = [[100 * _apart(one, line) for one in (refit.before, refit.after)] for refit in refits]
        before, after = min(rows, key=lambda row: float(np.hypot(*row[0][:2])))
        cells = [f"{one[0]:.2f} cm | {one[1]:.2f} cm | {one[2]:+.2f} cm" for one in (before, after)]
        print(f"| {wire['name']} | {cells[0]} | {cells[1]} |")
    print(f"{len(certain)} certain curves; the images lie {motion_px:.2f} px off their poses")


def _apart(found: Line, line: Float[np.ndarray, "n 3"]) -> Float[np.ndarray, "3"]:
    """Root mean squares across and up, and how much the sag between the wire's true ends is too large."""
    local = found.base.local(line)
    local = local[np.argsort(local[:, 0])]
    s = np.linspace(local[0, 0], local[-1, 0], 400)
    true = np.stack([np.interp(s, local[:, 0], local[:, k]) for k in (1, 2)], 1)
    here = found.base.at(found.q, s)
    sags = [np.linspace(z[0], z[-1], len(s)) - z for z in (here[:, 1], true[:, 1])]
    return np.append(np.sqrt(((here - true) ** 2).mean(0)), sags[0].max() - sags[1].max())


if __name__ == "__main__":
    main()
