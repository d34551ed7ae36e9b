"""How well a survey could be made: what was seen, how well the curves fit, how sure the figures are.

A reader compares these figures with what was ordered; none is a verdict.
"""

from collections import Counter

import numpy as np

from plnerf.line.encroachments import POSSIBLE
from plnerf.line.survey import Survey
from plnerf.report.figures import CERTAIN, NOTHING, counted, share
from plnerf.report.shown import units_of
from plnerf.report.tables import Table


def quality_table(survey: Survey) -> Table | None:
    """A row for each measure; None without wires."""
    if not survey.wires:
        return None
    rows = [*_seen(survey), *_fit(survey), *_known(survey), *_judged(survey)]
    return Table(
        ["of", "measure", "figure", "what it means"], rows,
        "What the figures rest on. None of these is a verdict; the caveats above say where they limit one.",
        frozenset({0, 1, 3}),
    )  # fmt: skip


def _seen(survey: Survey) -> list[list[str]]:
    rows = [["cloud", "points", f"{len(survey.cloud.xyz):,}", ", ".join(
        [*(["from images"] if survey.from_images else ["of a laser"]), _sigma(survey)]
    )]]  # fmt: skip
    for name, of in (("ground", [one.ground for one in survey.coverage]),
                     ("air below the wires", [one.air for one in survey.coverage])):  # fmt: skip
        values = np.concatenate([*of, np.zeros(0)])
        values = values[np.isfinite(values)]
        if len(values):
            rows.append([
                "coverage", f"{name} seen", share(float(values.mean())),
                f"mean of the stretches; the least of one is {share(float(values.min()))}",
            ])  # fmt: skip
    silent = sum(len(one.silent) for one in survey.coverage)
    if survey.coverage:
        rows.append(["coverage", "stretches not seen", str(silent), "nothing is known of what is there"])
    held = sum(end is not None for span in survey.spans for end in span.structures)
    rows.append([
        "structures", "ends of spans with a structure", f"{held} of {2 * len(survey.spans)}",
        "where none is seen, wires end open",
    ])  # fmt: skip
    return rows


def _sigma(survey: Survey) -> str:
    if survey.cloud.sigma_m is None or not len(survey.cloud.sigma_m):
        return "standard deviations not stated"
    return f"standard deviation {units_of(survey).with_unit(float(np.median(survey.cloud.sigma_m)))} (median)"


def _fit(survey: Survey) -> list[list[str]]:
    units = units_of(survey)
    rows = []
    for name, values in (
        ("residual across", [one.evidence.residual_across_m for one in survey.wires]),
        ("residual up", [one.evidence.residual_up_m for one in survey.wires]),
    ):
        rows.append([
            "wires", name, units.with_unit(float(np.median(values)), 3),
            f"root mean square, median of the wires; the worst {units.with_unit(max(values), 3)}",
        ])  # fmt: skip
    least = min(survey.wires, key=lambda one: one.evidence.coverage)
    rows.append([
        "wires", "length with evidence", share(float(np.mean([w.evidence.coverage for w in survey.wires]))),
        f"mean; the least is {share(least.evidence.coverage)}, of wire {least.id}",
    ])  # fmt: skip
    return rows


def _known(survey: Survey) -> list[list[str]]:
    units = units_of(survey)
    sags = [one.sag for one in survey.wires if one.sag is not None]
    rows = [[
        "sag", "stated", f"{len(sags)} of {counted(len(survey.wires), 'wire')}",
        "of the others an end is open",
    ]]  # fmt: skip
    if sags:
        half = [one.half_95 for one in sags]
        rows.append([
            "sag", f"interval ±\u00a0{CERTAIN}", units.with_unit(float(np.median(half)), 3),
            f"median of the wires; the widest {units.with_unit(max(half), 3)}",
        ])  # fmt: skip
    return rows


def _judged(survey: Survey) -> list[list[str]]:
    rows = []
    if survey.encroachments is not None:
        found = survey.encroachments.records
        doubtful = sum(one.priority == POSSIBLE for one in found)
        rows.append([
            "encroachments", "within their uncertainty", f"{doubtful} of {len(found)}",
            "to be checked in the photos or in the field",
        ])  # fmt: skip
    if survey.rules is not None:
        counts = Counter(one.verified for one in survey.rules.rules)
        rows.append([
            "rules", "not compared with the standard", f"{counts[False]} of {len(survey.rules.rules)}",
            "their numbers may be wrong",
        ])  # fmt: skip
    named = sum(one.name is not None for one in survey.structures)
    rows.append([
        "names", "structures with a name", f"{named} of {len(survey.structures)}" if survey.structures else
        NOTHING, "by the client's list (--names)",
    ])  # fmt: skip
    return rows
