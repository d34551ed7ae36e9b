"""Cutting a corridor into blocks: every place is in one core, whatever the line's shape."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from plnerf.corridor.config import CutConfig
from plnerf.corridor.cut import Block, cut
from plnerf.errors import ConfigError, SceneError

CONFIG = CutConfig(block_m=100.0, overlap_m=30.0)


def track(length_m: float, bend_deg: float = 0.0, seed: int = 0) -> np.ndarray:
    """Places every 2 m along a line with a bend in its middle, 5 m to either side."""
    s = np.arange(0.0, length_m, 2.0)
    random = np.random.default_rng(seed)
    turn = np.where(s < length_m / 2, 0.0, np.radians(bend_deg))
    along = np.cumsum(2.0 * np.stack([np.cos(turn), np.sin(turn)], 1), axis=0)
    return along + random.uniform(-5, 5, along.shape)


def lengths(blocks: tuple[Block, ...], places: np.ndarray) -> list[float]:
    return [float(np.linalg.norm(np.ptp(places[one.core], axis=0))) for one in blocks]


@settings(max_examples=25, deadline=None)
@given(st.integers(0, 1000), st.floats(20.0, 900.0), st.floats(-120.0, 120.0))
def test_cores_divide_the_places(seed: int, length_m: float, bend_deg: float) -> None:
    places = track(length_m, bend_deg, seed)
    blocks = cut(places, CONFIG)
    assert sorted(np.concatenate([one.core for one in blocks])) == list(range(len(places)))
    for one in blocks:
        assert set(one.core) <= set(one.every)


@pytest.mark.parametrize("bend_deg", [0.0, 60.0, 100.0])
def test_a_bend_changes_no_length(bend_deg: float) -> None:
    places = track(600.0, bend_deg)
    blocks = cut(places, CONFIG)
    assert len(blocks) == 6
    assert max(lengths(blocks, places)) < 140


def test_blocks_reach_beyond_their_cores_by_the_overlap() -> None:
    places = track(600.0)
    for one in cut(places, CONFIG):
        low, high = places[one.core][:, 0].min(), places[one.core][:, 0].max()
        beyond = [low - places[one.every][:, 0].min(), places[one.every][:, 0].max() - high]
        for k, end in enumerate(beyond):
            at_the_end = (low < 12, high > 588)[k]
            assert (end < 12) if at_the_end else (18 < end < 42)


def test_branches_are_blocks_of_their_own() -> None:
    main = track(600.0)
    branch = np.array([300.0, 0.0]) + track(300.0) @ np.array([[0.0, 1.0], [-1.0, 0.0]])
    places = np.concatenate([main, branch])
    blocks = cut(places, CONFIG)
    far = [one for one in blocks if places[one.core][:, 1].max() > 150]
    assert far and all(np.abs(places[one.core][:, 0] - 300).max() < 60 for one in far)


def test_passes_on_both_sides_of_a_line_share_blocks() -> None:
    places = np.concatenate([track(300.0) + np.array([0.0, y]) for y in (-25.0, 25.0)])
    blocks = cut(places, CONFIG)
    assert len(blocks) == 3
    assert all(np.ptp(places[one.core][:, 1]) > 40 for one in blocks)


def test_flights_apart_share_no_block() -> None:
    places = np.concatenate([track(200.0), track(200.0) + np.array([0.0, 500.0])])
    blocks = cut(places, CONFIG)
    assert len(blocks) == 4
    assert all(np.ptp(places[one.every][:, 1]) < 50 for one in blocks)


def test_many_images_in_one_place_are_one_block() -> None:
    assert len(cut(np.zeros((500, 2)), CONFIG)) == 1


def test_degrees_for_metres_end_in_an_error() -> None:
    places = np.cumsum(np.full((3000, 2), 20_000.0), axis=0)
    with pytest.raises(SceneError, match="Are its coordinates metres"):
        cut(places, CutConfig(block_m=100.0, link_m=1e6))


@pytest.mark.parametrize("values", [{"block_m": 0.0}, {"overlap_m": -1.0}, {"see_m": float("nan")}])
def test_lengths_that_are_none(values: dict[str, float]) -> None:
    with pytest.raises(ConfigError, match=next(iter(values))):
        CutConfig(**values)  # type: ignore[arg-type]
