"""A survey's score as JSON and as tables."""

from collections.abc import Mapping, Sequence
from dataclasses import asdict
from typing import Any

from plnerf.line.ends import TWO_SIDED_95
from plnerf.score import clearance_score as of_clearances
from plnerf.score import wire_matches as of_wires
from plnerf.score.compared import Compared
from plnerf.score.config import WireScoreConfig
from plnerf.score.survey_score import SurveyScore
from plnerf.score.wire_matches import Match, WireMatches

_Column = tuple[str, str, str]
"""Heading, key of the row, and how the value is written."""
_WIRES: tuple[_Column, ...] = (
    ("conductor", "conductor", "{}"),
    ("kind", "kind_found", "{}"),
    ("sag, true m", "sag_m", "{:.3f}"),
    ("found", "sag_found_m", "{:.3f}"),
    ("error", "sag_error_m", "{:+.3f}"),
    ("±, 95 %", "sag_half_95_m", "{:.3f}"),
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
    ("swing, true deg", "swing_deg", "{:.1f}"),
    ("error", "swing_error_deg", "{:+.2f}"),
)
_BEFORE: tuple[_Column, ...] = (
    ("sag error, common stretch m", "sag_common_error_m", "{:+.3f}"),
    ("RMSE across", "rmse_across_m", "{:.3f}"),
    ("up", "rmse_up_m", "{:.3f}"),
    ("worst", "worst_m", "{:.3f}"),
)
"""Of the survey's wires as they were detected, before they were refitted to the images."""
_SUPPORTS: tuple[_Column, ...] = (
    ("id", "structure", "{}"),
    ("kind", "kind_found", "{}"),
    ("off along m", "along_m", "{:+.3f}"),
    ("across", "across_m", "{:+.3f}"),
    ("line angle, true deg", "line_angle_deg", "{:.1f}"),
    ("found", "line_angle_found_deg", "{:.1f}"),
)
_CLEARANCES: tuple[_Column, ...] = (
    ("conductor", "conductor", "{}"),
    ("true m", "true_m", "{:.2f}"),
    ("found", "found_m", "{:.2f}"),
    ("error", "error_m", "{:+.2f}"),
    ("±, 95 %", "half_95_m", "{:.2f}"),
    ("in 95 %", "within_95", "{}"),
    ("off along the line m", "off_along_m", "{:.1f}"),
)


def to_json(score: SurveyScore, config: WireScoreConfig) -> dict[str, Any]:
    """Plain values; what is not known is null."""
    wires, clearances = score.wires, score.clearances
    plants, observable = clearances.vegetation, score.observable
    return {
        "conductors": {
            "true": len(wires.matches) + len(wires.missing) + len(wires.unseen),
            "found": len(wires.matches),
            "missing": list(wires.missing),
            "unseen": list(wires.unseen),
            "again": [{"conductor": one, "wire": wire} for one, wire in wires.again],
            "invented": list(wires.invented),
            "invented_certain": list(score.invented_certain),
            "within_95": _shares(wires),
            "wires": [_match_row(match) for match in wires.matches],
            "rules": of_wires.rules(config),
            "before_refit": [_match_row(match) for match in score.before_refit],
        },
        "observable": None
        if observable is None
        else asdict(observable)
        | {
            "total_m": observable.total_m,
            "recall": observable.recall,
        },
        "supports": asdict(score.supports),
        "clearances": {
            "ground": [_compared_row(one) for one in clearances.ground],
            "vegetation": None if plants is None else _compared_row(plants),
            "vegetation_of_wires": [_compared_row(one) for one in clearances.vegetation_of_wires],
            "notes": list(clearances.notes),
            "rules": of_clearances.RULES,
        },
    }


def markdown(score: SurveyScore) -> str:
    """What was found, and tables of the wires and of the clearances."""
    matches, clearances = score.wires.matches, score.clearances
    lines = [_found(score.wires)]
    if score.observable is not None and score.observable.recall is not None:
        lines.append(
            f"Of {score.observable.total_m:.1f} m that images show well, {score.observable.recall:.1%} are "
            f"found within {100 * score.observable.within_m:g} cm."
        )
    if matches:
        rows = [_match_row(match) for match in matches]
        for row in rows:
            row["kind_found"] += "" if row["kind_right"] else f" (truly {row['kind']})"
        shares = [f"{name} {share:.0%}" for name, share in _shares(score.wires).items() if share is not None]
        lines += ["", *_table("wire", rows, _WIRES), ""]
        lines.append(f"Of what is stated, the true value lies within the 95 % interval: {', '.join(shares)}.")
        lines += [
            f"Conductor {match.conductor} ({match.wire}) has no sag: {match.no_sag_because}."
            for match in matches
            if match.no_sag_because is not None
        ]
    lines += _supports(score)
    rows = [{**_compared_row(one), "wire": f"{one.wire}, above ground"} for one in clearances.ground]
    if clearances.vegetation is not None:
        one = clearances.vegetation
        rows.append({**_compared_row(one), "wire": f"{one.wire}, to the nearest plant of all"})
    rows += [
        {**_compared_row(one), "wire": f"{one.wire}, to its nearest plant"}
        for one in clearances.vegetation_of_wires
    ]
    if rows:
        lines += ["", *_table("clearance", rows, _CLEARANCES)]
    lines += ["", *(f"Note: {note}" for note in clearances.notes)] if clearances.notes else []
    if score.before_refit:
        rows = [_match_row(match) for match in score.before_refit]
        lines += ["", *_table("before the refit", rows, _BEFORE)]
    return "\n".join(lines) + "\n"


def _supports(score: SurveyScore) -> list[str]:
    """A table of the structures, and what of them is missing or invented."""
    supports = score.supports
    lines: list[str] = []
    if supports.matches:
        rows = [asdict(match) | {"wire": match.name} for match in supports.matches]
        for row in rows:
            row["kind_found"] += (
                "" if row["kind"] in (row["kind_found"], "unknown") else f" (truly {row['kind']})"
            )
        lines += ["", *_table("structure", rows, _SUPPORTS), ""]
    if supports.missing:
        lines.append(f"Structures missing: {', '.join(supports.missing)}.")
    if supports.invented:
        lines.append(f"Structures invented: {', '.join(map(str, supports.invented))}.")
    return lines


def _shares(score: WireMatches) -> dict[str, float | None]:
    return {name: score.share_within_95(name) for name in ("sag", "across", "up")}


def _found(score: WireMatches) -> str:
    """What was found and what was not, in one line."""
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
        "sag_half_95_m": _half_95(match.sag_sigma_m),
        "sag_within_95": match.sag_within_95,
        "swing_error_deg": match.swing_error_deg,
        "swing_within_95": match.swing_within_95,
    }


def _compared_row(one: Compared) -> dict[str, Any]:
    half = _half_95(one.sigma_m)
    return asdict(one) | {"error_m": one.error_m, "half_95_m": half, "within_95": one.within_95}


def _half_95(sigma_m: float | None) -> float | None:
    return None if sigma_m is None else TWO_SIDED_95 * sigma_m
