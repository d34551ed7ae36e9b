"""A score of points as JSON and as tables."""

from collections.abc import Iterable
from dataclasses import asdict
from typing import Any

from plnerf.score.config import DEFAULT, PointScoreConfig
from plnerf.score.points import PointScore, WireScore, rules

FORMAT_VERSION = 1


def to_json(score: PointScore, config: PointScoreConfig = DEFAULT.points) -> dict[str, Any]:
    """Plain values; tolerances are in the keys' names, what no wire has is null."""
    labels = _labels(config)
    wires = [_row(wire, labels) for wire in score.wires]
    scored = [row for row, wire in zip(wires, score.wires, strict=True) if wire.scored_m]
    overall: dict[str, Any] = {}
    for name in ("recall", "precision", "f1"):
        overall |= _spread(name, getattr(score, name), labels)
    return {
        "format_version": FORMAT_VERSION,
        "overall": overall,
        "mean": {key: _over(scored, key, "mean") for key in _averaged(labels)},
        "worst": {key: _over(scored, key, "worst") for key in _averaged(labels)},
        "wires": wires,
        "points": {key: getattr(score, key) for key in ("points", "distinct", "neutral", "far")},
        "notes": list(score.notes),
        "tolerances_m": list(config.tolerances_m),
        "rules": rules(config),
    }


def markdown(score: PointScore, config: PointScoreConfig = DEFAULT.points) -> str:
    """The overall figures, and a table of the wires with their mean and their worst."""
    content = to_json(score, config)
    lines = ["| within | recall | precision | F1 |", "| ---: | ---: | ---: | ---: |"]
    for t, tolerance in enumerate(config.tolerances_m):
        shares = (score.recall[t], score.precision[t], score.f1[t])
        lines.append(f"| {100 * tolerance:.0f} cm | " + " | ".join(f"{share:.1%}" for share in shares) + " |")
    columns = {f"recall {label[:-2]} cm": (f"recall_{label}", "{:.1%}") for label in _labels(config)} | {
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


def _labels(config: PointScoreConfig) -> list[str]:
    return [f"{round(100 * tolerance)}cm" for tolerance in config.tolerances_m]


def _row(wire: WireScore, labels: list[str]) -> dict[str, Any]:
    row = asdict(wire)
    recall = _spread("recall", wire.recall, labels)
    return {key: value for key, value in row.items() if key != "recall"} | recall


def _spread(name: str, values: Iterable[float], labels: list[str]) -> dict[str, float]:
    return {f"{name}_{label}": value for label, value in zip(labels, values, strict=True)}


def _averaged(labels: list[str]) -> list[str]:
    rest = ("covered_share", "longest_gap_m", "fragments", "vertical_rmse_m", "horizontal_rmse_m")
    return [*(f"recall_{label}" for label in labels), *rest]


def _over(rows: list[dict[str, Any]], key: str, what: str) -> float | None:
    """Of the wires that have a value; worst is the least share, but the greatest gap, count or error."""
    values = [row[key] for row in rows if row[key] is not None]
    if not values:
        return None
    if what == "mean":
        return float(sum(values) / len(values))
    return float(min(values) if key.startswith(("recall", "covered")) else max(values))
