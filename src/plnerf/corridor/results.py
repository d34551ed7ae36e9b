"""What is written of a whole corridor: the joined line, a page, a map, an index of the clouds."""

import json
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

from plnerf.corridor.ledger import KINDS, Record, Task
from plnerf.corridor.merge import BlockSurvey
from plnerf.export.crs import CrsTransform, crs_transform
from plnerf.export.exports import LAS
from plnerf.export.formats import NAMES, lacks_library
from plnerf.export.geopackage import write_gpkg
from plnerf.export.gis import Feature
from plnerf.export.las import wkt_of
from plnerf.export.layers import Layer, layers_of
from plnerf.line.files import SURVEY_FILE, write_survey_json
from plnerf.line.survey import Survey
from plnerf.pipeline import PAGE
from plnerf.report.corridor_page import SpanPage, task_table, write_corridor_page
from plnerf.scene.files import write_text
from plnerf.scene.las_files import open_las
from plnerf.scene.whole_result import whole_result
from plnerf.survey.part import WIRES_OF_A_SPAN

INDEX, STATE, MAP, CLOUDS = "index.html", "corridor.json", "corridor.gpkg", "clouds.json"
ENCROACHING = ("encroachments", "encroaching_crossings")
"""Layers of encroachments, which are numbered together."""
OF_BLOCKS = (*ENCROACHING, "clearances", "crossings", "strings")
"""Layers of a map that only the blocks' surveys have."""
BY_URGENCY = ("priority", "margin_m", "line", "span", "station_m")
"""Properties by which encroachments are numbered, as in a survey of one piece."""


@dataclass(frozen=True, eq=False)
class Corridor:
    """A surveyed corridor."""

    folder: Path
    survey: Survey
    """Of the whole, without cloud and clearances, which are with the blocks."""
    failed: tuple[tuple[str, str], ...]
    """Tasks that could not be done, each with the reason."""
    about: tuple[str, ...]
    """What was left out, and why."""


def write_results(
    out: Path, survey: Survey, blocks: Sequence[BlockSurvey], records: Sequence[tuple[Task, Record]],
    settings: dict[str, Any], failed: tuple[tuple[str, str], ...],
) -> Corridor:  # fmt: skip
    """Writes all of a corridor beside its blocks; an earlier result stays until the new one is complete."""
    about: list[str] = []
    with whole_result(out, (INDEX, STATE, MAP, CLOUDS, SURVEY_FILE)) as new:
        write_survey_json(new / SURVEY_FILE, survey)
        write_text(new / CLOUDS, json.dumps(_clouds(out, blocks), indent=1, allow_nan=False) + "\n")
        files = [SURVEY_FILE, CLOUDS, STATE]
        if why := _no_map(survey):
            about.append(why)
        else:
            _write_map(new / MAP, survey, blocks)
            files.append(MAP)
        pages = {
            span: SpanPage(block.survey, (block.folder / PAGE).relative_to(out).as_posix())
            for block in blocks
            for span in block.spans
        }
        rows = [
            (
                task.folder,
                KINDS[task.kind],
                one.state,
                f"{one.seconds:,.0f}",
                f"{one.processor_seconds:,.0f}",
                f"{one.peak_mb:,.0f}",
            )
            for task, one in records
        ]
        write_corridor_page(new / INDEX, survey, pages, task_table(rows), failed, files)
        write_text(new / STATE, json.dumps(_state(survey, records, settings, about), indent=1) + "\n")
    return Corridor(out, survey, failed, tuple(about))


def _state(
    survey: Survey, records: Sequence[tuple[Task, Record]], settings: dict[str, Any], about: Sequence[str]
) -> dict[str, Any]:
    return {
        "format_version": 1,
        "source": survey.source,
        "spans": len(survey.spans),
        "structures": len(survey.structures),
        "wires": len(survey.wires),
        "tasks": dict(Counter(one.state for _, one in records)),
        "seconds": sum(one.seconds for _, one in records),
        "processor_seconds": sum(one.processor_seconds for _, one in records),
        "about": list(about),
        "records": [
            {"block": task.folder, "makes": KINDS[task.kind], **asdict(one)} for task, one in records
        ],
        "settings": settings,
    }


def _clouds(out: Path, blocks: Sequence[BlockSurvey]) -> list[dict[str, Any]]:
    """Of each block's cloud where it lies, its points and its bounds in the coordinates of the file."""
    found = []
    for block in blocks:
        copc = block.folder / NAMES["copc"]
        path = copc if copc.is_file() else block.folder / LAS
        with open_las(path) as reader:
            header = reader.header
            found.append({
                "file": path.relative_to(out).as_posix(), "spans": list(block.spans),
                "points": int(header.point_count),
                "low": [float(one) for one in header.mins] if header.point_count else None,
                "high": [float(one) for one in header.maxs] if header.point_count else None,
                "crs": block.survey.frame.crs,
            })  # fmt: skip
    return found


def _no_map(survey: Survey) -> str:
    """Why no GeoPackage can be written; empty where it can."""
    if lacks_library("gpkg"):
        return f'{MAP} is left out: it needs pip install "plnerf[gis]".'
    if crs_transform(survey).crs is None:
        return f"{MAP} is left out: the photos state no coordinate reference system."
    return "" if survey.wires else f"{MAP} is left out: there are no wires."


def _write_map(path: Path, survey: Survey, blocks: Sequence[BlockSurvey]) -> None:
    """One GeoPackage: lines of the whole; clearances, encroachments and strings of the blocks."""
    transform = crs_transform(survey)
    assert transform.crs is not None
    layers = {one.name: _on_map(one, transform) for one in layers_of(survey, transform)}
    for block in blocks:
        its = crs_transform(block.survey)
        for one in layers_of(block.survey, its):
            if one.name not in OF_BLOCKS:
                continue
            mine = replace(one, features=tuple(of for of in one.features if _own(of, block)))
            mine = _on_map(mine, its)
            before = layers.get(one.name)
            every = mine.features if before is None else (*before.features, *mine.features)
            if every:
                layers[one.name] = replace(one, features=every)
    numbered = numbered_together(layers)
    write_gpkg(path, list(numbered.values()), lambda points: points, wkt_of(transform.crs))


def numbered_together(layers: Mapping[str, Layer]) -> dict[str, Layer]:
    """The layers with encroachments numbered by priority over the whole corridor.

    Blocks number their own, each from 1: the property `in_report` keeps the number that the span's report
    has.
    """
    some = [one for name in ENCROACHING if name in layers for one in layers[name].features]
    order = sorted(some, key=lambda one: [one.properties[name] for name in BY_URGENCY])
    number = {id(one): k for k, one in enumerate(order, 1)}

    def with_number(one: Feature) -> Feature:
        old = one.properties["encroachment"]
        return replace(
            one, properties={**one.properties, "encroachment": number[id(one)], "in_report": old}
        )

    return {
        name: replace(layer, features=tuple(map(with_number, layer.features)))
        if name in ENCROACHING
        else layer
        for name, layer in layers.items()
    }


def _on_map(layer: Layer, transform: CrsTransform) -> Layer:
    """The layer with its features in map coordinates."""
    return replace(
        layer,
        features=tuple(
            Feature(one.kind, transform.to_map(one.points), one.properties) for one in layer.features
        ),
    )


def _own(one: Feature, block: BlockSurvey) -> bool:
    """Whether a feature is about one of the block's own spans."""
    about = one.properties
    if "span" in about:
        return about["span"] in block.spans
    wires = str(about.get("wire_above", about.get("wires", ""))).split()
    return any((int(wire) - 1) // WIRES_OF_A_SPAN in block.spans for wire in wires)
