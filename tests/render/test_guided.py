"""Edges laid where a ray meets a curve: as many as told, inside of its windows, all else as it was."""

import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st
from torch import Tensor

from plnerf.field.guides import Windows
from plnerf.rays.warp import s_to_t, t_to_s
from plnerf.render.guided import guide_edges

WARP = (0.03, 1000.0, 0.25)


def some_edges(rays: int, edges: int, seed: int) -> Tensor:
    inner = torch.rand(rays, edges - 2, generator=torch.Generator().manual_seed(seed)).sort(1).values
    return torch.cat([torch.zeros(rays, 1), inner, torch.ones(rays, 1)], 1)


def some_windows(rays: int, k: int, seed: int, share: float = 0.5) -> Windows:
    generator = torch.Generator().manual_seed(seed + 1)
    low = 0.05 + 0.5 * torch.rand(rays, k, generator=generator)
    high = low + 0.02 + 0.1 * torch.rand(rays, k, generator=generator)
    hit = torch.rand(rays, generator=generator) < share
    return Windows(low, high, torch.zeros(rays, k, dtype=torch.int64), hit)


def a_generator(seed: int | None) -> torch.Generator | None:
    return None if seed is None else torch.Generator().manual_seed(seed)


@given(
    st.integers(3, 40).flatmap(lambda n: st.tuples(st.just(n), st.integers(1, max(1, n - 2)))),
    st.sampled_from([1, 2]),
    st.one_of(st.none(), st.integers(0, 99)),
)
@settings(deadline=None)
def test_edges_stay_sorted_as_many_and_between_the_ends(
    sizes: tuple[int, int], k: int, seed: int | None
) -> None:
    edges, count = sizes
    s, found = some_edges(30, edges, 3), some_windows(30, k, 4)
    laid = guide_edges(s, found, count, WARP, a_generator(seed))
    assert laid.shape == s.shape
    assert (laid.diff(dim=1) >= 0).all()
    assert (laid[:, 0] == 0).all() and (laid[:, -1] == 1).all()  # ends stay, all else is between them
    assert torch.equal(laid[~found.hit], s[~found.hit])


@pytest.mark.parametrize("seed", [None, 0, 1, 2])
@pytest.mark.parametrize("k", [1, 2])
@pytest.mark.parametrize("count", [2, 8, 16])
def test_a_window_holds_its_share_of_the_edges(count: int, k: int, seed: int | None) -> None:
    """Counted against the edges that were kept: those are all in the first tenth here, before any window."""
    s = some_edges(50, 24, 0) * t_to_s(torch.tensor(0.045), *WARP)
    s[:, -1] = 1
    found = some_windows(50, k, 1, share=2.0)
    t = s_to_t(guide_edges(s, found, count, WARP, a_generator(seed)), *WARP)
    slack = 1e-5
    inside = (t[:, None] >= found.low[..., None] - slack) & (t[:, None] <= found.high[..., None] + slack)
    assert (inside.sum(-1) >= count // k).all()
    assert (inside.any(1).sum(-1) == count).all()
    if k == 1:  # no wider gap than one part of the window
        mine = t[inside[:, 0]].reshape(50, count)
        part = ((found.high - found.low) / count)[:, 0]
        assert ((mine.diff(dim=1) - part[:, None]).abs() < 1e-4).all()


def test_a_window_that_stands_twice_is_filled_evenly() -> None:
    one = some_windows(20, 1, 5, share=2.0)
    twice = Windows(one.low.repeat(1, 2), one.high.repeat(1, 2), one.curve.repeat(1, 2), one.hit)
    s = some_edges(20, 25, 5)
    single, double = (guide_edges(s, found, 10, WARP, a_generator(9)) for found in (one, twice))
    torch.testing.assert_close(single, double)


def test_jitter_moves_edges_within_their_parts_and_fills_the_window() -> None:
    found = some_windows(1, 1, 6, share=2.0)
    s = some_edges(1, 12, 0) * 1e-3
    s[:, -1] = 1
    seen = []
    for seed in range(200):
        t = s_to_t(guide_edges(s, found, 4, WARP, a_generator(seed)), *WARP)[0]
        share = (t - found.low[0]) / (found.high[0] - found.low[0])
        seen.append(share[(share > -0.01) & (share < 1.01)])
    shares = torch.stack(seen)  # (200, 4)
    for part in range(4):
        assert shares[:, part].min() >= part / 4 - 1e-4 and shares[:, part].max() <= (part + 1) / 4 + 1e-4
        assert shares[:, part].min() < part / 4 + 0.02 and shares[:, part].max() > (part + 1) / 4 - 0.02


def test_without_a_generator_edges_are_in_the_middles_and_repeat() -> None:
    found, s = some_windows(5, 1, 7, share=2.0), some_edges(5, 12, 1) * 1e-3
    s[:, -1] = 1
    a, b = (guide_edges(s, found, 5, WARP, None) for _ in range(2))
    assert torch.equal(a, b)
    t = s_to_t(a, *WARP)[:, -6:-1]
    middles = found.low + (torch.arange(5) + 0.5) / 5 * (found.high - found.low)
    torch.testing.assert_close(t, middles, atol=1e-4, rtol=0)


def test_edges_that_make_room_are_spread_over_the_ray() -> None:
    """Of even edges, those that are left have no hole wider than two edges beside each other that went."""
    s = torch.linspace(0, 1, 41)[None]
    found = Windows(torch.tensor([[1e4]]), torch.tensor([[1e5]]), torch.zeros(1, 1, dtype=torch.int64),
                    torch.tensor([True]))  # fmt: skip
    laid = guide_edges(s, found, 16, WARP, None)  # all laid edges are beyond the range: at 1
    kept = laid[0, :25]
    assert (laid[0, 25:] == 1).all()
    assert kept.diff().max() < 3 / 40
