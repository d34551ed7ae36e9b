"""Wires, structures, clearances and crossings as three-dimensional polylines for CAD, a layer for each kind.

DXF knows no CRS: coordinates are map coordinates (`crs.py`), and the custom property `REFERENCE` of the
header says what they and their heights refer to.  The extended data of each polyline, application PLNERF,
hold its id and what is known of it in words.
"""

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from jaxtyping import Float

from plnerf.export.drawing_library import Polyline, new, readfile, units
from plnerf.export.read_back import check_places, check_same
from plnerf.scene.files import complete_file

VERSION = "R2010"
APPLICATION = "PLNERF"
REFERENCE = "REFERENCE"
"""Name of the header's custom property."""
COLOURS = {"CONDUCTOR-PHASE": 1, "CONDUCTOR-SHIELD": 5, "STRUCTURE": 8}
"""Of AutoCAD's index, by layer; of all others `COLOUR`."""
COLOUR = 30
UNITS = {"metre": units.M, "foot": units.FT, "US survey foot": 21}
"""DXF's $INSUNITS by the name of a CRS's unit; 0, none, for others."""
_ID, _TEXT = 1071, 1000
"""Group codes of a 32-bit integer and of a text in extended data."""
_TEXT_BYTES = 255
"""Longest text that DXF allows there."""


@dataclass(frozen=True, eq=False)
class Drawn:
    """A polyline in map coordinates."""

    layer: str
    id: int
    vertices: Float[np.ndarray, "v 3"]
    about: tuple[str, ...] = ()
    """What is known of it, in words."""


def write_dxf(path: Path, lines: list[Drawn], unit: str | None, reference: str) -> None:
    """Writes polylines and reads them back.  unit: of the coordinates, by its name; None: without.

    reference: what coordinates and heights refer to, in words.  Raises SurveyError where they differ.
    """
    drawing = new(VERSION)
    drawing.header["$INSUNITS"] = UNITS.get(unit or "", 0)
    drawing.header.custom_vars.append(REFERENCE, reference)
    drawing.appids.add(APPLICATION)
    for layer in dict.fromkeys(line.layer for line in lines):
        drawing.layers.add(layer, color=COLOURS.get(layer, COLOUR))
    space = drawing.modelspace()
    for line in lines:
        drawn = space.add_polyline3d(line.vertices.tolist(), dxfattribs={"layer": line.layer})
        drawn.set_xdata(APPLICATION, _data(line))
    with complete_file(path) as beside:
        drawing.saveas(beside)
        back = readfile(beside)
        check_same(path, reference, back.header.custom_vars.get(REFERENCE), "what coordinates refer to")
        found = [entity for entity in back.modelspace() if isinstance(entity, Polyline)]
        check_same(path, len(lines), len(found), "the number of lines")
        for line, read in zip(lines, found, strict=True):
            check_same(path, line.layer, read.dxf.layer, "a layer")
            data = [(tag.code, tag.value) for tag in read.get_xdata(APPLICATION)]
            check_same(path, _data(line), data, "a line's extended data")
            vertices = np.array([list(vertex) for vertex in read.points()], dtype=np.float64)
            check_places(path, line.vertices, vertices.reshape(-1, 3), "vertices")


def _data(line: Drawn) -> list[tuple[int, int | str]]:
    """Extended data: the id, then the texts, each as far as DXF allows."""
    texts = (text.encode()[:_TEXT_BYTES].decode(errors="ignore") for text in line.about)
    return [(_ID, line.id), *((_TEXT, text) for text in texts)]
