"""The score of a survey, of points or of curves, from files to a file.

A folder or survey.json of a survey is judged as one: its wires, its clearances, and the points in wires.ply
if they are there; any other file as points or curves.
"""

import json
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from plnerf.line.files import read_survey
from plnerf.scene.files import write_text
from plnerf.score import point_report, survey_report
from plnerf.score.align import Alignment, align, cameras_of, is_unscaled, true_cameras
from plnerf.score.clouds import read_points
from plnerf.score.config import DEFAULT, ScoreConfig
from plnerf.score.places import find_points, find_survey, find_truth, points_beside, scene_of
from plnerf.score.points import PointScore, score_points
from plnerf.score.survey_score import SurveyScore, score_survey
from plnerf.score.truth import read_truth


@dataclass(frozen=True)
class ScoreFiles:
    """What was compared with what, and how far it is off."""

    judged: Path
    """The survey.json, or the file of points or curves."""
    truth: Path
    path: Path
    """Of the score as JSON."""
    text: str
    """The score as tables in Markdown."""
    survey: SurveyScore | None
    """None: the file holds points or curves alone."""
    points: PointScore | None
    """None: there are no points beside the survey."""
    aligned: Alignment | None
    """None: the truth was taken as it is."""

    @property
    def places(self) -> str:
        """Two lines that name the files."""
        return f"{self.judged} against {self.truth}\nscore: {self.path}"


def score_files(
    place: Path,
    *,
    truth: Path | None = None,
    out: Path | None = None,
    classes: tuple[int, ...] | None = None,
    by_cameras: Path | None = None,
    config: ScoreConfig = DEFAULT,
) -> ScoreFiles:
    """Scores a survey, or points or curves alone, and writes the score as JSON.

    truth: a truth.json or a scene folder; None: that of the scene which the run around the survey was trained
    on.  out: None: beside the judged file, named after it.  classes: of a LAS file, as in `read_points`.
    by_cameras: a scene with the survey's poses, onto whose cameras the truth is first moved.  Raises
    SurveyError or SceneError where anything is not there, cannot be read, or is in another frame.
    """
    survey_at = find_survey(place)
    points_at = find_points(place) if survey_at is None else points_beside(survey_at)
    judged = survey_at or points_at
    assert judged is not None
    truth_at = find_truth(truth if truth is not None else scene_of(judged, place))
    known = read_truth(truth_at, config)
    aligned = None
    content: dict[str, Any] = {"survey": str(judged), "truth": str(truth_at)}
    tables = []
    if by_cameras is not None:
        known, aligned = align(
            known, true_cameras(truth_at), cameras_of(by_cameras), scaled=is_unscaled(truth_at)
        )
        content["aligned"] = asdict(aligned)
        tables.append(f"{aligned.words}\n")
    of_survey, of_points = None, None
    if survey_at is not None:
        own_unit = aligned is not None and aligned.scaled
        of_survey = score_survey(read_survey(survey_at), known, config.wires, unscaled=own_unit)
        content |= survey_report.to_json(of_survey, config.wires)
        tables.append(survey_report.markdown(of_survey))
    if points_at is not None:
        found = read_points(points_at, classes=classes, line_step_m=config.points.line_step_m)
        of_points = score_points(found.points, known, config.points)
        content |= point_report.to_json(of_points, config.points) | {"taken": found.taken}
        tables.append(f"Points ({found.taken}):\n\n{point_report.markdown(of_points, config.points)}")
    path = out or judged.with_name(f"{judged.stem}.score.json")
    content["settings"] = asdict(config)
    write_text(path, json.dumps(content, indent=1, allow_nan=False) + "\n")
    return ScoreFiles(judged, truth_at, path, "\n".join(tables), of_survey, of_points, aligned)
