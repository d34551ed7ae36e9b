"""A survey's score as JSON and as tables, and the way there from a folder or a file.

What is judged and the truth meet only through files.  A folder or survey.json of a survey is judged as one:
conductors, clearances, and the points in wires.ply if they are there; any other file as points or curves.
"""

import json
from collections.abc import Mapping, Sequence
from dataclasses import asdict, replace
from pathlib import Path
from typing import Any

from rich.console import Console

from plnerf.report.deliver import CONTENT
from plnerf.scene.files import write_text
from plnerf.score import clearances as of_clearances
from plnerf.score import wires as of_conductors
from plnerf.score.align import align, cameras_of, true_cameras
from plnerf.score.clearances import ClearanceScore, Compared, score_clearances
from plnerf.score.found import read_survey
from plnerf.score.point_report import SURVEY_FILES, find_points, find_truth, scene_of, score_file
from plnerf.score.truth import WireTruth, read_truth
from plnerf.score.wires import ConductorScore, Match, score_conductors

_Column = tuple[str, str, str]
"""Heading, key of the row, and how the value is written."""
_WIRES: tuple[_Column, ...] = (
    ("conductor", "conductor", "{}"),
    ("kind", "kind_found", "{}"),
    ("sag, true m", "sag_m", "{:.3f}"),
    ("found", "sag_found_m", "{:.3f}"),
    ("error", "sag_error_m", "{:+.3f}"),
    ("σ", "sag_sigma_m", "{:.3f}"),
    ("in 95 %", "sag_within_95", "{}"),
    ("error, common stretch", "sag_common_error_m", "{:+.3f}"),
    ("span, true m", "span_m", "{:.2f}"),
    ("found", "span_found_m", "{:.2f}"),
    ("common", "common_m", "{:.1f}"),
    ("RMSE across m", "rmse_across_m", "{:.3f}"),
    ("up", "rmse_up_m", "{:.3f}"),
    ("worst", "worst_m", "{:.3f}"),
    ("in 95 % across", "within_95_across", "{:.0%}"),
    ("up", "within_95_up", "{:.0%}"),
)
_BEFORE: tuple[_Column, ...] = (
    ("sag error, common stretch m", "sag_common_error_m", "{:+.3f}"),
    ("RMSE across", "rmse_across_m", "{:.3f}"),
    ("up", "rmse_up_m", "{:.3f}"),
    ("worst", "worst_m", "{:.3f}"),
)
"""Of conductors before they were refitted to the images."""
_CLEARANCES: tuple[_Column, ...] = (
    ("conductor", "conductor", "{}"),
    ("true m", "true_m", "{:.2f}"),
    ("found", "found_m", "{:.2f}"),
    ("error", "error_m", "{:+.2f}"),
    ("σ", "sigma_m", "{:.2f}"),
    ("in 95 %", "within_95", "{}"),
    ("off along the line m", "off_along_m", "{:.1f}"),
)


def score_survey(
    survey: Path,
    *,
    truth: Path | None = None,
    out: Path | None = None,
    classes: tuple[int, ...] | None = None,
    by_cameras: Path | None = None,
    console: Console | None = None,
) -> Path:
    """Scores a survey, or points or curves alone; prints tables and writes the JSON, whose path returns.

    truth: a truth.json or a scene folder; None: that of the scene which the run around the survey was trained
    on.  out: None: beside the judged file, named after it.  classes: of a LAS file, as in `read_cloud`.
    by_cameras: a scene with the survey's poses, onto whose cameras the truth is first moved.  Raises
    SurveyError or SceneError where anything is not there, cannot be read, or is in another frame.
    """
    console = console or Console()
    survey_at = find_survey(survey)
    points_at = find_points(survey) if survey_at is None else _points_beside(survey_at)
    judged = survey_at or points_at
    assert judged is not None
    truth_at = find_truth(truth if truth is not None else scene_of(judged, survey))
    known = read_truth(truth_at)
    content: dict[str, Any] = {"survey": str(judged), "truth": str(truth_at)}
    tables = []
    if by_cameras is not None:
        known, alignment = align(known, true_cameras(truth_at), cameras_of(by_cameras))
        content["aligned"] = asdict(alignment)
        tables.append(f"{alignment.words}\n")
    if survey_at is not None:
        of_survey, table = _score_survey(survey_at, known)
        content |= of_survey
        tables.append(table)
    if points_at is not None:
        of_points, table = score_file(points_at, known, classes)
        content |= of_points
        tables.append(f"Points ({of_points['taken']}):\n\n{table}")
    path = out or judged.with_name(f"{judged.stem}.score.json")
    write_text(path, json.dumps(content, indent=1, allow_nan=False) + "\n")
    console.print("\n".join(tables), highlight=False, markup=False, soft_wrap=True)
    said = f"{judged} against {truth_at}\nscore: {path}"
    console.print(said, markup=False, highlight=False, emoji=False, soft_wrap=True)
    return path


def find_survey(place: Path) -> Path | None:
    """The survey.json itself, or that of a survey or run folder; None: there is none."""
    if not place.is_dir():
        return place if place.name == CONTENT else None
    found = (folder / CONTENT for folder in (place, place / "survey"))
    return next((path for path in found if path.is_file()), None)


