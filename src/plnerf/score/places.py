"""Where a score finds its files: the survey or the points that are judged, and the truth.

What is judged and the truth meet only through files, so that the survey may come from any program.
"""

from pathlib import Path

from plnerf.errors import SurveyError
from plnerf.line.files import SURVEY_FILE
from plnerf.scene.formats import read_listing
from plnerf.scene.strict_json import object_of, read_json, shown
from plnerf.scene.whole_result import finish_exchange

POINT_FILES = ("wires.ply", "conductors.geojson", "survey/wires.ply", "survey/conductors.geojson")
"""Searched for in a folder, in this order."""


def find_survey(place: Path) -> Path | None:
    """The survey.json itself, or that of a survey or run folder; None: there is none.

    A survey whose files were being exchanged when that was interrupted is put in its place first.
    """
    for folder in (place, place / "survey", place.parent):
        finish_exchange(folder)
    if not place.is_dir():
        return place if place.name == SURVEY_FILE else None
    found = (folder / SURVEY_FILE for folder in (place, place / "survey"))
    return next((path for path in found if path.is_file()), None)


def points_beside(survey_at: Path) -> Path | None:
    """Points of a survey of images; one of LiDAR has none of its own."""
    points = survey_at.with_name(POINT_FILES[0])
    return points if points.is_file() else None


def find_points(survey: Path) -> Path:
    """The file itself, or what a run or survey folder holds."""
    if not survey.is_dir():
        return survey
    for name in POINT_FILES:
        if (survey / name).is_file():
            return survey / name
    raise SurveyError(
        f"{survey} holds no points of wires: none of {', '.join(POINT_FILES)} is there. Give the file "
        "itself, or make the survey first."
    )


def find_truth(place: Path) -> Path:
    """A truth.json, or that of a scene folder (the one that its transforms.json names, else truth.json)."""
    if not place.is_dir():
        return place
    if (place / "transforms.json").is_file():
        named = read_listing(place).truth
        if named is not None:
            return named
    if (place / "truth.json").is_file():
        return place / "truth.json"
    raise SurveyError(
        f"The scene {place} has no truth.json, so nothing is known to compare with. Only synthetic scenes "
        "and surveyed ones have a truth; name its file: --truth truth.json."
    )


def scene_of(judged: Path, survey: Path) -> Path:
    """The scene that the run around a survey was trained on; judged: the file of it that is taken."""
    for folder in (survey, judged.parent, judged.parent.parent):
        config = folder / "config.json"
        if config.is_file():
            do = "Its truth is not known then; name it: --truth truth.json."
            scene = object_of(read_json(config, SurveyError, do), str(config), SurveyError, do).get("scene")
            if not isinstance(scene, str):
                raise SurveyError(f"{config} names no scene, but {shown(scene)}. {do}")
            return Path(scene)
    raise SurveyError(
        f"{survey} lies in no run folder, so it is not known what to compare it with. Name the truth: "
        "--truth truth.json (or the scene folder that holds it)."
    )
