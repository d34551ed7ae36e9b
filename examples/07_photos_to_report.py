"""All the way: photos or a video to poses, a field with its wires, a survey and its report.

python examples/07_photos_to_report.py PHOTOS OUT [--quick]

PHOTOS is a folder of photos, a video, or a scene with poses, for which structure from motion is left out.
The same on the command line: plnerf reconstruct PHOTOS -o OUT
"""

import argparse
from dataclasses import replace
from pathlib import Path

from small_inputs import few_photos

import plnerf
from plnerf.presets.pl_nerf_wire import PRESET
from plnerf.scene.formats import has_poses


def main(photos: Path, out: Path, seconds: float, downscale: int, few: bool) -> None:
    """OUT gets scene/ (if there were no poses), run/ and survey/."""
    scene = photos
    if not has_poses(photos):
        scene = plnerf.capture_scene(
            photos, out / "scene", progress=lambda stage, done, of: print(f"{stage}: {done} of {of}")
        )
    train = replace(PRESET.train, validations=2, checkpoints=1)
    folder = plnerf.train_scene(
        scene, out / "run", preset="pl-nerf-wire", train=train, seconds=seconds, downscale=downscale
    )
    run = plnerf.open_run(folder)
    print(f"{len(run.wires or ())} wires guided {run.step:,} steps of training")

    config = plnerf.SurveyConfig(pictures=2)
    if few:
        config = replace(config, surface=replace(config.surface, rays=2_000))
    survey = plnerf.survey_run(run, config)
    for wire in survey.wires:
        print(
            f"wire {wire.id}: {wire.sag.value:.2f} m of sag" if wire.sag else f"wire {wire.id}: {wire.open}"
        )
    print(f"report: {plnerf.write_survey(survey, out / 'survey')}")


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("photos", type=Path, help="not read with --quick, which brings its own")
    parser.add_argument("out", type=Path)
    parser.add_argument("--quick", action="store_true", help="a second of training on few, small photos")
    args = parser.parse_args()
    photos = few_photos(args.out / "few-photos", every=4) if args.quick else args.photos
    main(photos, args.out, *((1.0, 2) if args.quick else (300.0, 1)), args.quick)
