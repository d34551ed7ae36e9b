"""Facts of photos: positions with their signs and accuracies, directions, lenses; and what is no position."""

from datetime import datetime
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PIL import ExifTags, Image

from plnerf.capture.exif import HORIZONTAL_M, VERTICAL_M, PhotoFacts, _number, read_facts
from plnerf.errors import CaptureError

G = ExifTags.GPS
HERE = {
    G.GPSLatitudeRef: "S",
    G.GPSLatitude: (33.0, 51.0, 31.5),
    G.GPSLongitudeRef: "E",
    G.GPSLongitude: (151.0, 12.0, 36.0),
    G.GPSAltitudeRef: b"\x00",
    G.GPSAltitude: 58.25,
}
DJI = """<x:xmpmeta xmlns:x="adobe:ns:meta/"><rdf:RDF xmlns:rdf="http://www.w3.org/1999/02/22-rdf-syntax-ns#">
<rdf:Description xmlns:drone-dji="http://www.dji.com/drone-dji/1.0/" drone-dji:AbsoluteAltitude="+61.50"
 drone-dji:GimbalPitchDegree="-45.20" drone-dji:GimbalRollDegree="+0.10" drone-dji:GimbalYawDegree="+12.50"
 drone-dji:RtkStdLon="0.011" drone-dji:RtkStdLat="0.014"><drone-dji:RtkStdHgt>0.031</drone-dji:RtkStdHgt>
</rdf:Description></rdf:RDF></x:xmpmeta>"""


def photo(
    path: Path, gps: dict[int, Any] | None = None, details: dict[int, Any] | None = None,
    xmp: str | None = None, **base: Any,
) -> PhotoFacts:  # fmt: skip
    image = Image.fromarray(np.zeros((30, 40, 3), np.uint8))
    exif = image.getexif()
    exif.update({ExifTags.Base[name]: value for name, value in base.items()})
    exif.get_ifd(ExifTags.IFD.GPSInfo).update(gps or {})
    exif.get_ifd(ExifTags.IFD.Exif).update(details or {})
    extra = {} if xmp is None else {"xmp": xmp.encode()}
    image.save(path / "a.jpg", exif=exif, **extra)
    return read_facts(path / "a.jpg")


def test_positions_have_their_signs(tmp_path: Path) -> None:
    fix = photo(tmp_path, HERE).fix
    assert fix is not None
    assert (fix.horizontal_m, fix.vertical_m) == (HORIZONTAL_M, VERTICAL_M)
    assert fix.latitude_deg == pytest.approx(-33.85875) and fix.longitude_deg == pytest.approx(151.21)
    assert fix.height_m == pytest.approx(58.25)
    west = {**HERE, G.GPSLatitudeRef: "N", G.GPSLongitudeRef: "W", G.GPSAltitudeRef: b"\x01"}
    fix = photo(tmp_path, west).fix
    assert fix is not None and fix.latitude_deg > 0 > fix.longitude_deg
    assert fix.height_m == pytest.approx(-58.25)


def test_dji_states_heights_accuracies_and_directions(tmp_path: Path) -> None:
    facts = photo(tmp_path, HERE, xmp=DJI, Make="DJI\0\0", Model="M3E")
    assert facts.fix is not None and facts.camera == "DJI M3E 40x30"
    assert (facts.fix.horizontal_m, facts.fix.vertical_m, facts.fix.height_m) == (0.014, 0.031, 61.5)
    assert facts.gimbal_deg == (12.5, -45.2, 0.1)


def dji(**tags: str) -> str:
    """XMP of a drone with RTK, whose deviations are those of a fixed solution."""
    more = " ".join(f'drone-dji:{name}="{value}"' for name, value in tags.items())
    return DJI.replace("drone-dji:AbsoluteAltitude", f"{more} drone-dji:AbsoluteAltitude")


@pytest.mark.parametrize(
    ("tags", "heights", "deviations"),
    [
        ({"AltitudeType": "RtkAlt", "RtkFlag": "50"}, "ellipsoid", (0.014, 0.031)),
        ({"RtkFlag": "50"}, "ellipsoid", (0.014, 0.031)),
        ({"AltitudeType": "GpsFusionAlt", "RtkFlag": "50"}, "unknown", (0.014, 0.031)),
        ({"AltitudeType": "RtkAlt", "RtkFlag": "34"}, "ellipsoid", (0.5, 1.0)),
        ({"AltitudeType": "GpsFusionAlt", "RtkFlag": "16"}, "unknown", (HORIZONTAL_M, VERTICAL_M)),
        ({"RtkFlag": "0"}, "unknown", (HORIZONTAL_M, VERTICAL_M)),
    ],
)
def test_dji_says_what_its_heights_are_above_and_whether_rtk_was_fixed(
    tags: dict[str, str], heights: str, deviations: tuple[float, float], tmp_path: Path
) -> None:
    fix = photo(tmp_path, HERE, xmp=dji(**tags)).fix
    assert fix is not None and fix.heights == heights
    assert (fix.horizontal_m, fix.vertical_m) == deviations


