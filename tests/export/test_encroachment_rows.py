"""Encroachments as CSV and GeoJSON, read by other programs."""

import csv
import json
from pathlib import Path

import numpy as np
import pytest
from tests.support import surveys
from tests.support.encroaching import with_encroachments

from plnerf.export.crs import crs_transform
from plnerf.export.exports import write_exports


def test_rows_and_polygons_are_those_of_the_records(tmp_path: Path) -> None:
    survey = with_encroachments(surveys.short(0.05))
    files = write_exports(survey, tmp_path).files
    with files["encroachments.csv"].open(newline="", encoding="utf-8") as file:
        tree, wires = csv.DictReader(file)
    assert (tree["way"], tree["distance_m"], tree["required_m"], tree["margin_m"]) == (
        "fall-in", "-0.75", "3.0", "-3.75"
    )  # fmt: skip
    assert tree["ways"].count("; ") == 1 and tree["years"] == "" and wires["other_wire"] == "2"
    shapes = json.loads(files["encroachments.geojson"].read_text())["features"]
    assert [one["geometry"]["type"] for one in shapes] == ["Polygon", "LineString"]
    ring = np.array(shapes[0]["geometry"]["coordinates"][0])
    assert np.array_equal(ring[0], ring[-1]) and len(ring) == 5
    back = crs_transform(survey).from_lon_lat(ring)
    assert survey.encroachments is not None
    assert back[:4, :2] == pytest.approx(survey.encroachments.records[0].outline, abs=1e-3)
    assert back[:, 2] == pytest.approx(6.5, abs=1e-3)
