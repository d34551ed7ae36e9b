"""Points on wires: the depth of the first thing that a ray shows."""

import torch
from hypothesis import given, settings
from hypothesis import strategies as st

from plnerf.survey.config_wires import WirePointsConfig
from plnerf.survey.wire_points import first_thing

MIN_SHARE = WirePointsConfig().min_share


def test_the_first_thing_by_hand() -> None:
    t = torch.tensor([[0.0, 1.0, 2.0, 3.0, 5.0]])  # middles 0.5, 1.5, 2.5, 4
    for w, thick, depth, share in (
        ((0.1, 0.2, 0.5, 0.2), 0.0, 2.5, 0.5),  # the first two are too faint
        ((0.4, 0.0, 0.0, 0.6), 0.0, 0.5, 0.4),  # the wire, not the more solid ground behind it
        ((0.0, 0.2, 0.2, 0.6), 0.7, 2.0, 0.4),  # two halves of one thing
        ((0.1, 0.1, 0.1, 0.1), 0.0, 0.0, 0.0),  # nothing
    ):
        found, light = first_thing(t, torch.tensor([w]), torch.tensor([thick]), MIN_SHARE)
        torch.testing.assert_close(found, torch.tensor([depth]))
        torch.testing.assert_close(light, torch.tensor([share]))


@given(st.integers(0, 1000))
@settings(deadline=None)
def test_the_first_thing_is_within_the_ray_and_gets_no_farther_with_more_light(seed: int) -> None:
    generator = torch.Generator().manual_seed(seed)
    t = 1 + torch.rand(6, 20, generator=generator).sort(1).values
    w = torch.rand(6, 19, generator=generator) ** 8
    w = w / w.sum(1, keepdim=True)
    depth, share = first_thing(t, w, torch.full((6,), 0.3), MIN_SHARE)
    there = share > 0
    assert (share[there] >= MIN_SHARE).all() and (share <= 1 + 1e-6).all()
    assert (depth[there] >= t[there, 0]).all() and (depth[there] <= t[there, -1]).all()
    assert (depth[~there] == 0).all()
    wider, more = first_thing(t, w, torch.full((6,), 9.0), MIN_SHARE)
    assert (more > 0).all()  # all light is within reach of everything
    torch.testing.assert_close(wider, (w * (t[:, 1:] + t[:, :-1]) / 2).sum(1))
