"""What a photo says of itself: when, where, how accurately, and with which lens.

EXIF for all cameras; DJI's XMP, which knows heights and directions better, and with RTK how well.  A value
that is absent, or cannot be, is None: 0, 0 is no position but what a receiver without one writes.
"""

import re
from dataclasses import dataclass
from datetime import datetime
from pathlib import Path
from typing import Any, Literal

from PIL import ExifTags, Image

from plnerf.errors import CaptureError

MIN_SIDE_PX = 16
"""Shortest side of a photo, in pixels: smaller images are previews without features."""
HORIZONTAL_M, VERTICAL_M = 3.0, 10.0
"""Standard deviations of a position that states none: a receiver without correction signals."""
FLOAT_M, FLOAT_UP_M = 0.5, 1.0
"""Least standard deviations of a position whose RTK solution has no fixed ambiguities, whatever it states."""
RTK_FIXED, RTK_FLOAT = 50, 34
"""DJI's RtkFlag of solutions with fixed and with floating ambiguities; 16 is a single point, 0 none."""
_XMP = re.compile(rb"(?<!/)(?:drone-dji|Camera):(\w+)(?:=\"([^\"]*)\"|>([^<]*)<)")


@dataclass(frozen=True)
class GpsFix:
    """A position in WGS 84, with standard deviations."""

    longitude_deg: float
    latitude_deg: float
    height_m: float | None
    """As stated; `heights` says above what."""
    horizontal_m: float
    vertical_m: float
    heights: Literal["ellipsoid", "unknown"] = "unknown"
    """What the height is above: the ellipsoid where RTK (AltitudeType, RtkFlag) or EXIF 3.0 say so.  Else it
    may be anything: receivers write ellipsoidal heights as "above sea level", barometers drift."""


@dataclass(frozen=True)
class PhotoFacts:
    """Facts of one photo."""

    width_px: int
    height_px: int
    orientation: int
    """EXIF's: 1 is upright; 3, 6 and 8 are turned, the even ones of the rest mirrored."""
    time: datetime | None
    fix: GpsFix | None
    fix_problem: str | None
    """Why there is no position although the photo has GPS tags."""
    gimbal_deg: tuple[float, float, float] | None
    """Yaw, pitch and roll of the camera (DJI): pitch -90 looks down."""
    above_start_m: float | None
    """Height over where the flight began (DJI)."""
    focal_px: float | None
    """From the 35 mm equivalent, or from focal length and the sensor's resolution."""
    camera: str
    """Maker, model and size: photos of one camera can share intrinsics."""


def read_facts(path: Path) -> PhotoFacts:
    """Reads a photo's header, not its pixels.  Raises CaptureError where it is no usable image."""
    try:
        with Image.open(path) as image:
            (width, height), exif = image.size, image.getexif()
            details, gps = exif.get_ifd(ExifTags.IFD.Exif), exif.get_ifd(ExifTags.IFD.GPSInfo)
            xmp = image.info.get("xmp", b"")
    except Exception as error:  # what damaged bytes make Pillow raise has no common base
        raise CaptureError(
            f"{path} cannot be read as an image ({error}). Remove it, or copy it again from the camera."
        ) from error
    dji = {
        name.decode(): (one or other).decode(errors="replace")
        for name, one, other in _XMP.findall(xmp if isinstance(xmp, bytes) else xmp.encode())
    }
    if min(width, height) < MIN_SIDE_PX:
        raise CaptureError(
            f"{path} is {width} x {height} px, but each side needs at least {MIN_SIDE_PX}. Remove it."
        )
    fix, problem = _fix(gps, dji)
    gimbal = tuple(_number(dji.get(f"Gimbal{axis}Degree")) for axis in ("Yaw", "Pitch", "Roll"))
    maker, model = (_text(exif.get(tag)) for tag in (ExifTags.Base.Make, ExifTags.Base.Model))
    return PhotoFacts(
        width_px=width,
        height_px=height,
        orientation=int(_number(exif.get(ExifTags.Base.Orientation)) or 1),
        time=_time(details, exif),
        fix=fix,
        fix_problem=problem,
        gimbal_deg=None if None in gimbal else gimbal,  # type: ignore[arg-type]  # three numbers
        above_start_m=_number(dji.get("RelativeAltitude")),
        focal_px=_focal_px(details, width, height),
        camera=f"{maker} {model} {width}x{height}".strip(),
    )


