"""A survey as layers of a map: what GeoPackage and KML hold, each layer with one kind of geometry."""

from dataclasses import dataclass

import numpy as np

from plnerf.export.crs import CrsTransform
from plnerf.export.encroachment_rows import encroachment_features
from plnerf.export.gis import Feature
from plnerf.export.line_rows import attachment_rows, span_rows, string_rows
from plnerf.export.rows import clearance_rows, crossing_rows, structure_properties, wire_properties
from plnerf.line.ends import Attached
from plnerf.line.survey import Survey

VERTEX_M = 1.0
"""Between vertices of a wire's polyline."""


@dataclass(frozen=True, eq=False)
class Layer:
    """Features of one kind."""

    name: str
    features: tuple[Feature, ...]
    colour: str
    """Of its symbols: #rrggbb."""
    label: tuple[str, ...] = ()
    """The property that names a feature; where it is null, the next one, which numbers it."""


def layers_of(survey: Survey, transform: CrsTransform) -> tuple[Layer, ...]:
    """All layers that have any feature."""
    near = encroachment_features(survey)
    found = (
        Layer(
            "encroachments", tuple(one for one in near if one.kind == "Polygon"), "#c62828",
            ("encroachment",),
        ),
        Layer(
            "encroaching_crossings", tuple(one for one in near if one.kind == "LineString"), "#c62828",
            ("encroachment",),
        ),
        Layer("clearances", _clearances(survey, transform), "#ef6c00"),
        Layer("crossings", _crossings(survey, transform), "#6a1b9a"),
        Layer("spans", _spans(survey, transform), "#607d8b", ("span",)),
        Layer(
            "wires",
            tuple(
                Feature(
                    "LineString", wire.polyline(VERTEX_M),
                    wire_properties(survey, line, span, wire, transform),
                )
                for line in survey.lines for span in line.spans for wire in span.wires
            ),
            "#1565c0", ("name", "id"),
        ),
        Layer("strings", _strings(survey, transform), "#2e7d32"),
        Layer("attachments", _attachments(survey, transform), "#2e7d32"),
        Layer(
            "structures",
            tuple(
                Feature("Point", one.foot[None], structure_properties(survey, line, one))
                for line in survey.lines for one in line.structures
            ),
            "#212121", ("name", "structure"),
        ),
    )  # fmt: skip
    return tuple(one for one in found if one.features)


def _clearances(survey: Survey, transform: CrsTransform) -> tuple[Feature, ...]:
    """From wire to obstacle."""
    if survey.clearances is None:
        return ()
    places, rows = survey.clearances.all_places(), clearance_rows(survey, transform)
    return tuple(
        Feature("LineString", np.stack([place.on_wire, place.on_obstacle]), row)
        for place, row in zip(places, rows, strict=True)
    )


def _crossings(survey: Survey, transform: CrsTransform) -> tuple[Feature, ...]:
    """From wire to wire."""
    if survey.clearances is None:
        return ()
    rows = crossing_rows(survey, transform)
    return tuple(
        Feature("LineString", np.stack([one.on_upper, one.on_lower]), row)
        for one, row in zip(survey.clearances.crossings, rows, strict=True)
    )


def _spans(survey: Survey, transform: CrsTransform) -> tuple[Feature, ...]:
    """From foot to foot, of spans between two structures."""
    feet = {one.id: one.foot for one in survey.structures}
    return tuple(
        Feature("LineString", np.stack([feet[a], feet[b]]), row)
        for row in span_rows(survey, transform)
        for a, b in [(row["structure_a"], row["structure_b"])]
        if isinstance(a, int) and isinstance(b, int)
    )


def _attachments(survey: Survey, transform: CrsTransform) -> tuple[Feature, ...]:
    points = {
        (end.structure, wire.id): end.point
        for wire in survey.wires
        for end in wire.ends
        if isinstance(end, Attached)
    }
    return tuple(
        Feature("Point", points[int(row["structure"] or 0), int(row["wire"] or 0)][None], row)
        for row in attachment_rows(survey, transform)
    )


def _strings(survey: Survey, transform: CrsTransform) -> tuple[Feature, ...]:
    rows = string_rows(survey, transform)
    return tuple(Feature("LineString", one.ends, row) for one, row in zip(survey.strings, rows, strict=True))


def columns_of(layer: Layer) -> list[str]:
    """The properties of a layer, as its first feature has them."""
    return list(layer.features[0].properties)
