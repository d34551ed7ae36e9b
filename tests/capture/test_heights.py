"""What heights are above is said by the CRS or by the user, and is never guessed."""

from pathlib import Path

import numpy as np
import pytest
from tests.capture.test_exif import HERE, dji, photo

from plnerf.capture import heights
from plnerf.capture.capture import CaptureConfig
from plnerf.capture.exif import PhotoFacts
from plnerf.capture.heights import (
    check_height_datum,
    crs_name,
    datum_height_m,
    geoid_height_m,
    heights_of,
    known_crs,
    missing_grids,
    with_heights,
)
from plnerf.capture.references import from_photos, read_geo_txt
from plnerf.errors import CaptureError, ConfigError
from plnerf.line.frame import LineFrame
from plnerf.survey.config import SurveyConfig
from plnerf.survey.run import _frame_with_heights

RTK = dji(AltitudeType="RtkAlt", RtkFlag="50")


@pytest.mark.parametrize(
    ("crs", "datum", "made", "kind"),
    [
        ("EPSG:25832", None, "EPSG:25832", "unknown"),
        ("EPSG:25832", "EPSG:7837", "EPSG:25832+7837", "datum"),
        ("EPSG:4326", "ellipsoid", "EPSG:4979", "ellipsoid"),
        ("EPSG:25832+7837", "ellipsoid", "EPSG:25832+7837", "datum"),  # what the file says counts
        ("EPSG:4979", "EPSG:5773", "EPSG:4979", "ellipsoid"),
        (None, None, None, "unknown"),
    ],
)
def test_heights_are_added_where_nothing_states_them(
    crs: str | None, datum: str | None, made: str | None, kind: str
) -> None:
    assert (None if crs is None else with_heights(crs, datum)) == made
    assert heights_of(made).kind == kind


def test_a_crs_without_a_code_gets_heights_too() -> None:
    for datum, kind in (("ellipsoid", "ellipsoid"), ("EPSG:5773", "datum")):
        made = with_heights("+proj=tmerc +lat_0=50 +lon_0=9.1 +k=1 +ellps=GRS80 +units=m +type=crs", datum)
        assert heights_of(made).kind == kind and known_crs(made).is_projected
    solid = with_heights("EPSG:25832", "ellipsoid")
    assert crs_name(solid) == "ETRS89 / UTM zone 32N (EPSG:25832), heights above the ellipsoid of ETRS89"


@pytest.mark.parametrize("datum", ["sea", "EPSG:25832", "EPSG:25832+7837", ""])
def test_what_is_no_height_datum_is_refused(datum: str) -> None:
    with pytest.raises(ConfigError, match=r"above the ellipsoid \(ellipsoid\) or a vertical datum"):
        check_height_datum(datum)
    with pytest.raises(ConfigError, match="vertical datum"):
        CaptureConfig(height_datum=datum)


def test_a_missing_grid_is_named_with_what_to_do() -> None:
    place = np.array([[9.0, 51.0]])
    if datum_height_m("EPSG:25832+7837", place) is not None:
        pytest.skip("the grid of DHHN2016 is installed here")
    assert missing_grids("EPSG:25832+7837") == (
        "Its grid is not installed: `projsync --file de_bkg_gcg2016.tif` brings it."
    )
    assert datum_height_m("EPSG:4979", place) == 0.0 and datum_height_m("EPSG:4326", place) is None


def test_the_geoid_s_height_is_that_of_the_first_sea_level_with_a_grid(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(heights, "SEA_LEVELS", ("EPSG:4326+3855", "EPSG:4979"))
    monkeypatch.setattr(
        heights, "datum_height_m", lambda crs, lon_lat: None if crs != "EPSG:4979" else lon_lat[:, 1] - 4.0
    )
    geoid_height_m.cache_clear()
    assert geoid_height_m(9.0, 51.0) == 47.0
    geoid_height_m.cache_clear()


def test_photos_with_rtk_have_heights_above_the_ellipsoid(tmp_path: Path) -> None:
    """Of a flight in which some lost it, these are left out; the settings count for those without."""
    facts: dict[str, PhotoFacts] = {f"{k}.jpg": photo(tmp_path, HERE, xmp=RTK) for k in range(3)}
    assert from_photos(facts).crs == from_photos(facts, "EPSG:5773").crs == "EPSG:4979"
    lost = photo(tmp_path, HERE, xmp=dji(AltitudeType="GpsFusionAlt", RtkFlag="16"))
    mixed = from_photos({**facts, "lost.jpg": lost})
    assert mixed.crs == "EPSG:4979" and "lost.jpg" not in mixed.by_name
    assert mixed.problems == (
        "lost.jpg: its GPS position is not used: its height is no RTK height as the others' are",
    )
    assert len(from_photos({**facts, "lost.jpg": lost}, "ellipsoid").by_name) == 4
    with pytest.raises(CaptureError, match=r"3 of 4 photos, such as 0.jpg, state heights above"):
        from_photos({**facts, "lost.jpg": lost}, "EPSG:5773")
    poor = from_photos({"0.jpg": facts["0.jpg"], "a.jpg": lost, "b.jpg": lost})
    assert poor.crs == "EPSG:4326" and len(poor.by_name) == 3 and "tens of metres" in poor.problems[0]
    assert from_photos({"a.jpg": lost}, "EPSG:5773").crs == "EPSG:4326+5773"


def test_a_table_s_crs_counts_before_the_settings(tmp_path: Path) -> None:
    (tmp_path / "geo.txt").write_text("EPSG:25832\na.jpg 600000 5700000 300\n")
    assert read_geo_txt(tmp_path / "geo.txt", ["a.jpg"], "EPSG:7837").crs == "EPSG:25832+7837"
    (tmp_path / "geo.txt").write_text("EPSG:25832+7837\na.jpg 600000 5700000 300\n")
    assert read_geo_txt(tmp_path / "geo.txt", ["a.jpg"], "ellipsoid").crs == "EPSG:25832+7837"


def test_a_survey_s_heights_can_be_stated() -> None:
    frame = LineFrame.of_cloud(np.zeros((1, 3)), "EPSG:28992")
    stated = _frame_with_heights(frame, SurveyConfig(height_datum="EPSG:5709"))
    assert stated.crs == "EPSG:28992+5709" and stated.same_as(frame)
    nowhere = LineFrame.of_cloud(np.zeros((1, 3)), None)
    with pytest.raises(ConfigError, match="states no coordinate reference system"):
        _frame_with_heights(nowhere, SurveyConfig(height_datum="EPSG:5709"))
    with pytest.raises(ConfigError, match="vertical datum"):
        _frame_with_heights(frame, SurveyConfig(height_datum="mud"))
