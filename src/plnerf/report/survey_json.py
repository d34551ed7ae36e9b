"""The content of a report as plain values for other programs; what is not known is null.

Lengths, heights and places are in the unit that `unit` names, world frame.
"""

from typing import Any

import numpy as np

from plnerf.report.colours import CLASSES, OTHER
from plnerf.report.data import Clearance, Profile, Report
from plnerf.report.tables import lowest_within
from plnerf.report.words import caveats
from plnerf.survey.fit import CatenaryFit
from plnerf.survey.model import Conductor

FORMAT_VERSION = 2
"""1 was written before conductors were fitted."""


def survey_json(report: Report) -> dict[str, Any]:
    """Strictly JSON: finite numbers, texts, lists and nulls."""
    survey = report.survey
    labels, counts = np.unique(survey.cloud.label, return_counts=True)
    content = {
        "format_version": FORMAT_VERSION,
        "source": survey.source,
        "made": dict(report.made),
        "frame": "world",
        "unit": survey.unit,
        "crs": survey.crs,
        "origin_lon_lat_height": survey.origin,
        "temperature_c": survey.temperature_c,
        "caveats": caveats(report),
        "points": len(survey.cloud.xyz),
        "points_by_class": [
            {"code": code, "name": CLASSES.get(int(code), OTHER)[0], "points": count}
            for code, count in zip(labels, counts, strict=True)
        ],
        "conductors": [_conductor(one) for one in survey.conductors],
        "towers": [{"foot": one.foot, "height": one.height_m} for one in survey.towers],
        "clearances": [_clearance(one) for one in report.by_need],
        "profiles": [_profile(one) for one in report.profiles],
        "pictures": [one.caption for one in report.pictures],
        "files": report.files,
        "about_files": report.about_files,
    }
    plain: dict[str, Any] = _plain(content)
    return plain


def _conductor(one: Conductor) -> dict[str, Any]:
    return {
        "id": one.id,
        "span": one.span,
        "kind": one.kind,
        **_fit(one.fit),
        "coverage": one.coverage,
        "longest_gap": one.longest_gap_m,
        "evidence": one.evidence,
        "source": one.source,
        "note": one.note,
        "before_refit": _fit(one.before) if one.before is not None else None,
    }


def _fit(fit: CatenaryFit) -> dict[str, Any]:
    """The catenary, its measures and how well they are known; q and covariance as `CatenaryFit` has them."""
    curve = fit.curve
    s, z = lowest_within(fit)
    return {
        "end_a": curve.a,
        "end_b": curve.b,
        "p": curve.p_m,
        "span_length": curve.span_m,
        "wire_length": curve.length_m,
        "sag": curve.sag_m,
        "sag_sigma": fit.sag_sigma_m,
        "lowest_in_span": {"at": s, "height": z},
        "lowest_of_curve": curve.lowest,
        "residual_across": fit.residual_across_m,
        "residual_up": fit.residual_up_m,
        "base": {"o": fit.base.o, "u": fit.base.u, "length": fit.base.length_m},
        "q": fit.q,
        "covariance": fit.covariance,
        "end_sigma": fit.end_sigma_m,
    }


def _clearance(one: Clearance) -> dict[str, Any]:
    return {
        "conductor": one.conductor,
        "to": one.to,
        "distance": one.distance_m,
        "sigma": one.sigma_m,
        "required": one.required_m,
        "margin": one.margin_m,
        "verdict": one.verdict,
        "standing": one.standing,
        "at": one.place_m,
        "on_wire": one.on_wire,
        "on_obstacle": one.on_obstacle,
    }


def _profile(one: Profile) -> dict[str, Any]:
    return {
        "conductor": one.conductor,
        "at": one.place_m,
        "wire": one.wire_m,
        "ground": one.ground_m,
        "vegetation": one.vegetation_m,
    }


def _plain(value: Any) -> Any:
    """NumPy's values as Python's, numbers that are not finite as None, all the way down."""
    match value:
        case dict():
            return {str(key): _plain(one) for key, one in value.items()}
        case list() | tuple():
            return [_plain(one) for one in value]
        case np.ndarray() | np.generic():
            return _plain(value.tolist())
        case float():
            return value if np.isfinite(value) else None
    return value