def _fix(gps: dict[int, Any], dji: dict[str, str]) -> tuple[GpsFix | None, str | None]:
    """The position, or why it is none."""
    tags = ExifTags.GPS
    if not gps or tags.GPSLatitude not in gps or tags.GPSLongitude not in gps:
        return None, None
    latitude, longitude = (_degrees(gps[tag]) for tag in (tags.GPSLatitude, tags.GPSLongitude))
    if latitude is None or longitude is None:
        return None, "its coordinates are no numbers"
    north, east = (_text(gps.get(tag)).upper() for tag in (tags.GPSLatitudeRef, tags.GPSLongitudeRef))
    if north not in {"N", "S"} or east not in {"E", "W"}:
        return None, "it does not say whether north or south, east or west"
    latitude, longitude = latitude * (1 if north == "N" else -1), longitude * (1 if east == "E" else -1)
    if abs(latitude) < 1e-6 and abs(longitude) < 1e-6:
        return None, "it is 0, 0: the receiver had no position"
    if abs(latitude) > 90 or abs(longitude) > 180:
        return None, f"there is no latitude {latitude:g} or longitude {longitude:g}"
    height = _number(gps.get(tags.GPSAltitude))
    below = gps.get(tags.GPSAltitudeRef) in {b"\x01", 1, b"\x03", 3}
    height = -height if height is not None and below else height
    precise = _number(dji.get("AbsoluteAltitude"))
    flag = _number(dji.get("RtkFlag"))
    kind = dji.get("AltitudeType", "").lower()
    by_rtk = precise is not None and (kind == "rtkalt" or (not kind and flag == RTK_FIXED))
    by_exif = precise is None and gps.get(tags.GPSAltitudeRef) in {b"\x02", 2, b"\x03", 3}
    sides = [_number(dji.get(f"RtkStd{axis}")) for axis in ("Lon", "Lat")]
    horizontal = max((side for side in sides if side), default=_number(dji.get("GPSXYAccuracy")))
    vertical = _number(dji.get("RtkStdHgt")) or _number(dji.get("GPSZAccuracy"))
    # RTK that has no fixed solution states deviations that are too small, or of a solution before.
    floating = flag == RTK_FLOAT
    least, least_up = (FLOAT_M, FLOAT_UP_M) if floating else (HORIZONTAL_M, VERTICAL_M)
    if flag is None or flag == RTK_FIXED:
        least = least_up = 0.0
    return GpsFix(
        longitude,
        latitude,
        height if precise is None else precise,
        max(horizontal or HORIZONTAL_M, least),
        max(vertical or VERTICAL_M, least_up),
        "ellipsoid" if by_rtk or by_exif else "unknown",
    ), None


def _focal_px(details: dict[int, Any], width: int, height: int) -> float | None:
    """Of the image as it is, also where it was made smaller after it was taken."""
    if equivalent := _number(details.get(ExifTags.Base.FocalLengthIn35mmFilm)):
        return equivalent * float((width**2 + height**2) ** 0.5) / 43.2666  # diagonal of 36 x 24 mm
    focal_mm = _number(details.get(ExifTags.Base.FocalLength))
    per_unit = _number(details.get(ExifTags.Base.FocalPlaneXResolution))
    unit_mm = {2: 25.4, 3: 10.0, 4: 1.0}.get(
        int(_number(details.get(ExifTags.Base.FocalPlaneResolutionUnit)) or 2)
    )
    taken = _number(details.get(ExifTags.Base.ExifImageWidth)) or width
    if focal_mm and per_unit and unit_mm:
        return focal_mm * per_unit / unit_mm * max(width, height) / max(taken, 1)
    return None


def _time(details: dict[int, Any], exif: Any) -> datetime | None:
    for text in (details.get(ExifTags.Base.DateTimeOriginal), exif.get(ExifTags.Base.DateTime)):
        parts = _text(details.get(ExifTags.Base.SubsecTimeOriginal))
        try:
            time = datetime.strptime(_text(text), "%Y:%m:%d %H:%M:%S")
        except ValueError:
            continue
        return time.replace(microsecond=int(f"{parts:0<6.6}") if parts.isdecimal() else 0)
    return None


def _degrees(value: Any) -> float | None:
    """Degrees, minutes and seconds, or degrees alone."""
    parts = value if isinstance(value, tuple | list) else (value,)
    numbers = [_number(part) for part in parts]
    if not numbers or None in numbers:
        return None
    return sum((number or 0.0) / 60**k for k, number in enumerate(numbers))


def _number(value: Any) -> float | None:
    """A finite number, or None."""
    try:
        number = float(value)
    except (TypeError, ValueError, ArithmeticError):
        return None
    return number if abs(number) < 1e12 else None  # NaN is not below either


def _text(value: Any) -> str:
    text = value.decode(errors="replace") if isinstance(value, bytes) else str(value or "")
    return text.replace("\0", "").strip()
