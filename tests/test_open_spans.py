"""Nothing that is made of a survey states a length of a span at whose end no structure is seen."""

import re
from pathlib import Path

import pytest
from tests.support import many_spans

from plnerf.export.crs import crs_transform
from plnerf.export.layers import layers_of
from plnerf.line.stations import Stretch, chains
from plnerf.line.survey import Survey
from plnerf.pipeline import write_survey
from plnerf.report.figures import Units
from plnerf.report.plan import plan
from plnerf.report.words import found
from plnerf.view.line_drawing import span_names, wire_name


def opened(survey: Survey) -> tuple[Stretch, ...]:
    return tuple(one for line in survey.lines for chain in chains(line) for one in chain if None in one.held)


@pytest.mark.slow
def test_no_output_states_the_length_of_an_open_span(tmp_path: Path) -> None:
    survey = many_spans.bent()
    stretches = opened(survey)
    assert stretches and all(one.length_m is None for one in stretches)
    lengths = [one.base.length_m for one in stretches]
    wires = [wire for one in stretches for wire in one.span.wires]
    lengths += [of for wire in wires for of in (wire.base.length_m, wire.length_m)]
    rounded = {f"{length:.{digits}f}" for length in lengths for digits in range(1, 5)}
    printed = re.compile(r"(?<![\d.])(?:" + "|".join(map(re.escape, rounded)) + r")(?![\d])")
    write_survey(survey, tmp_path)
    texts = {
        path.name: path.read_text()
        for path in tmp_path.iterdir()
        if path.suffix in {".html", ".csv", ".geojson", ".dxf"}
    }
    assert {"report.html", "spans.csv", "conductors.csv", "conductors.dxf"} <= texts.keys()
    texts["report.html"] = re.sub(r"<(?!text)[^>]*>", " ", texts["report.html"])  # no coordinates
    units, transform = Units(survey.frame.unit), crs_transform(survey)
    texts["viewer"] = f"{[*span_names(survey, units)]} {[wire_name(one, units) for one in survey.wires]}"
    texts["layers"] = str([one.properties for of in layers_of(survey, transform) for one in of.features])
    texts["sentence"] = found(survey)
    assert {name: printed.findall(text) for name, text in texts.items() if printed.search(text)} == {}


def test_the_plan_names_an_open_span_without_a_length() -> None:
    drawn = plan(many_spans.bent())
    assert drawn is not None and "1 / 3: open, " in drawn.svg and "1 / 2: 91.8" in drawn.svg
