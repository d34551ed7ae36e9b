"""Whether the planted encroachments of `encroachments.py` are listed from photos alone, and none that is not
there: `python benchmarks/encroachments_photos.py OUT [--seed 1]`.

The same span is photographed from both sides and at two heights (`raster.py`); the survey gets images, poses
and the lens, and the same rules, storm and growth.  `OUT/scene` holds the photos, `OUT/survey` the survey and
its report.  What is printed is explained in `encroachments.py`.
"""

import argparse
import json
import math
import multiprocessing
import time
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from encroachments import (
    CROSSING_AT_M,
    GROWTH_M,
    RULES,
    STORM,
    TEMPERATURE_C,
    YEARS,
    flight,
    planted_site,
    score,
)
from PIL import Image
from raster import Bodies, bodies_of, picture

from plnerf.detect.config import DetectConfig
from plnerf.detect.config_windows import WindowConfig
from plnerf.mechanics.config import MechanicsConfig
from plnerf.ops.cpu_arrays import usable_cores
from plnerf.pipeline import survey as survey_of
from plnerf.survey.config import SurveyConfig
from plnerf.survey.config_encroachments import EncroachmentConfig
from plnerf.survey.config_rules import RulesConfig
from plnerf.survey.stereo.config import StereoConfig
from plnerf.synth.capture import View, look
from plnerf.synth.check import check_cameras
from plnerf.synth.config import ImageConfig
from plnerf.synth.effects import sensor_noise
from plnerf.synth.flight_config import CaptureConfig
from plnerf.synth.render import to_srgb
from plnerf.synth.site import Site
from plnerf.synth.synthesize import transforms_of

CAPTURE = CaptureConfig(width_px=960, height_px=640, focal_px=860.0)
IMAGE = ImageConfig(noise=0.01)
NEAR = 0.4
"""Windows in which wires are searched use the views that stand within so much of a window's length of them:
from farther away these cameras, which look ahead and aside, show its wires half a pixel wide."""
STEREO_PX = 480
"""Photos are matched at half their size: a third of the time; tops of ten trees moved by 0.25 m (median)."""


@dataclass(frozen=True)
class Leg:
    """A flight straight from one place to another, each given along and across the span (left positive)."""

    start: tuple[float, float]
    end: tuple[float, float]
    above_m: float
    """Above the phases' height there."""
    left_deg: float
    """How far the camera is turned from straight ahead,"""
    down_deg: float
    """and tilted."""
    step_m: float = 6.0
    """From photo to photo."""


C = CROSSING_AT_M
FLIGHT = (
    Leg((-225.0, -20.0), (185.0, -20.0), 2.0, 52.0, 12.0),
    Leg((225.0, 20.0), (-185.0, 20.0), 2.0, 52.0, 12.0),
    Leg((-225.0, -15.0), (185.0, -15.0), 11.0, 48.0, 38.0),
    Leg((225.0, 15.0), (-185.0, 15.0), 11.0, 48.0, 38.0),
    Leg((C - 9.0, -50.0), (C - 9.0, 50.0), 13.0, -50.0, 45.0, 3.0),
    Leg((C + 9.0, 50.0), (C + 9.0, -50.0), 13.0, -50.0, 45.0, 3.0),
    Leg((C - 10.0, -54.0), (C - 10.0, -15.0), -1.0, -50.0, 10.0, 3.0),
    Leg((C + 10.0, 54.0), (C + 10.0, 15.0), -1.0, -50.0, 10.0, 3.0),
)
"""Both sides of the span at two heights, forth and back, and the same of the line that crosses it; the camera
looks ahead and towards the wires, and so the legs begin before the towers.  The crossing wires are half as
thick as the phases: nearer photos, and twice as many of them, show them."""