def _points_beside(survey_at: Path) -> Path | None:
    """Points of a survey of images; one of LiDAR has none of its own."""
    points = survey_at.with_name(SURVEY_FILES[0])
    return points if points.is_file() else None


def _score_survey(survey_at: Path, truth: WireTruth) -> tuple[dict[str, Any], str]:
    found = read_survey(survey_at)
    conductors = score_conductors(found.conductors, truth.wires)
    clearances = score_clearances(conductors.matches, found.conductors, found.clearances, truth)
    old = [replace(one, fit=one.before) for one in found.conductors if one.before is not None]
    before = score_conductors(old, truth.wires)
    content, table = to_json(conductors, clearances), markdown(conductors, clearances)
    content["conductors"]["before_refit"] = [_match_row(match) for match in before.matches]
    if before.matches:
        lines = _table("before the refit", content["conductors"]["before_refit"], _BEFORE)
        table += "\n" + "\n".join(lines) + "\n"
    return content, table


def to_json(conductors: ConductorScore, clearances: ClearanceScore) -> dict[str, Any]:
    """Plain values; what is not known is null."""
    plants = clearances.vegetation
    return {
        "conductors": {
            "true": len(conductors.matches) + len(conductors.missing) + len(conductors.unseen),
            "found": len(conductors.matches),
            "missing": list(conductors.missing),
            "unseen": list(conductors.unseen),
            "again": [{"conductor": one, "wire": wire} for one, wire in conductors.again],
            "invented": list(conductors.invented),
            "within_95": {name: conductors.share_within_95(name) for name in ("sag", "across", "up")},
            "wires": [_match_row(match) for match in conductors.matches],
            "rules": of_conductors.RULES,
        },
        "clearances": {
            "ground": [_compared_row(one) for one in clearances.ground],
            "vegetation": None if plants is None else _compared_row(plants),
            "notes": list(clearances.notes),
            "rules": of_clearances.RULES,
        },
    }


def markdown(conductors: ConductorScore, clearances: ClearanceScore) -> str:
    """What was found, and tables of the wires and of the clearances."""
    lines = [_found(conductors)]
    if conductors.matches:
        rows = [_match_row(match) for match in conductors.matches]
        for row in rows:
            row["kind_found"] += "" if row["kind_right"] else f" (truly {row['kind']})"
        shares = {name: conductors.share_within_95(name) for name in ("sag", "across", "up")}
        lines += ["", *_table("wire", rows, _WIRES), ""]
        lines.append(
            "Of what is stated, the true value lies within the 95 % interval: "
            + ", ".join(f"{name} {share:.0%}" for name, share in shares.items())
            + "."
        )
    rows = [{**_compared_row(one), "wire": f"{one.wire}, above ground"} for one in clearances.ground]
    if clearances.vegetation is not None:
        one = clearances.vegetation
        rows.append({**_compared_row(one), "wire": f"{one.wire}, to the nearest plant of all"})
    if rows:
        lines += ["", *_table("clearance", rows, _CLEARANCES)]
    lines += ["", *(f"Note: {note}" for note in clearances.notes)] if clearances.notes else []
    return "\n".join(lines) + "\n"


def _found(score: ConductorScore) -> str:
    """In one line."""
    again = len({wire for _, wire in score.again})
    seen = len(score.matches) + len(score.missing)
    parts = [
        f"{seen} true wires: {len(score.matches) - again} found once, {again} more than once, "
        f"{len(score.missing)} missing",
        f"{len(score.invented)} conductors invented",
    ]
    parts += [f"missing: {', '.join(score.missing)}"] if score.missing else []
    parts += [f"again: {', '.join(f'{one} ({wire})' for one, wire in score.again)}"] if score.again else []
    parts += [f"invented: {', '.join(map(str, score.invented))}"] if score.invented else []
    parts += [f"not scored, seen in too few images: {', '.join(score.unseen)}"] if score.unseen else []
    return "; ".join(parts) + "."


def _table(title: str, rows: Sequence[Mapping[str, Any]], columns: Sequence[_Column]) -> list[str]:
    headings = " | ".join(heading for heading, _, _ in columns)
    lines = [f"| {title} | {headings} |", "| --- |" + " ---: |" * len(columns)]
    for row in rows:
        cells = [_cell(row[key], form) for _, key, form in columns]
        lines.append(f"| {row['wire']} | " + " | ".join(cells) + " |")
    return lines


def _cell(value: Any, form: str) -> str:
    match value:
        case None:
            return "-"
        case bool():
            return "yes" if value else "no"
    return form.format(value)


def _match_row(match: Match) -> dict[str, Any]:
    return asdict(match) | {
        "kind_right": match.kind_right,
        "sag_error_m": match.sag_error_m,
        "sag_common_error_m": match.sag_common_error_m,
        "sag_within_95": match.sag_within_95,
    }


def _compared_row(one: Compared) -> dict[str, Any]:
    return asdict(one) | {"error_m": one.error_m, "within_95": one.within_95}