@pytest.mark.parametrize(("ref", "height", "heights"), [(2, 58.25, "ellipsoid"), (3, -58.25, "ellipsoid")])
def test_exif_3_says_that_heights_are_above_the_ellipsoid(
    ref: int, height: float, heights: str, tmp_path: Path
) -> None:
    fix = photo(tmp_path, {**HERE, G.GPSAltitudeRef: bytes([ref])}).fix
    assert fix is not None and (fix.height_m, fix.heights) == (height, heights)


@pytest.mark.parametrize(
    ("change", "why"),
    [
        ({G.GPSLatitude: (0.0, 0.0, 0.0), G.GPSLongitude: (0.0, 0.0, 0.0)}, "it is 0, 0"),
        ({G.GPSLatitudeRef: ""}, "north or south"),
        ({G.GPSLongitudeRef: "X"}, "east or west"),
        ({G.GPSLatitude: (97.0, 0.0, 0.0)}, "no latitude -97"),
    ],
)
def test_what_is_no_position_says_why(change: dict[int, Any], why: str, tmp_path: Path) -> None:
    facts = photo(tmp_path, {**HERE, **change})
    assert facts.fix is None and facts.fix_problem is not None and why in facts.fix_problem
    none = photo(tmp_path)
    assert none.fix is None and none.fix_problem is None


def test_the_lens_is_that_of_the_picture_as_it_is(tmp_path: Path) -> None:
    """20 mm on 36 mm, or 4.3 mm at 16,393 pixels an inch of a picture since made 100 times smaller."""
    E = ExifTags.Base
    equivalent = photo(tmp_path, details={E.FocalLengthIn35mmFilm: 20}).focal_px
    assert equivalent == pytest.approx(20 * 50 / 43.2666)
    plane = {E.FocalLength: 4.3, E.FocalPlaneXResolution: 16393.44, E.ExifImageWidth: 4000}
    assert photo(tmp_path, details=plane).focal_px == pytest.approx(4.3 * 16393.44 / 25.4 / 100, rel=1e-4)
    assert photo(tmp_path).focal_px is None


def test_times_and_orientations(tmp_path: Path) -> None:
    E = ExifTags.Base
    taken = {E.DateTimeOriginal: "2026:05:04 03:02:01", E.SubsecTimeOriginal: "25"}
    facts = photo(tmp_path, details=taken, Orientation=6)
    assert facts.time == datetime(2026, 5, 4, 3, 2, 1, 250_000) and facts.orientation == 6
    assert photo(tmp_path, details={E.DateTimeOriginal: "0000:00:00 00:00:00"}).time is None
    assert photo(tmp_path).orientation == 1


def test_what_is_no_image_is_told(tmp_path: Path) -> None:
    (tmp_path / "a.jpg").write_bytes(b"not a picture")
    with pytest.raises(CaptureError, match=r"a\.jpg cannot be read as an image .*Remove it"):
        read_facts(tmp_path / "a.jpg")


def test_values_that_are_no_numbers_are_none(tmp_path: Path) -> None:
    E = ExifTags.Base
    taken = {E.DateTimeOriginal: "2026:05:04 03:02:01", E.SubsecTimeOriginal: "²"}  # a digit, and no decimal
    assert photo(tmp_path, details=taken).time == datetime(2026, 5, 4, 3, 2, 1)
    assert _number(10**400) is None and _number("1e999") is None and _number(float("nan")) is None


@pytest.mark.data
def test_real_photos_are_read(shared_data: Path) -> None:
    beach = read_facts(shared_data / "brighton" / "DJI_0018.JPG")
    assert beach.fix is not None and beach.fix.longitude_deg == pytest.approx(-91.99456, abs=1e-5)
    assert beach.gimbal_deg == (45.0, -89.9, 0.0) and beach.fix.height_m == 198.31
    canon = read_facts(shared_data / "seneca" / "IMG_0446.jpg")
    assert canon.fix is not None and canon.fix.latitude_deg == pytest.approx(41.03467, abs=1e-5)
    assert canon.focal_px == pytest.approx(1249, abs=1) and canon.time is not None
