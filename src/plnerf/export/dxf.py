"""Conductors, towers and clearances as three-dimensional polylines for CAD, a layer for each kind.

DXF knows no CRS: coordinates are map coordinates (see `places.py`).  A conductor's id is in its extended
data, application PLNERF.
"""

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from ezdxf import units
from ezdxf.entities.polyline import Polyline
from ezdxf.filemanagement import new, readfile
from jaxtyping import Float

from plnerf.export.check import check_places, check_same
from plnerf.scene.files import complete_file

VERSION = "R2010"
APPLICATION = "PLNERF"
COLOURS = {"CONDUCTOR-PHASE": 1, "CONDUCTOR-SHIELD": 5, "TOWER": 8}
"""Of AutoCAD's index, by layer; of all others `COLOUR`."""
COLOUR = 30
UNITS = {"metre": units.M, "foot": units.FT, "US survey foot": 21}
"""DXF's $INSUNITS by the name of a CRS's unit; 0, none, for others."""
_ID = 1071
"""Group code of a 32-bit integer in extended data."""


@dataclass(frozen=True, eq=False)
class Line:
    """A polyline in map coordinates."""

    layer: str
    id: int
    vertices: Float[np.ndarray, "v 3"]


def write_dxf(path: Path, lines: list[Line], unit: str | None) -> None:
    """Writes lines and reads them back.  unit: of the coordinates, by its name; None: without.

    Raises SurveyError where they differ.
    """
    drawing = new(VERSION)
    drawing.header["$INSUNITS"] = UNITS.get(unit or "", 0)
    drawing.appids.add(APPLICATION)
    for layer in dict.fromkeys(line.layer for line in lines):
        drawing.layers.add(layer, color=COLOURS.get(layer, COLOUR))
    space = drawing.modelspace()
    for line in lines:
        drawn = space.add_polyline3d(line.vertices.tolist(), dxfattribs={"layer": line.layer})
        drawn.set_xdata(APPLICATION, [(_ID, line.id)])
    with complete_file(path) as beside:
        drawing.saveas(beside)
        found = [entity for entity in readfile(beside).modelspace() if isinstance(entity, Polyline)]
        check_same(path, len(lines), len(found), "the number of lines")
        for line, read in zip(lines, found, strict=True):
            check_same(path, line.layer, read.dxf.layer, "a layer")
            check_same(path, line.id, read.get_xdata(APPLICATION)[-1].value, "a line's id")
            vertices = np.array([list(vertex) for vertex in read.points()], dtype=np.float64)
            check_places(path, line.vertices, vertices.reshape(-1, 3), "vertices")
