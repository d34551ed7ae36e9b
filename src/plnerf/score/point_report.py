"""A score of points as JSON and as a table, and the way there from files: which points, which truth.

Points and truth meet only through files, so that the survey may come from any program.
"""

import json
from collections.abc import Iterable
from dataclasses import asdict
from pathlib import Path
from typing import Any

from plnerf.errors import SurveyError
from plnerf.scene.formats import read_listing
from plnerf.score.clouds import read_cloud
from plnerf.score.points import RULES, TOLERANCES_M, Score, WireScore, score_points
from plnerf.score.truth import WireTruth

FORMAT_VERSION = 1
SURVEY_FILES = ("wires.ply", "conductors.geojson", "survey/wires.ply", "survey/conductors.geojson")
"""Looked for in a folder, in this order."""
_LABELS = tuple(f"{round(100 * tolerance)}cm" for tolerance in TOLERANCES_M)


def score_file(
    points_at: Path, truth: WireTruth, classes: tuple[int, ...] | None = None
) -> tuple[dict[str, Any], str]:
    """The score of a file of points or curves, as JSON's values and as tables.

    classes: of LAS, as in `read_cloud`.  Raises SurveyError where the file cannot be read.
    """
    cloud = read_cloud(points_at, classes=classes)
    score = score_points(cloud.points, truth)
    return to_json(score) | {"taken": cloud.taken}, markdown(score)


def find_points(survey: Path) -> Path:
    """The file itself, or what a run or survey folder holds."""
    if not survey.is_dir():
        return survey
    for name in SURVEY_FILES:
        if (survey / name).is_file():
            return survey / name
    raise SurveyError(
        f"{survey} holds no points of wires: none of {', '.join(SURVEY_FILES)} is there. Give the file "
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
            try:
                return Path(json.loads(config.read_text(encoding="utf-8"))["scene"])
            except (ValueError, KeyError, TypeError) as error:
                raise SurveyError(
                    f"{config} names no scene ({error!r}), so its truth is not known. Name it: --truth "
                    "truth.json."
                ) from error
    raise SurveyError(
        f"{survey} lies in no run folder, so it is not known what to compare it with. Name the truth: "
        "--truth truth.json (or the scene folder that holds it)."
    )


def to_json(score: Score) -> dict[str, Any]:
    """Plain values; tolerances are in the keys' names, what no wire has is null."""
    wires = [_row(wire) for wire in score.wires]
    scored = [row for row, wire in zip(wires, score.wires, strict=True) if wire.scored_m]
    overall: dict[str, Any] = {}
    for name in ("recall", "precision", "f1"):
        overall |= _spread(name, getattr(score, name))
    return {
        "format_version": FORMAT_VERSION,
        "overall": overall,
        "mean": {key: _over(scored, key, "mean") for key in _averaged()},
        "worst": {key: _over(scored, key, "worst") for key in _averaged()},
        "wires": wires,
        "points": {key: getattr(score, key) for key in ("points", "distinct", "neutral", "far")},
        "notes": list(score.notes),
        "tolerances_m": list(TOLERANCES_M),
        "rules": RULES,
    }


def markdown(score: Score) -> str:
    """The overall figures, and a table of the wires with their mean and their worst."""
    content = to_json(score)
    lines = ["| within | recall | precision | F1 |", "| ---: | ---: | ---: | ---: |"]
    for t, tolerance in enumerate(TOLERANCES_M):
        shares = (score.recall[t], score.precision[t], score.f1[t])
        lines.append(f"| {100 * tolerance:.0f} cm | " + " | ".join(f"{share:.1%}" for share in shares) + " |")
    columns = {f"recall {label[:-2]} cm": (f"recall_{label}", "{:.1%}") for label in _LABELS} | {
        "covered": ("covered_share", "{:.1%}"),
        "longest gap m": ("longest_gap_m", "{:.2f}"),
        "fragments": ("fragments", "{:g}"),
        "vertical RMSE m": ("vertical_rmse_m", "{:.3f}"),
        "horizontal RMSE m": ("horizontal_rmse_m", "{:.3f}"),
    }
    lines += ["", "| wire | " + " | ".join(columns) + " |", "| --- |" + " ---: |" * len(columns)]
    totals = [{"name": "**mean**", **content["mean"]}, {"name": "**worst**", **content["worst"]}]
    for row in [*(row for row in content["wires"] if row["scored_m"]), *totals]:
        cells = ["-" if row[key] is None else form.format(row[key]) for key, form in columns.values()]
        lines.append(f"| {row['name']} | " + " | ".join(cells) + " |")
    lines += ["", *(f"Note: {note}" for note in score.notes)] if score.notes else []
    return "\n".join(lines) + "\n"


def _row(wire: WireScore) -> dict[str, Any]:
    row = asdict(wire)
    return {key: value for key, value in row.items() if key != "recall"} | _spread("recall", wire.recall)


def _spread(name: str, values: Iterable[float]) -> dict[str, float]:
    return {f"{name}_{label}": value for label, value in zip(_LABELS, values, strict=True)}


def _averaged() -> list[str]:
    rest = ("covered_share", "longest_gap_m", "fragments", "vertical_rmse_m", "horizontal_rmse_m")
    return [*(f"recall_{label}" for label in _LABELS), *rest]


def _over(rows: list[dict[str, Any]], key: str, what: str) -> float | None:
    """Of the wires that have a value; worst is the least share, but the greatest gap, count or error."""
    values = [row[key] for row in rows if row[key] is not None]
    if not values:
        return None
    if what == "mean":
        return float(sum(values) / len(values))
    return float(min(values) if key.startswith(("recall", "covered")) else max(values))
