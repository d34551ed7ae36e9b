"""Wires, sags and clearances from posed images alone: no radiance field is trained.

python examples/05_wires_without_training.py OUT [--scene SCENE] [--voltage-kv 230] [--quick]

Wires are detected as ridges that the images agree on, and refitted to them; stereo shows the ground and what
stands on it.  OUT gets the report and the files for other programs.
"""

import argparse
from dataclasses import replace
from pathlib import Path

from small_inputs import few_photos

import plnerf
from plnerf.pipeline import bundled_span


def main(scene_folder: Path, out: Path, voltage_kv: float | None, downscale: int) -> None:
    """Prints the wires, then surveys the scene into OUT."""
    scene = plnerf.load_scene(scene_folder, downscale=downscale)
    for wire in plnerf.detect_wires(scene):
        known = "certain" if wire.evidence.certain else "not fixed by the views"
        print(f"wire {wire.id}: {wire.length_m:.1f} m, {wire.evidence.source}, {known}")

    config = plnerf.SurveyConfig()
    config = replace(config, clearance=replace(config.clearance, voltage_kv=voltage_kv))
    survey = plnerf.survey_scene(scene, config)
    for wire in survey.wires:
        sag = wire.sag
        print(
            f"wire {wire.id}: sag {sag.value:.2f} m ± {sag.half_95:.2f} m"
            if sag
            else f"wire {wire.id}: {wire.open}"
        )
    for finding in survey.findings:
        print(f"{finding.degree}: {finding.text}")
    print(f"report: {plnerf.write_survey(survey, out)}")


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("out", type=Path)
    parser.add_argument("--scene", type=Path, default=bundled_span())
    parser.add_argument("--voltage-kv", type=float)
    parser.add_argument("--quick", action="store_true", help="few, small photos: fewer wires are found")
    args = parser.parse_args()
    scene = few_photos(args.out / "few-photos", every=4) if args.quick else args.scene
    main(scene, args.out, args.voltage_kv, 2 if args.quick else 1)
