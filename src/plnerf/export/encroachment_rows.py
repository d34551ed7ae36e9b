"""Encroachments as rows of a table and as features of a map (`rows.py` has the rules of columns)."""

import numpy as np
from jaxtyping import Float

from plnerf.export.crs import CrsTransform
from plnerf.export.gis import Feature
from plnerf.export.rows import Row, coordinates, plain_row
from plnerf.line.encroachments import IN_WORDS, Encroachment
from plnerf.line.survey import Survey

ENCROACHMENTS, PLACED_ENCROACHMENTS = "encroachments.csv", "encroachments.geojson"


def encroachment_rows(survey: Survey, transform: CrsTransform) -> list[Row]:
    """A row for each encroachment: `encroachment_properties`, and coordinates of its highest point and of the
    nearest places on the wire and the object as surveyed."""
    return [
        encroachment_properties(one)
        | coordinates(
            transform, {"highest": one.highest, "on_wire": one.on_wire, "on_object": one.on_object}
        )
        for one in _records(survey)
    ]


def encroachment_properties(one: Encroachment) -> Row:
    """What is known of an encroachment.

    radial_m, vertical_m, horizontal_m: as surveyed; way, state, distance_m, required_m, margin_m, verdict: of
    the most urgent way in which the two come too near; ways: all of them, with each one's state and distance.
    """
    first = one.first
    row: Row = {
        "encroachment": one.id, "priority": one.priority, "why": IN_WORDS[one.priority],
        "object": one.object, "line": one.line, "span": one.span, "wire": one.wire,
        "other_wire": one.other_wire, "station_m": one.station_m, "height_m": one.height_m,
        "radial_m": one.radial.value, "radial_95_m": one.radial.half_95,
        "vertical_m": one.vertical.value, "vertical_95_m": one.vertical.half_95,
        "horizontal_m": one.horizontal.value, "horizontal_95_m": one.horizontal.half_95,
        "way": first.way, "state": first.state, "direction": first.direction,
        "distance_m": first.distance.value, "distance_95_m": first.distance.half_95,
        "required_m": first.required_m, "required_by": first.required_by, "margin_m": first.margin_m,
        "verdict": first.verdict,
        "years": first.years.value if first.years else None,
        "years_95": first.years.half_95 if first.years else None,
        "ways": "; ".join(
            f"{each.way} ({each.state}): {each.distance.value:.2f} +- {each.distance.half_95:.2f} m, "
            f"{each.verdict}"
            for each in one.approaches
        ),
    }  # fmt: skip
    return plain_row(row)


def encroachment_features(survey: Survey) -> list[Feature]:
    """Polygons at the height of each object's highest point; of a crossing the line between the two wires."""
    return [
        Feature("LineString", np.stack([one.on_wire, one.on_object]), encroachment_properties(one))
        if not len(one.outline)
        else Feature("Polygon", ring_of(one), encroachment_properties(one))
        for one in _records(survey)
    ]


def ring_of(one: Encroachment) -> Float[np.ndarray, "n 3"]:
    """The outline as a closed ring at the height of the highest point."""
    flat = np.concatenate([one.outline, one.outline[:1]])
    return np.column_stack([flat, np.full(len(flat), one.highest[2])])


def _records(survey: Survey) -> tuple[Encroachment, ...]:
    return survey.encroachments.records if survey.encroachments is not None else ()
