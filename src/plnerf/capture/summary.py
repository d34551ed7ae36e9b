"""A capture's result as text."""

from collections import Counter
from pathlib import Path
from typing import Any

from plnerf.capture.accuracy import accuracy_text
from plnerf.capture.capture import REPORT
from plnerf.capture.heights import crs_name
from plnerf.errors import CaptureError
from plnerf.scene.strict_json import read_json

SHOWN = 5
"""Most images that are named for one reason; capture.json names all."""


def read_report(scene: Path) -> dict[str, Any]:
    """The content of a scene folder's capture.json."""
    content: dict[str, Any] = read_json(scene / REPORT, CaptureError, "Capture the scene again.")
    return content


def summary(report: dict[str, Any]) -> str:
    """What was registered, what was not and why, and how well it lies on the earth."""
    lines = []
    if report["frames"]:
        kept = sum(frame["kept"] for frame in report["frames"])
        reasons = Counter(frame["reason"] for frame in report["frames"] if not frame["kept"])
        dropped = ", ".join(f"{count} {reason}" for reason, count in reasons.most_common())
        lines.append(
            f"{kept} of {len(report['frames'])} pictures of the video are used ({dropped or 'all'})."
        )
    lines.append(
        f"{report['registered']} of {report['images']} images have a pose, {report['points']:,} points, "
        f"{report['reprojection_px']:.2f} px off on average."
    )
    for one in report["findings"]:
        said = ". ".join(text for text in (one["what"], one["do"]) if text)
        lines.append(f"{one['kind'].capitalize()}: {said}.")
    by_reason: dict[str, list[str]] = {}
    for name, reason in report["failed"].items():
        by_reason.setdefault(reason, []).append(name)
    for reason, names in by_reason.items():
        more = f" and {len(names) - SHOWN} more" if len(names) > SHOWN else ""
        lines.append(f"No pose: {', '.join(names[:SHOWN])}{more}: {reason}.")
    lines += [f"Left out: {text}" for text in report["left_out"][:SHOWN]]
    place = report["georeference"]
    if place is None:
        reason = report["not_georeferenced_because"].rstrip(".")
        lines.append(f"Not georeferenced, lengths are unscaled: {reason}.")
        return "\n".join(lines)
    lines.append(
        f"Georeferenced in {crs_name(place['crs'])}, by {place['positions_trusted']} of "
        f"{place['positions']} positions ({place['source']}): median {place['residual_median_m']:.2f} m off, "
        f"worst {place['residual_worst_m']:.2f} m."
    )
    for what in ("control", "check"):
        if place[what] is not None:
            lines.append(accuracy_text(what, place[what]))
    if place["check"] is None and place["control"] is not None:
        lines.append(
            "No point was held back to check: residuals of points that hold a scene do not say how accurate "
            "it is (`check` as the last word of a line of gcp_list.txt, or --check-every)."
        )
    for whose, off in (("The photos' positions", "positions_off"), ("The check points", "check_points_off")):
        if place[off] is not None:
            lines.append(
                f"{whose} all differ alike from what holds the scene: they lie {place[off]}. Their heights "
                "are probably above something else (ellipsoid, sea)."
            )
    if place["held_by"] != "positions":
        roll = place["roll_sigma_deg"]
        known = "not" if roll is None else f"to {roll:.1f} degrees only"
        lines.append(
            f"By themselves the positions hold the turn about their main direction {known}: it is held by "
            f"{place['held_by']}."
        )
    return "\n".join(lines)
