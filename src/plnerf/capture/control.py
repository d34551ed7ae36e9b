"""Control points: surveyed places that can be seen in some photos (ODM's gcp_list.txt).

    line 1     EPSG:<code>, a PROJ string or WKT
    then       x y z  pixel_x pixel_y  image  [name  [role]]

Lines of one name, or of one place where none has a name, are one point seen in several images.  The role is
`control`, a point that holds the scene, or `check`, one that says how well it is held; it stands in one line
of a point or in all.
"""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from jaxtyping import Float

from plnerf.capture.accuracy import Role
from plnerf.capture.heights import with_heights
from plnerf.capture.references import crs_of, names_by_file, read_rows
from plnerf.errors import CaptureError
from plnerf.scene.strict_json import shown

GCP_LIST = "gcp_list.txt"
SIGMA_M = 0.02
"""Standard deviation of a control point's position, surveying and clicking together."""

ROLES: dict[str, Role] = {"control": "control", "check": "check"}


@dataclass(frozen=True)
class ControlPoint:
    """A place in a survey's coordinates, and where images show it."""

    name: str
    xyz: tuple[float, float, float]
    seen_px: Mapping[str, tuple[float, float]]
    """By image, from its top-left corner."""
    role: Role = "control"
    role_stated: bool = False


@dataclass(frozen=True)
class ControlPoints:
    """All of a file, in one CRS."""

    crs: str
    points: tuple[ControlPoint, ...]
    problems: tuple[str, ...] = ()


def read_gcp_list(path: Path, names: Sequence[str], height_datum: str | None = None) -> ControlPoints:
    """Control points that two or more of the images show.  Raises CaptureError for a malformed file.

    height_datum: what heights are above, where the file's CRS does not say it.
    """
    rows = read_rows(path, "x y z pixel_x pixel_y image")
    crs, files = with_heights(crs_of(rows[0][1]), height_datum), names_by_file(names)
    places: dict[str, tuple[float, float, float]] = {}
    seen: dict[str, dict[str, tuple[float, float]]] = {}
    roles: dict[str, Role] = {}
    problems = []
    for number, line in rows[1:]:
        words = line.split()
        try:
            numbers = [float(word) for word in words[:5]]
        except ValueError:
            numbers = []
        if len(numbers) < 5 or len(words) < 6 or not all(map(math.isfinite, numbers)):
            raise CaptureError(
                f"{path}, line {number} should be `x y z pixel_x pixel_y image [name]`, but is "
                f"{shown(line, 200)}. Correct it; a name with spaces is not possible."
            )
        x, y, z, px, py = numbers
        point = words[6] if len(words) > 6 else f"{x:.3f} {y:.3f} {z:.3f}"
        image = files.get(Path(words[5]).name.lower())
        if image is None:
            problems.append(f"{words[5]}: named in {path.name}, but there is no such image")
            continue
        if math.dist(places.setdefault(point, (x, y, z)), (x, y, z)) > 0:
            raise CaptureError(
                f"{path}, line {number}: control point {point} is at {x:g} {y:g} {z:g} here and at "
                f"{' '.join(f'{v:g}' for v in places[point])} before. Correct one of the two."
            )
        seen.setdefault(point, {})[image] = (px, py)
        if len(words) > 7 and words[7].lower() not in ROLES:
            problems.append(f"{point}: {shown(words[7])} is no role (control, check) and is not considered")
        elif len(words) > 7:
            role = ROLES[words[7].lower()]
            if roles.setdefault(point, role) != role:
                raise CaptureError(
                    f"{path}, line {number}: control point {point} is a {role} point here and a "
                    f"{roles[point]} point before. Correct one of the two."
                )
    for point in [point for point in seen if len(seen[point]) < 2]:
        problems.append(f"{point}: a control point that one image alone shows is not used")
        del seen[point]
    points = tuple(
        ControlPoint(point, places[point], by_image, roles.get(point, "control"), point in roles)
        for point, by_image in seen.items()
    )
    return ControlPoints(crs, points, tuple(dict.fromkeys(problems)))


def split(control: ControlPoints, check_every: int) -> ControlPoints:
    """With every `check_every`-th of the points whose role is not stated as a check point, in their order."""
    if not check_every:
        return control
    open_ones = [point.name for point in control.points if not point.role_stated]
    checks = set(open_ones[check_every - 1 :: check_every])
    points = (replace(one, role="check") if one.name in checks else one for one in control.points)
    return replace(control, points=tuple(points))


def nearest_point(
    centres: Float[np.ndarray, "n 3"], directions: Float[np.ndarray, "n 3"]
) -> Float[np.ndarray, "3"]:
    """The point of least squared distance from n rays: sum (I - d d^T) x = sum (I - d d^T) c."""
    d = directions / np.linalg.norm(directions, axis=1, keepdims=True)
    across = np.eye(3) - d[:, :, None] * d[:, None, :]
    return np.linalg.solve(across.sum(0), np.einsum("nij,nj->i", across, centres))
