"""From a survey's coordinates to metres and back, to less than a millimetre."""

import json

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from plnerf.capture.local_frame import LocalFrame, local_frame
from plnerf.errors import CaptureError

MUNICH = np.array([[11.57, 48.137, 560.0], [11.5702, 48.1371, 585.0], [11.5698, 48.1372, 571.5]])


def test_axes_point_east_north_and_up() -> None:
    frame = LocalFrame("EPSG:4979", (11.57, 48.137, 560.0))
    there = frame.to_local(np.array([[11.57, 48.137, 560.0], [11.571, 48.137, 560.0], [11.57, 48.138, 560.0],
                                     [11.57, 48.137, 600.0]]))  # fmt: skip
    assert np.abs(there[0]).max() < 1e-8
    # Radii of curvature of the WGS 84 ellipsoid at this latitude, plus the height.
    a, e2, s = 6378137.0, 6.69437999014e-3, np.sin(np.radians(48.137))
    normal = a / np.sqrt(1 - e2 * s * s)
    meridian = normal * (1 - e2) / (1 - e2 * s * s)
    east, north = np.radians(0.001) * np.array([(normal + 560) * np.sqrt(1 - s * s), meridian + 560])
    assert there[1] == pytest.approx([east, 0, 0], abs=2e-3)
    assert there[2] == pytest.approx([0, north, 0], abs=2e-3)
    assert there[3] == pytest.approx([0, 0, 40], abs=1e-6)


def test_utm_and_geographic_input_give_the_same_metres() -> None:
    geographic = local_frame("EPSG:4979", MUNICH)
    as_utm = LocalFrame("EPSG:32632", geographic.origin)
    utm = as_utm.to_crs(geographic.to_local(MUNICH))
    assert 690_000 < utm[0, 0] < 692_000 and 5_334_000 < utm[0, 1] < 5_335_500  # zone 32, east of 9 degrees
    assert np.abs(as_utm.to_local(utm) - geographic.to_local(MUNICH)).max() < 1e-6
    assert local_frame("EPSG:32632", utm).origin == pytest.approx(geographic.origin, abs=2e-7)


@pytest.mark.parametrize(
    "crs", ["EPSG:32632", "EPSG:25832", "EPSG:4979", "EPSG:4978", "EPSG:31370", "EPSG:28992"]
)
@settings(max_examples=8, deadline=None)
@given(st.floats(-1e6, 1e6), st.floats(-1e6, 1e6), st.floats(-100, 3000))
def test_there_and_back_is_below_a_millimetre_a_thousand_kilometres_away(
    crs: str, east: float, north: float, up: float
) -> None:
    frame = LocalFrame(crs, (9.0, 48.0, 500.0))
    local = np.array([[east, north, up], [0.0, 0.0, 0.0]])
    assert np.abs(frame.to_local(frame.to_crs(local)) - local).max() < 1e-3


def test_json_gives_back_the_same_bits_and_strangers_are_refused() -> None:
    frame = local_frame("EPSG:4979", MUNICH)
    assert LocalFrame.from_json(json.loads(json.dumps(frame.to_json()))) == frame
    for wrong in ({}, {"crs": "EPSG:4979"}, {**frame.to_json(), "origin_lon_lat_height": [1, 2]}):
        with pytest.raises(CaptureError, match="needs crs and origin_lon_lat_height"):
            LocalFrame.from_json(wrong)


@pytest.mark.parametrize("crs", ["EPSG:99999", "nonsense", ""])
def test_an_unknown_crs_is_told(crs: str) -> None:
    with pytest.raises(CaptureError, match=r"cannot be used .*Give an EPSG code"):
        LocalFrame(crs, (0.0, 0.0, 0.0)).to_local(np.zeros((1, 3)))


def test_coordinates_outside_of_a_crs_are_told() -> None:
    with pytest.raises(CaptureError, match="1 of 2 coordinates lie outside of what EPSG:32632 can say"):
        LocalFrame("EPSG:32632", (9.0, 48.0, 0.0)).to_local(np.array([[5e5, 5e6, 0.0], [np.inf, 0.0, 0.0]]))


def test_heights_above_a_datum_pass_through_without_its_grid() -> None:
    """Metres above DHHN2016, and feet above NAVD88: in and out the same, metres inside."""
    german = local_frame("EPSG:25832+7837", np.array([[600_000.0, 5_700_000.0, 300.0]]))
    assert german.origin[2] == 300.0
    places = np.array([[600_100.0, 5_700_050.0, 312.5], [600_000.0, 5_700_000.0, 300.0]])
    local = german.to_local(places)
    assert np.abs(german.to_crs(local) - places).max() < 1e-3
    flat = LocalFrame("EPSG:25832", german.origin).to_local(places)
    assert local == pytest.approx(flat, abs=1e-9)
    foot = 1200 / 3937
    york = local_frame("EPSG:2263+6360", np.array([[1_000_000.0, 200_000.0, 100.0]]))
    assert york.origin[2] == pytest.approx(100 * foot, abs=1e-3)
    up = york.to_local(np.array([[1_000_000.0, 200_000.0, 200.0]]))[0]
    assert up == pytest.approx([0, 0, 100 * foot], abs=2e-2)
