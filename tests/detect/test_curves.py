"""Curves are what the fit says, with its uncertainty; files give them back to the bit, or say why not."""

import json
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from plnerf.detect.curves import (
    CERTAIN_PX,
    REACH_PX,
    REACH_SIGMAS,
    Curve,
    read_curves,
    write_curves,
)
from plnerf.errors import SceneError

NUMBERS = st.floats(-1, 1)
FITS = st.tuples(NUMBERS, NUMBERS, NUMBERS, NUMBERS, st.floats(0, 0.2)).map(np.array)
PLANES = st.tuples(st.floats(-1, 0.4), st.floats(0.5, 1.5)).map(lambda pair: (pair[0], pair[0] + pair[1]))


def by_definition(q: np.ndarray, s: np.ndarray) -> np.ndarray:
    """y and z of the fit's letters at s of the way from the first plane to the last."""
    y0, y1, z0, z1, b = q
    return np.stack([y0 + (y1 - y0) * s, z0 + (z1 - z0) * s - 4 * b * s * (1 - s)], -1)


def a_covariance(seed: int, size: float = 0.01) -> np.ndarray:
    part = size * np.random.default_rng(seed).normal(size=(5, 5))
    return part @ part.T


@given(FITS, PLANES)
@settings(deadline=None)
def test_a_curve_goes_where_the_fit_says(q: np.ndarray, planes: tuple[float, float]) -> None:
    curve = Curve.of_fit(q, np.eye(5) * 1e-6, planes, planes, 0.001)
    s = np.linspace(0, 1, 9)
    x = planes[0] + s * (planes[1] - planes[0])
    points = curve.points(x)
    np.testing.assert_array_equal(points[:, 0], x)
    np.testing.assert_allclose(points[:, 1:], by_definition(q, s), atol=1e-9)
    middle = (q[[0, 2]] + q[[1, 3]]) / 2 - np.array([0, q[4]])  # the sag is below the chord's middle
    np.testing.assert_allclose(points[4, 1:], middle, atol=1e-9)
    assert curve.ends == planes


@given(st.integers(0, 1000), FITS)
@settings(max_examples=10, deadline=None)
def test_sigma_is_the_spread_where_and_whither_it_is_largest(seed: int, q: np.ndarray) -> None:
    """Against many curves drawn from the covariance, in all directions across."""
    planes, ends = (-0.8, 0.9), (-0.5, 0.9)
    covariance = a_covariance(seed)
    curve = Curve.of_fit(q, covariance, planes, ends, 0.001)
    drawn = np.random.default_rng(seed).multivariate_normal(q, covariance, 20_000)
    s = (np.linspace(*ends, 20) - planes[0]) / (planes[1] - planes[0])
    angle = np.linspace(0, np.pi, 60)
    across = np.stack([np.cos(angle), np.sin(angle)])
    spread = max((by_definition(drawn.T, at) @ across).std(0).max() for at in s)
    assert curve.sigma == pytest.approx(spread, rel=0.03)


@given(st.integers(0, 1000))
@settings(deadline=None)
def test_a_longer_curve_is_no_more_certain(seed: int) -> None:
    q, covariance = np.zeros(5), a_covariance(seed)
    sigmas = [
        Curve.of_fit(q, covariance, (-1.0, 1.0), (-end, end), 1e-3).sigma for end in (0.01, 0.5, 1.0, 1.5)
    ]
    assert all(a <= 1.01 * b for a, b in pairwise(sigmas))


@given(st.integers(0, 1000), st.floats(1e-5, 0.1))
@settings(deadline=None)
def test_reach_covers_the_uncertainty_and_some_pixels(seed: int, footprint: float) -> None:
    curve = Curve.of_fit(np.zeros(5), a_covariance(seed), (-1.0, 1.0), (-1.0, 1.0), footprint)
    assert curve.reach >= REACH_SIGMAS * curve.sigma and curve.reach >= REACH_PX * footprint
    assert curve.reach in (REACH_SIGMAS * curve.sigma, REACH_PX * footprint)
    assert curve.certain == (curve.sigma <= CERTAIN_PX * footprint)


CURVES = st.builds(
    Curve,
    st.tuples(NUMBERS, NUMBERS),
    st.tuples(NUMBERS, NUMBERS, NUMBERS),
    st.tuples(NUMBERS, NUMBERS),
    st.floats(0, 1),
    st.floats(0, 1),
    st.booleans(),
)


@given(st.lists(CURVES, max_size=4))
@settings(deadline=None)
def test_files_give_curves_back_to_the_bit(
    tmp_path_factory: pytest.TempPathFactory, curves: list[Curve]
) -> None:
    folder = tmp_path_factory.mktemp("curves")
    write_curves(folder / "curves.json", curves)
    assert read_curves(folder / "curves.json") == tuple(curves)
    assert [path.name for path in folder.iterdir()] == ["curves.json"]
    for curve in curves:
        assert Curve.from_json(json.loads(json.dumps(curve.to_json())), "here") == curve


GOOD = Curve((0.0, 0.1), (0.2, 0.3, 0.4), (-1.0, 1.0), 0.001, 0.01, True).to_json()
BROKEN = {
    "no_json": "{",
    "no_text": b"\xff\xfe\x00",
    "a_list": "[]",
    "a_number": "3",
    "no_curves": "{}",
    "curves_are_a_number": '{"curves": 1}',
    "a_curve_is_a_list": '{"curves": [[1, 2]]}',
    **{
        f"without_{key}": json.dumps({"curves": [{**GOOD, key: None}]}) for key in ("y", "z", "ends", "reach")
    },
    "too_few": json.dumps({"curves": [{**GOOD, "z": [1, 2]}]}),
    "too_many": json.dumps({"curves": [{**GOOD, "ends": [1, 2, 3]}]}),
    "words": json.dumps({"curves": [{**GOOD, "y": ["left", "right"]}]}),
    "no_sigma": json.dumps({"curves": [{key: GOOD[key] for key in GOOD if key != "sigma"}]}),
    "no_certain": json.dumps({"curves": [{key: GOOD[key] for key in GOOD if key != "certain"}]}),
}


@pytest.mark.parametrize("name", BROKEN)
def test_a_broken_file_says_which_and_what_to_do(name: str, tmp_path: Path) -> None:
    path, content = tmp_path / "curves.json", BROKEN[name]
    path.write_bytes(content if isinstance(content, bytes) else content.encode())
    with pytest.raises(SceneError, match="found again") as caught:
        read_curves(path)
    assert str(path) in str(caught.value) and "\n" not in str(caught.value)


def test_no_file_is_told_too(tmp_path: Path) -> None:
    with pytest.raises(SceneError, match=r"curves\.json"):
        read_curves(tmp_path / "curves.json")
