"""Spans, phases, attachments and insulator strings as rows of tables (`rows.py` has the rules of columns)."""

import math

import numpy as np

from plnerf.export.crs import CrsTransform
from plnerf.export.rows import Row, coordinates, plain_row, stretch_of
from plnerf.line.ends import Attached, Quantity
from plnerf.line.phases import phases_of
from plnerf.line.survey import Survey

SPANS, PHASES, ATTACHMENTS, STRINGS = "spans.csv", "phases.csv", "attachments.csv", "strings.csv"


def span_rows(survey: Survey, transform: CrsTransform) -> list[Row]:
    """A row for each span: its structures with their names, its stations, its length (empty where a
    structure is not known), its direction, and how many phases and other wires it has."""
    rows = []
    for line in survey.lines:
        names = {one.id: one.name for one in line.structures}
        for span in line.spans:
            if not span.wires:
                continue
            stretch, phases = stretch_of(line, span), phases_of(span)
            a, b = transform.to_world(np.array([[*stretch.base.a, 0.0], [*stretch.base.b, 0.0]]))
            held_a, held_b = stretch.held
            row: Row = {
                "line": line.id, "line_name": line.name, "voltage_kv": line.voltage_kv, "span": span.id,
                "structure_a": held_a, "name_a": names.get(held_a or 0), "structure_b": held_b,
                "name_b": names.get(held_b or 0), "station_a_m": stretch.from_m,
                "station_b_m": stretch.to_m, "length_m": stretch.length_m,
                "azimuth_deg": math.degrees(math.atan2(b[0] - a[0], b[1] - a[1])) % 360,
                "phases": sum(one.kind == "phase" for one in phases),
                "other_wires": sum(one.kind != "phase" for one in phases),
                "wires": len(span.wires), "reference": transform.reference,
            }  # fmt: skip
            rows.append(plain_row(row))
    return rows


def phase_rows(survey: Survey) -> list[Row]:
    """A row for each phase and other wire of each span; a bundle is one, with its spacing at mid-span."""
    return [
        plain_row({
            "line": line.id, "span": span.id, "phase": one.number, "kind": one.kind, "name": one.name,
            "circuit": one.circuit, "subconductors": len(one.wires),
            "spacing_m": one.spacing.value if one.spacing else None,
            "spacing_95_m": one.spacing.half_95 if one.spacing else None,
            "wires": " ".join(map(str, one.wires)),
        })
        for line in survey.lines
        for span in line.spans
        for one in phases_of(span)
    ]  # fmt: skip


def attachment_rows(survey: Survey, transform: CrsTransform) -> list[Row]:
    """A row for each end of a wire that a structure holds, with the half widths of its 95 % intervals along
    the wire, across it and upwards."""
    rows = []
    for line in survey.lines:
        names = {one.id: one.name for one in line.structures}
        for span in line.spans:
            for wire in span.wires:
                sigma = wire.sigma_at(np.array([0.0, wire.base.length_m]))
                for end, (across, up) in zip(wire.ends, sigma.tolist(), strict=True):
                    if not isinstance(end, Attached):
                        continue
                    row: Row = {
                        "line": line.id, "structure": end.structure, "structure_name":
                        names.get(end.structure), "span": span.id, "wire": wire.id, "kind": wire.kind,
                        "name": wire.name, "circuit": wire.circuit, "string_m": end.string_m,
                        "along_95_m": Quantity(0.0, end.sigma_m).half_95,
                        "across_95_m": Quantity(0.0, across).half_95, "up_95_m": Quantity(0.0, up).half_95,
                    }  # fmt: skip
                    rows.append(plain_row(row) | coordinates(transform, {"attachment": end.point}))
    return sorted(rows, key=lambda row: (str(row["line"]), int(row["structure"] or 0), int(row["wire"] or 0)))


def string_rows(survey: Survey, transform: CrsTransform) -> list[Row]:
    """A row for each string of insulators."""
    return [
        plain_row({
            "structure": one.structure, "kind": one.kind, "wires": " ".join(map(str, one.wires)),
            "length_m": one.length_m, "length_95_m": Quantity(0.0, one.sigma_m).half_95,
            "points": one.points,
        })
        | coordinates(transform, {"at_structure": one.ends[0], "at_wire": one.ends[1]})
        for one in survey.strings
    ]  # fmt: skip
