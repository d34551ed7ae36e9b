"""Where photos were taken: from the photos themselves, or from a table beside them (ODM's geo.txt).

geo.txt     line 1     EPSG:<code>, a PROJ string or WKT
            then       image x y z [yaw pitch roll [horizontal accuracy [vertical accuracy]]]
"""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from plnerf.capture.exif import HORIZONTAL_M, VERTICAL_M, PhotoFacts
from plnerf.capture.heights import ELLIPSOID, with_heights
from plnerf.capture.local_frame import check_crs
from plnerf.errors import CaptureError
from plnerf.scene.strict_json import shown

GEO_TXT = "geo.txt"
WGS_84 = "EPSG:4326"
"""Of EXIF's longitudes and latitudes, without heights."""


@dataclass(frozen=True)
class Reference:
    """The stated position of a camera."""

    xyz: tuple[float, float, float]
    """In the references' CRS; x or longitude first."""
    sigma_m: tuple[float, float, float]
    """Standard deviations east, north and up."""


@dataclass(frozen=True)
class References:
    """Positions of some images, by the images' names, in one CRS."""

    crs: str
    by_name: Mapping[str, Reference]
    source: str
    """Where they are from, in words."""
    problems: tuple[str, ...] = ()
    """What could not be used, and why."""


def from_photos(facts: Mapping[str, PhotoFacts], height_datum: str | None = None) -> References:
    """The photos' own positions, those with a height.  Without any, `by_name` is empty.

    height_datum: what heights are above of which the photos do not say it (`heights.with_heights`).  Raises
    CaptureError where the photos' heights are then above different things.
    """
    fixes, problems = {}, []
    for name, fact in facts.items():
        if fact.fix_problem:
            problems.append(f"{name}: its GPS position is not used: {fact.fix_problem}")
        if fact.fix is None:
            continue
        if fact.fix.height_m is None:
            problems.append(f"{name}: its GPS position is not used: it has no height")
            continue
        fixes[name] = fact.fix
    by_rtk = [name for name, fix in fixes.items() if fix.heights == "ellipsoid"]
    others = [name for name in fixes if name not in by_rtk]
    if by_rtk and others and height_datum != ELLIPSOID:
        if height_datum is not None:
            raise CaptureError(
                f"{len(by_rtk)} of {len(fixes)} photos, such as {by_rtk[0]}, state heights above the "
                f"ellipsoid (RTK), the others, such as {others[0]}, are said to be above {height_datum}. "
                "Capture the two apart, or give all positions in a geo.txt."
            )
        # Of a flight with RTK some photos may have lost it: their heights are of another kind.
        if len(by_rtk) >= len(others):
            text = "its GPS position is not used: its height is no RTK height as the others' are"
            problems += [f"{name}: {text}" for name in others]
            fixes = {name: fixes[name] for name in by_rtk}
        else:
            what = f"{len(by_rtk)} photos are above the ellipsoid, of {len(others)} above what is not stated"
            problems.append(f"heights of {what}: these may be off each other by tens of metres")
            by_rtk = []
    found = {
        name: Reference(
            (fix.longitude_deg, fix.latitude_deg, float(fix.height_m or 0.0)),
            (fix.horizontal_m, fix.horizontal_m, fix.vertical_m),
        )
        for name, fix in fixes.items()
    }
    crs = with_heights(WGS_84, ELLIPSOID if by_rtk else height_datum)
    return References(crs, found, "the photos' GPS tags", tuple(problems))


def read_geo_txt(path: Path, names: Sequence[str], height_datum: str | None = None) -> References:
    """Positions from ODM's geo.txt, for those of the images that it names.

    height_datum: what heights are above, where the file's CRS does not say it.

    Raises CaptureError where the file cannot be read, a line is malformed, or none of the images is named.
    """
    rows = read_rows(path, "image x y z")
    crs = with_heights(crs_of(rows[0][1]), height_datum)
    files = names_by_file(names)
    found, strangers = {}, []
    for number, line in rows[1:]:
        image, reference = _row(line, f"{path}, line {number}")
        name = files.get(Path(image).name.lower())
        if name is None:
            strangers.append(f"{image}: named in {path.name}, but there is no such image")
        else:
            found[name] = reference
    if not found:
        first = shown(rows[1][1].split()[0])
        raise CaptureError(
            f"{path} gives positions of {len(rows) - 1} images, the first of them {first}, "
            f"but none is among the {len(names)} images here, such as {next(iter(names), None)!r}. Are the "
            "names the same?"
        )
    return References(crs, found, str(path), tuple(strangers))


def read_rows(path: Path, form: str) -> list[tuple[int, str]]:
    """The lines of a table that are not empty, with their numbers: a CRS, and then one or more of `form`."""
    try:
        lines = path.read_text(encoding="utf-8-sig").splitlines()
    except (OSError, UnicodeDecodeError) as error:
        raise CaptureError(f"{path} cannot be read as text ({error}). Save it as UTF-8.") from error
    rows = [(number, line.strip()) for number, line in enumerate(lines, start=1) if line.strip()]
    if len(rows) < 2:
        raise CaptureError(
            f"{path} needs a first line with a coordinate reference system, such as EPSG:25832, and then "
            f"lines `{form}`, but has {len(rows)} lines that are not empty."
        )
    return rows


def crs_of(line: str) -> str:
    """What the first line names; ODM also writes `WGS84 UTM 32N`.  Raises CaptureError for no known CRS."""
    words = line.upper().split()
    if len(words) == 3 and words[0] == "WGS84" and words[1] == "UTM" and words[2][:-1].isdigit():
        line = f"EPSG:{(32600 if words[2].endswith('N') else 32700) + int(words[2][:-1])}"
    check_crs(line)
    return line


def names_by_file(names: Sequence[str]) -> dict[str, str]:
    """Names by their file's name in lower case, as tables may give it."""
    return {Path(name).name.lower(): name for name in names}


def _row(line: str, where: str) -> tuple[str, Reference]:
    words = line.replace(",", " ").split()
    try:
        numbers = [float(word) for word in words[1:]]
    except ValueError:
        numbers = []
    if len(numbers) < 3 or not all(map(math.isfinite, numbers[:3] + numbers[6:8])):
        raise CaptureError(
            f"{where} should be `image x y z [yaw pitch roll [horizontal [vertical accuracy]]]`, but is "
            f"{shown(line, 200)}. Correct it; a name with spaces is not possible."
        )
    horizontal = numbers[6] if len(numbers) > 6 and numbers[6] > 0 else HORIZONTAL_M
    vertical = numbers[7] if len(numbers) > 7 and numbers[7] > 0 else VERTICAL_M
    return words[0], Reference((numbers[0], numbers[1], numbers[2]), (horizontal, horizontal, vertical))
