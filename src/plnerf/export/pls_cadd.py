"""PLS-CADD's XYZ: a line for each point, `feature code, x, y, z`, and a table of codes.

Ground, plants, buildings and other things come from the cloud; wires are sampled every metre from their
curves, attachments and structures' tops are points of their own.
"""

from pathlib import Path

import numpy as np
from jaxtyping import Float, Int

from plnerf.errors import ConfigError
from plnerf.export.crs import CrsTransform
from plnerf.export.read_back import check_all, check_same
from plnerf.line.ends import Attached
from plnerf.line.survey import Survey
from plnerf.scene.files import complete_file, write_text
from plnerf.scene.las_files import open_las
from plnerf.scene.toml_files import Fields, read_toml

NAMES = (
    "ground", "low vegetation", "vegetation", "high vegetation", "building", "other", "water", "rail", "road",
    "phase", "shield", "neutral", "communication", "attachment", "structure top",
)  # fmt: skip
CODES = {name: 200 + k for k, name in enumerate(NAMES)}
"""Feature codes by default: 200 upwards, in the order of `NAMES`."""
OF_CLASS = {
    2: "ground", 3: "low vegetation", 4: "vegetation", 5: "high vegetation", 6: "building", 1: "other",
    9: "water", 10: "rail", 11: "road",
}  # fmt: skip
STEP_M = 1.0
XYZ, TABLE = "pls-cadd.xyz", "pls-cadd-codes.csv"


def load_codes(path: Path | None) -> dict[str, int]:
    """Feature codes out of a TOML file, `[codes]` with any of `NAMES`; the rest as by default."""
    if path is None:
        return CODES
    fields = Fields(read_toml(path, None, "map of feature codes"), f"The map of feature codes {path}")
    given = fields.table("codes") or {}
    fields.done()
    strange = sorted(set(given) - set(NAMES))
    if strange or not all(type(one) is int and 0 <= one < 1_000_000 for one in given.values()):
        raise ConfigError(
            f"The map of feature codes {path} has {', '.join(strange) or 'codes that are no whole numbers'}. "
            f"Give whole numbers for any of: {', '.join(NAMES)}."
        )
    return CODES | given


def write_xyz(
    folder: Path, survey: Survey, laz: Path, transform: CrsTransform, codes: dict[str, int]
) -> None:
    """Writes `pls-cadd.xyz` and its table, and reads the points back.  Raises SurveyError where they
    differ."""
    code, at = _points(survey, laz, transform, codes)
    with complete_file(folder / XYZ) as beside:
        with beside.open("w", encoding="ascii") as file:
            np.savetxt(file, np.column_stack([code, at]), fmt=["%d", "%.3f", "%.3f", "%.3f"], delimiter=",")
        back = np.loadtxt(beside, delimiter=",", ndmin=2)
        check_same(folder / XYZ, len(at), len(back), "the number of points")
        check_all(folder / XYZ, np.array_equal(back[:, 0].astype(np.int64), code), "feature codes")
        check_all(folder / XYZ, bool((np.abs(back[:, 1:] - at) <= 1e-3).all()), "coordinates")
    used = np.bincount(code, minlength=max(codes.values()) + 1)
    rows = [f"{codes[name]},{name},{used[codes[name]]}" for name in NAMES]
    write_text(folder / TABLE, "\n".join(["feature_code,what,points", *rows]) + "\n")


def _points(
    survey: Survey, laz: Path, transform: CrsTransform, codes: dict[str, int]
) -> tuple[Int[np.ndarray, " n"], Float[np.ndarray, "n 3"]]:
    with open_las(laz) as reader:
        las = reader.read()
    label = np.asarray(las.classification)
    parts = [(codes[name], las.xyz[label == k]) for k, name in OF_CLASS.items()]
    for wire in survey.wires:
        parts.append((codes.get(wire.kind, codes["phase"]), transform.to_map(wire.polyline(STEP_M))))
    ends = [end.point for wire in survey.wires for end in wire.ends if isinstance(end, Attached)]
    tops = [one.top for one in survey.structures]
    for name, some in (("attachment", ends), ("structure top", tops)):
        parts.append((codes[name], transform.to_map(np.array(some).reshape(-1, 3))))
    code = np.concatenate([np.full(len(at), one, np.int64) for one, at in parts])
    return code, np.concatenate([np.asarray(at, np.float64) for _, at in parts])
