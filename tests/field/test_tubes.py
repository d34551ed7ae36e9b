"""The field around curves: nothing changes outside of it, each curve has cells of its own."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch
from tests.field.test_guides import NEAR, guides, on_parabola, rays_near, turned_wire
from tests.support.drawn import FRAME, HALF, hanging
from tests.support.tiny_run import assert_same_bits, tiny_config
from torch import Tensor

from plnerf.errors import CheckpointError, ConfigError
from plnerf.field.config import TubeConfig
from plnerf.field.guides import guides_of, windows
from plnerf.field.tubes import SLOTS, InTubes, TubeField
from plnerf.line.wire import Wire
from plnerf.ops.grid import GridShape
from plnerf.rays.rays import Rays
from plnerf.render.model import PLNeRF
from plnerf.train.checkpoint import load_checkpoint, save_checkpoint
from plnerf.train.optimizer import build_optimizer

WIRES = (hanging(0.05, 0.1, 0.05, askew=0.03, climb=0.1), hanging(-0.1, 0.0, 0.02), hanging(0.0, 0.3, 0.1))
FEATURE = 5
SMALL = TubeConfig(GridShape(levels=2, coarsest=32, finest=64, features=4, log2_table=12), hidden=8)


def a_field(wires: tuple[Wire, ...] = WIRES, seed: int = 0) -> TubeField:
    return TubeField(SMALL, FEATURE, guides_of(wires, FRAME), "torch", torch.Generator().manual_seed(seed))


def some_samples(seed: int = 0) -> tuple[Rays, Tensor]:
    """Rays near all of the curves, and edges of intervals along them, close enough to enter tubes."""
    parts = [rays_near(wire, 60, seed + k, 0.01) for k, wire in enumerate(WIRES)]
    rays = Rays(*(
        torch.cat([getattr(part, name) for part in parts])
        for name in ("origins", "directions", "radius", "camera")
    ))  # fmt: skip
    t = torch.rand(len(rays), 120, generator=torch.Generator().manual_seed(seed)).sort(1).values * 1.5
    return rays, t


def middles(rays: Rays, t: Tensor) -> Tensor:
    """(r, S, 3)."""
    return rays.origins[:, None] + ((t[:, 1:] + t[:, :-1]) / 2)[..., None] * rays.directions[:, None]


def offsets(points: Tensor, wire: Wire) -> tuple[Tensor, Tensor]:
    """Squared distance across a wire at the same x, in its reaches, and whether x is between its ends."""
    assert wire.evidence.reach_m is not None
    x, y, z = points.double().unbind(-1)
    on = torch.from_numpy(on_parabola(wire, x.flatten().numpy())).reshape(*x.shape, 3)
    across = ((y - on[..., 1]) ** 2 + (z - on[..., 2]) ** 2) / wire.evidence.reach_m**2
    return across, (x > -HALF) & (x < HALF)


def test_samples_in_tubes_are_those_within_reach_of_a_curve_that_the_ray_meets() -> None:
    rays, t = some_samples()
    found = windows(rays, guides(), NEAR)
    at = a_field().locate(rays, t, found)
    assert len(at.index) > 200 and len(at.index.unique()) == len(at.index)
    points = middles(rays, t)
    wanted = torch.zeros(points.shape[:2], dtype=torch.bool)
    unsure = torch.zeros_like(wanted)
    for k, wire in enumerate(WIRES):
        across, between = offsets(points, wire)
        met = (found.hit & (found.curve == k).any(1))[:, None]
        wanted |= (across < 1) & between & met
        unsure |= ((across - 1).abs() < 1e-3) & met
        mine = at.index[at.curve == k]
        assert len(mine) > 20
        assert (across.flatten()[mine] < 1 + 1e-3).all() and between.flatten()[mine].all()
    inside = torch.zeros_like(wanted).flatten()
    inside[at.index] = True
    assert ((inside.reshape(wanted.shape) == wanted) | unsure).all()


def test_outside_of_tubes_the_field_is_kept_to_the_bit_and_inside_replaced() -> None:
    rays, t = some_samples()
    field = a_field()
    at = field.locate(rays, t, windows(rays, guides(), NEAR))
    r, samples = t.shape[0], t.shape[1] - 1
    generator = torch.Generator().manual_seed(1)
    raw = torch.randn(r, samples, 1 + FEATURE, generator=generator)
    replaced = field.replace(raw, at)
    outside = torch.ones(r * samples, dtype=torch.bool)
    outside[at.index] = False
    assert torch.equal(replaced.flatten(0, 1)[outside], raw.flatten(0, 1)[outside])
    assert torch.equal(replaced.flatten(0, 1)[at.index], field.raw(at))


def test_rays_that_meet_nothing_are_left_alone() -> None:
    rays, t = some_samples()
    away = Rays(rays.origins + 50.0, rays.directions, rays.radius, rays.camera)
    field = a_field()
    at = field.locate(away, t, windows(away, guides(), NEAR))
    assert len(at.index) == 0
    raw = torch.rand(len(t), 119, 1 + FEATURE)
    assert torch.equal(field.replace(raw, at), raw)


def test_a_new_tube_can_be_seen_through_and_has_a_gradient() -> None:
    """As thick, optically, as told, whatever the reach of its curve."""
    curves = (hanging(0.0, 0.0, reach=0.01), hanging(0.1, 0.0, reach=0.05))
    field = a_field(curves)
    with torch.no_grad():
        for value in field.parameters():
            value.zero_()
    unit = torch.rand(40, 3, generator=torch.Generator().manual_seed(2))
    density, _ = field(InTubes(torch.arange(40), torch.arange(40) % 2, unit))
    thickness = density * 2 * torch.tensor([0.01, 0.05])[torch.arange(40) % 2]
    assert (thickness - thickness[0]).abs().max() < 1e-6 and 0.05 < thickness[0] < 0.5
    density.sum().backward()
    last = [value for value in field.network.parameters()][-1]
    assert last.grad is not None and last.grad.abs().max() > 0


def test_curves_do_not_share_places_of_the_table() -> None:
    """The most curves there can be, all in one place: points of different ones never lie in the same slot."""
    same = hanging(0.0, 0.0, reach=0.05)
    field = a_field((same,) * SLOTS**2)
    angle = torch.linspace(0, 6.2, 12)
    x = np.linspace(-0.89, 0.89, 12)
    points = torch.from_numpy(on_parabola(same, x)).float()
    points = points + 0.0499 * torch.stack([0 * angle, angle.cos(), angle.sin()], 1)
    curve = torch.arange(SLOTS**2)[:, None].expand(-1, 12)
    inside, unit = field._in_tube(points.expand(SLOTS**2, 12, 3), curve)
    assert inside.all() and unit.min() >= 0 and unit.max() <= 1
    slot = (unit[..., 1:] * SLOTS).floor().long()
    assert (slot == slot[:, :1]).all()  # all of a tube in one slot,
    assert len(slot[:, 0].unique(dim=0)) == SLOTS**2  # and no two tubes in the same
    assert (unit[..., 0].diff(dim=1) > 0).all()
    assert 0.9 * SMALL.along < unit[..., 0].max() <= SMALL.along


def test_only_samples_in_tubes_move_the_table() -> None:
    rays, t = some_samples()
    field = a_field()
    at = field.locate(rays, t, windows(rays, guides(), NEAR))
    r, samples = t.shape[0], t.shape[1] - 1
    density = field.replace(torch.zeros(r, samples, 1 + FEATURE), at)[..., 0]
    outside = torch.ones(r * samples)
    outside[at.index] = 0
    for weight, moves in ((outside, False), (1 - outside, True)):
        field.zero_grad()
        (density.flatten() * weight).sum().backward(retain_graph=True)
        moved = [value.grad is not None and bool(value.grad.abs().max() > 0) for value in field.parameters()]
        assert any(moved) == moves and (not moves or field.grid.table.grad.abs().max() > 0)


def test_a_field_learns_one_curve_without_touching_the_others() -> None:
    field = a_field()
    x = np.linspace(-0.8, 0.8, 30)
    points = torch.from_numpy(np.stack([on_parabola(wire, x) for wire in WIRES])).float()
    which = torch.arange(3)[:, None].expand(-1, 30)
    _, unit = field._in_tube(points, which)
    table = field.grid.table
    density, _ = field(InTubes(torch.arange(30), which[1], unit[1]))
    density.sum().backward()
    touched = table.grad.abs().sum(-1).flatten() > 0
    table.grad = None
    for other in (0, 2):
        density, _ = field(InTubes(torch.arange(30), which[other], unit[other]))
        density.sum().backward()
        both = touched & (table.grad.abs().sum(-1).flatten() > 0)
        assert both.sum() <= 0.05 * touched.sum()  # but for collisions of the hash
        table.grad = None


def test_too_many_curves_are_refused() -> None:
    a_field((WIRES[0],) * SLOTS**2)
    with pytest.raises(ConfigError, match=f"{SLOTS**2} curves at most, but got {SLOTS**2 + 1}"):
        a_field((WIRES[0],) * (SLOTS**2 + 1))
    with pytest.raises(ConfigError, match="hidden of 1 or more"):
        TubeConfig(hidden=0)


def a_model(wires: tuple[Wire, ...], seed: int, hidden: int = 8, tubes: bool = True) -> PLNeRF:
    config = replace(tiny_config(Path("/none")).model, tubes=replace(SMALL, hidden=hidden) if tubes else None)
    known = guides_of(wires, FRAME) if wires else None
    return PLNeRF(config, 12, "torch", torch.Generator().manual_seed(seed), known)


def test_a_checkpoint_comes_back_with_the_same_curves_and_not_into_another_model(tmp_path: Path) -> None:
    model = a_model(WIRES, 0)
    assert model.tubes is not None
    run = tiny_config(Path("/none"))
    optimizer = build_optimizer(model, run.train)
    assert {id(value) for group in optimizer.param_groups for value in group["params"]} >= {
        id(value) for value in model.tubes.parameters()
    }
    saved = save_checkpoint(tmp_path, model, optimizer, step=1, seconds=1.0, frames={"scale": 1.0})
    again = a_model(WIRES, seed=1)
    load_checkpoint(saved.path, again)
    assert_same_bits(again.state_dict(), model.state_dict())
    rays, _ = some_samples()
    appearance = torch.zeros(len(rays), model.appearance.shape[1])
    with torch.no_grad():
        assert torch.equal(
            model(rays, appearance=appearance).colour, again(rays, appearance=appearance).colour
        )
    for other in (a_model(WIRES, 1, hidden=9), a_model(WIRES, 1, tubes=False), a_model((), 1)):
        before = {key: value.clone() for key, value in other.state_dict().items()}
        with pytest.raises(CheckpointError, match="tubes"):
            load_checkpoint(saved.path, other)
        assert_same_bits(other.state_dict(), before)


def test_rays_that_meet_no_curve_are_rendered_as_without_tubes() -> None:
    with_tubes, without = a_model(WIRES, 0), a_model((), 0)
    shared = {key: value for key, value in with_tubes.state_dict().items() if not key.startswith("tubes")}
    without.load_state_dict(shared)
    rays, _ = some_samples()
    away = Rays(rays.origins + torch.tensor([0.0, 0.0, 5.0]), rays.directions, rays.radius, rays.camera)
    appearance = torch.zeros(len(rays), with_tubes.appearance.shape[1])
    with torch.no_grad():
        for some, same in ((away, True), (rays, False)):
            a, b = (model(some, appearance=appearance) for model in (with_tubes, without))
            assert torch.equal(a.colour, b.colour) == same and torch.equal(a.depth, b.depth) == same


@pytest.mark.parametrize("swing_deg", [0.0, 3.0, -40.0])
def test_a_tube_holds_its_wire_at_any_azimuth_and_swing(swing_deg: float) -> None:
    """The catenary itself lies near the middle of the tube; samples lie where they lay before the turn."""
    wire = replace(WIRES[0], theta=np.append(WIRES[0].theta[:5], np.radians(swing_deg)))
    none = torch.zeros(1, 48, dtype=torch.int64)
    places = []
    for one in (wire, turned_wire(wire, 2.2)):
        on = one.points(np.linspace(0, one.base.length_m, 50)[1:-1])
        inside, unit = a_field((one,))._in_tube(torch.from_numpy(on).float()[None], none)
        assert inside.all()
        assert ((unit[..., 1:] * SLOTS - 0.5).abs() < 0.02).all()  # of the tube's width
        places.append(unit)
    torch.testing.assert_close(places[0], places[1], atol=1e-5, rtol=0)


def test_the_tubes_run_on_the_line_that_the_pictures_draw() -> None:
    """A curve's own points are in its tube, at the middle of its slot."""
    x = np.linspace(-HALF, HALF, 50)[1:-1]
    points = torch.from_numpy(on_parabola(WIRES[0], x)).float()[None]
    inside, unit = a_field()._in_tube(points, torch.zeros(1, 48, dtype=torch.int64))
    assert inside.all()
    torch.testing.assert_close(unit[0, :, 1:], torch.full((48, 2), 0.5 / SLOTS), atol=1e-5, rtol=0)
