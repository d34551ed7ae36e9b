"""A corridor of LAS and LAZ tiles, block after block: lines of each, then one numbering, then surveys.

    OUT/clouds/K/   a block: points.laz until it is surveyed, lines.json, labels.npz, part.json, survey/

Classes of points, and spans, are those that a block finds with all that lies within its overlap.
"""

from pathlib import Path

import numpy as np

from plnerf.corridor.cloud_blocks import sources_of, squares_of, stamps_of, write_squares
from plnerf.corridor.cloud_plan import cloud_part, seen_spans, spans_of_corridor
from plnerf.corridor.config import CorridorConfig
from plnerf.corridor.cut import cut
from plnerf.corridor.ledger import Task
from plnerf.corridor.part_file import PART, write_part
from plnerf.corridor.stages import Stages, Surveyed
from plnerf.corridor.tasks import LINES
from plnerf.findings import note
from plnerf.line.files import read_survey
from plnerf.line.frame import LineFrame
from plnerf.scene.fingerprint import file_sha256
from plnerf.survey.part import Cells
from plnerf.train.settings import to_json

CLOUDS = "clouds"
LEAST_POINTS = 100
"""Blocks with fewer are strays."""


def survey_clouds(source: Path, config: CorridorConfig, stages: Stages) -> Surveyed:
    """Finds lines in all blocks, numbers them through, and surveys every block.

    Raises SurveyError where a file cannot be read, or is not in the metres of the others.
    """
    paths = sources_of(source)
    squares = squares_of(paths, config.cut.cell_m)
    keys, side = squares.cells.keys, squares.cells.side
    settings = to_json(config)["survey"]
    tasks, cores, strays = list[Task](), list[Cells](), 0
    for block in cut((keys + 0.5) * side, config.cut):
        if squares.count[block.every].sum() < LEAST_POINTS:
            strays += int(squares.count[block.core].sum())
            continue
        folder = f"{CLOUDS}/{len(tasks) + 1:04d}"
        cores.append(Cells(side, keys[block.core]))
        every = Cells(side, keys[block.every])
        write_squares(stages.out / folder, every)
        inputs = {
            "points": stamps_of(paths, every), "sources": [str(path.resolve()) for path in paths],
            "config": {"survey": settings},
        }  # fmt: skip
        tasks.append(Task("lines", folder, inputs))
    done = {task.folder for task in stages.do("lines", tasks)}
    seen = []
    for k, task in enumerate(tasks):
        if task.folder in done:
            found = read_survey(stages.out / task.folder / LINES)
            seen += seen_spans(k, found.lines, found.frame)
    spans = spans_of_corridor(seen, cores)
    finishes = []
    for k, (task, core) in enumerate(zip(tasks, cores, strict=True)):
        if task.folder in done:
            path = stages.out / task.folder / PART
            write_part(path, cloud_part(spans, k, core))
            inputs = {**task.inputs, "part": file_sha256(path)}
            mine = tuple(span.number.span for span in spans if span.block == k)
            finishes.append((Task("finish", task.folder, inputs), mine))
    stages.do("finish", [task for task, _ in finishes])
    low, high = (keys.min(0)) * side, (keys.max(0) + 1) * side
    corners = np.array([[*low, 0.0], [*high, 0.0]])
    text = f"{strays:,} points lie in places with fewer than {LEAST_POINTS} and are left out."
    return Surveyed(
        LineFrame.of_cloud(corners, squares.crs),
        (*tasks, *(task for task, _ in finishes)),
        tuple(finishes),
        tuple(span.number.span for span in spans),
        f"{len(paths)} files, {squares.count.sum():,} points in {len(tasks)} blocks",
        (note("points astray", text),) if strays else (),
    )
