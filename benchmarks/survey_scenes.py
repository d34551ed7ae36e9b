"""How far the surveys of some scenes are off: from images and poses alone, or of trained runs.

    python benchmarks/raster_scenes.py SCENES --names forest hills ...
    python benchmarks/survey_scenes.py SCENE_OR_RUN... [-o docs/results/survey.md]

Each scene is surveyed with the default settings and scored against its truth.json, which nothing but the
score reads.  Writes a table in Markdown and, beside it, the same as JSON, scene by scene: what is there of an
earlier call and not measured again stays.  Deterministic; seconds are those of the machine it runs on.
"""

import argparse
import json
import platform
import tempfile
import time
from pathlib import Path
from typing import Any

import plnerf

HEAD = (
    "| scene | wires | across | up | sag, common | sag, stated | no sag | ground | plants | limits | s |\n"
    "| --- | ---: | ---: | ---: | ---: | ---: | ---: | ---: | ---: | ---: | ---: |\n"
)
RULES = """
Found of the true wires that enough images show (and invented ones, if any); the worst wire's root mean square
distance across and up; the worst error of a sag over the stretch that wire and survey share, and between the
structures found, for the wires whose both ends a structure holds; the number of wires for which no sag is
stated, since an end is open; the worst error of a height above ground, and of a wire's distance to its
nearest plant, in metres, with how many of their stated standard deviations that is.  Limits: how many of
these distances are stated as at most so much, which is an error only where what is true is more.

Nothing says where a line runs: directions and places are found in the images.
"""


def measure(place: Path) -> dict[str, Any]:
    """The row of one scene or run."""
    started = time.perf_counter()
    if (place / "checkpoints").is_dir():
        run = plnerf.open_run(place)
        survey, root = plnerf.survey_run(run), run.scene.root
    else:
        with tempfile.TemporaryDirectory() as store:
            scene = plnerf.load_scene(place, store=Path(store))
            survey, root = plnerf.survey_scene(scene), scene.root
    seconds = time.perf_counter() - started
    score = plnerf.score_survey(survey, plnerf.read_truth(root / "truth.json"))
    found, ground, least = score.wires.matches, score.clearances.ground, score.clearances.vegetation
    plants = score.clearances.vegetation_of_wires or ([least] if least is not None else [])
    plants = [one for one in plants if one.sigma_m is not None]
    stated = [one for one in found if one.sag_found_m is not None]
    return {
        "found": len(found),
        "true": len(found) + len(score.wires.missing),
        "invented": len(score.wires.invented),
        "across_m": max((one.rmse_across_m for one in found), default=None),
        "up_m": max((one.rmse_up_m for one in found), default=None),
        "sag_common_m": worst([one.sag_common_found_m - one.sag_common_m for one in found]),
        "sag_stated_m": worst([one.sag_found_m - one.sag_m for one in stated]),
        "no_sag": len(found) - len(stated),
        "ground": in_sigmas([one for one in ground if one.error_m is not None]),
        "plant": in_sigmas([one for one in plants if not one.at_most or one.error_m < 0]),
        "limits": sum(one.at_most for one in plants),
        "seconds": round(seconds, 1),
    }


def worst(values: list[float]) -> float | None:
    """The value farthest from 0."""
    return max(values, key=abs, default=None)


def in_sigmas(compared: list[Any]) -> tuple[float, float] | None:
    """The worst error, and in stated standard deviations."""
    if not compared:
        return None
    one = max(compared, key=lambda one: abs(one.error_m))
    return one.error_m, abs(one.error_m) / one.sigma_m


def row(name: str, data: dict[str, Any]) -> str:
    """A row of the table; lengths of wires in centimetres."""

    def cm(key: str) -> str:
        return "–" if data[key] is None else f"{100 * data[key]:.1f} cm"

    def metres(key: str) -> str:
        return "–" if data[key] is None else f"{data[key][0]:+.2f} m ({data[key][1]:.1f} σ)"

    wires = f"{data['found']} of {data['true']}" + (f", {data['invented']} invented" * bool(data["invented"]))
    cells = [wires, *map(cm, ("across_m", "up_m", "sag_common_m", "sag_stated_m")), str(data["no_sag"]),
             metres("ground"), metres("plant"), str(data["limits"]), f"{data['seconds']:.0f}"]  # fmt: skip
    return f"| {name} | " + " | ".join(cells) + " |\n"


def main() -> None:
    """Measures and writes after each scene."""
    as_written = argparse.RawDescriptionHelpFormatter
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=as_written)
    parser.add_argument("places", nargs="+", type=Path, help="scene or run folders")
    parser.add_argument("-o", "--out", type=Path, default=Path("docs/results/survey.md"))
    options = parser.parse_args()
    kept = options.out.with_suffix(".json")
    rows = json.loads(kept.read_text()) if kept.exists() else {}
    options.out.parent.mkdir(parents=True, exist_ok=True)
    for place in options.places:
        rows[place.name] = measure(place)
        kept.write_text(json.dumps(rows, indent=1) + "\n")
        table = HEAD + "".join(row(name, rows[name]) for name in sorted(rows))
        how = f"Written by `python benchmarks/survey_scenes.py`, {platform.machine()}, plnerf "
        options.out.write_text(f"# Surveys against the truth\n\n{table}{RULES}\n{how}{plnerf.__version__}.\n")
        print(row(place.name, rows[place.name]), end="", flush=True)


if __name__ == "__main__":
    main()