def views_of(site: Site, seed: int) -> tuple[View, ...]:
    """The photos' cameras in the order in which they are taken, by a drone that sways a little."""
    rng = np.random.default_rng([seed, 37])
    phases = [wire for span in site.lines[0].spans for wire in span.wires if wire.kind == "phase"]
    curve = np.concatenate([wire.polyline(0.5) for wire in phases])
    curve = curve[np.argsort(curve[:, 0])]
    views: list[View] = []
    for leg in FLIGHT:
        way = np.subtract(leg.end, leg.start)
        length = float(np.hypot(*way))
        for share in np.arange(0.0, length, leg.step_m) / length:
            along, across = leg.start + share * way
            height = float(np.interp(along, curve[:, 0], curve[:, 2])) + leg.above_m
            sway, shake = rng.normal(0.0, 0.25, 3), np.radians(rng.normal(0.0, 1.0, 3))
            azimuth = math.atan2(way[1], way[0]) + math.radians(leg.left_deg) + shake[0]
            R = look(azimuth, shake[1] - math.radians(leg.down_deg), shake[2])
            views.append(View(f"{len(views):04d}", "", R, np.array([along, across, height]) + sway))
    return tuple(views)


def write_scene(folder: Path, site: Site, views: tuple[View, ...], seed: int) -> None:
    """images/ and transforms.json: nothing of the truth."""
    (folder / "images").mkdir(parents=True)
    content = transforms_of(CAPTURE, views)
    kept = ("file_path", "transform_matrix")
    content["frames"] = [{key: frame[key] for key in kept} for frame in content["frames"]]  # type: ignore[attr-defined]
    content["plnerf"].pop("truth")  # type: ignore[attr-defined]
    (folder / "transforms.json").write_text(json.dumps(content, indent=1) + "\n")
    TAKEN.append((bodies_of(site, IMAGE), folder / "images", seed))
    with multiprocessing.get_context("fork").Pool(usable_cores()) as pool:
        list(pool.imap_unordered(_take, views, 4))


TAKEN: list[tuple[Bodies, Path, int]] = []
"""What the processes that take the photos share."""


def _take(view: View) -> None:
    bodies, folder, seed = TAKEN[-1]
    linear = picture(bodies, view, CAPTURE)
    noisy = sensor_noise(linear, IMAGE.noise, np.random.default_rng([seed, 41, int(view.name)]))
    Image.fromarray(to_srgb(noisy)).save(folder / f"{view.name}.jpg", quality=95, subsampling=0)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("out", type=Path)
    parser.add_argument("--seed", type=int, default=1)
    options = parser.parse_args()
    options.out.mkdir(parents=True, exist_ok=True)
    for name, text in (("rules.toml", RULES), ("storm.toml", STORM)):
        (options.out / name).write_text(text)
    mechanics = MechanicsConfig(conductor=Path("acsr-drake"), states=options.out / "storm.toml")
    scene = flight(options.seed)
    ground = replace(scene.span.terrain, fine_m=(220.0, 56.0), texel_m=0.06)
    site, planted = planted_site(replace(scene, span=replace(scene.span, terrain=ground)), mechanics)
    folder = options.out / "scene"
    if not folder.exists():
        views = views_of(site, options.seed)
        check_cameras(site, views)
        began = time.monotonic()
        write_scene(folder, site, views, options.seed)
        print(f"{len(views)} photos in {time.monotonic() - began:.0f} s")
    config = SurveyConfig(
        detect=DetectConfig(windows=WindowConfig(near=NEAR)), stereo=StereoConfig(longest_px=STEREO_PX),
        rules=RulesConfig(options.out / "rules.toml", 110.0), mechanics=mechanics,
        temperature_c=TEMPERATURE_C,
        encroachments=EncroachmentConfig(growth_m=GROWTH_M, growth_years=YEARS),
    )  # fmt: skip
    began = time.monotonic()
    survey, _ = survey_of(folder, config, options.out / "survey")
    print(f"surveyed in {time.monotonic() - began:.0f} s")
    score(survey, planted, len(site.lines[0].config.wires) - 1, len(site.lines[1].config.wires))


if __name__ == "__main__":
    main()
