"""The PL-NeRF field: what each network may depend on, and the ranges of what it says."""

import dataclasses
from typing import Any

import pytest
import torch
from torch import Tensor

from plnerf.errors import ConfigError
from plnerf.field.config import DirectionEncoding, RadianceConfig
from plnerf.field.radiance import RadianceField
from plnerf.ops.backends import Backend
from plnerf.ops.grid import GridShape

CONFIG = RadianceConfig(GridShape(3, 4, 16, 4, 10, "cubic"), hidden=16, feature=7, appearance=4)
ENCODINGS = pytest.mark.parametrize("encoding", ["ipe", "sh", "both"])


def make_field(backend: Backend = "torch", **changes: Any) -> RadianceField:
    """A field whose table is large enough for points to differ."""
    field = RadianceField(dataclasses.replace(CONFIG, **changes), backend, torch.Generator().manual_seed(0))
    with torch.no_grad():
        field.grid.table *= 1e4
    return field


def points() -> Tensor:
    """Of three rays, five samples each."""
    return torch.rand(3, 5, 3, generator=torch.Generator().manual_seed(1))


def make_inputs(field: RadianceField, rays: int = 3, samples: int = 5) -> dict[str, Tensor]:
    generator = torch.Generator().manual_seed(1)
    unit = torch.rand(rays, samples, 3, generator=generator)
    directions = torch.nn.functional.normalize(torch.randn(rays, 3, generator=generator), dim=-1)
    return {
        "feature": field.density(unit)[1].detach(),
        "ipe": torch.randn(rays, samples, 6 * field.octaves, generator=generator),
        "directions": directions,
        "appearance": torch.randn(rays, field.config.appearance, generator=generator),
    }


def test_density_and_feature_are_functions_of_the_point() -> None:
    field = make_field()
    x = points()
    density, feature = field.density(x)
    assert density.shape == (3, 5)
    assert feature.shape == (3, 5, 7)
    assert bool((density > 0).all())
    assert float(density.detach().log().std()) > 0.01
    for ray in range(3):
        alone, same = field.density(x[ray : ray + 1])
        torch.testing.assert_close(alone, density[ray : ray + 1])
        torch.testing.assert_close(same, feature[ray : ray + 1])


@pytest.mark.slow
@pytest.mark.parametrize("backend", ["torch", "numba"])
@pytest.mark.parametrize("quiet", [False, True], ids=["recording", "no_grad"])
def test_log_density_gradient_is_that_of_finite_differences(backend: Backend, quiet: bool) -> None:
    """By position, whether or not gradients are being recorded around it."""
    field = make_field(backend).double()
    x = points().double()
    with torch.set_grad_enabled(not quiet):
        found = field.log_density_gradient(x)
    steps = 1e-6 * torch.eye(3, dtype=torch.float64)
    rise = [field.density(x + step)[0].log() - field.density(x - step)[0].log() for step in steps]
    torch.testing.assert_close(found, torch.stack(rise, -1) / 2e-6, atol=1e-6, rtol=0)
    assert not x.requires_grad


@ENCODINGS
@pytest.mark.parametrize("appearance", [0, 4])
def test_colour_is_in_range_and_depends_on_what_it_should(
    encoding: DirectionEncoding, appearance: int
) -> None:
    """On the frustum's extent only by IPE; on the direction, the feature and the appearance always."""
    field = make_field(direction_encoding=encoding, appearance=appearance)
    inputs = make_inputs(field)
    colour = field.colour(**inputs)
    assert colour.shape == (3, 5, 3)
    assert bool(((colour > 0) & (colour < 1)).all())
    changed = {
        "feature": inputs["feature"] + 1,
        "ipe": inputs["ipe"].flip(0),
        "directions": inputs["directions"].flip(0),
        "appearance": inputs["appearance"] + 1,
    }
    expected = {
        "feature": True,
        "ipe": encoding != "sh",
        "directions": True,
        "appearance": appearance > 0,
    }
    for name, value in changed.items():
        moved = field.colour(**(inputs | {name: value}))
        assert torch.equal(moved, colour) != expected[name], name


@ENCODINGS
def test_each_ray_s_colour_is_its_own(encoding: DirectionEncoding) -> None:
    field = make_field(direction_encoding=encoding)
    inputs = make_inputs(field)
    whole = field.colour(**inputs)
    for ray in range(3):
        alone = field.colour(**{name: value[ray : ray + 1] for name, value in inputs.items()})
        torch.testing.assert_close(alone, whole[ray : ray + 1])


def test_predicted_normals_are_unit_vectors() -> None:
    field = make_field()
    normals = field.predicted_normals(make_inputs(field)["feature"])
    torch.testing.assert_close(normals.norm(dim=-1), torch.ones(3, 5))


def test_a_field_without_normals_says_so() -> None:
    field = make_field(normals=False)
    assert field.normal_network is None
    with pytest.raises(ConfigError, match=r"built with normals=False.*Train with field.normals=true"):
        field.predicted_normals(torch.zeros(1, 1, 7))


def test_an_unknown_direction_encoding_is_refused() -> None:
    config = dataclasses.replace(CONFIG)
    object.__setattr__(config, "direction_encoding", "fourier")  # past the tests' own type checks
    with pytest.raises(ConfigError, match="direction_encoding must be ipe, sh or both, but got 'fourier'"):
        config.__post_init__()


def test_a_field_is_a_function_of_its_generator() -> None:
    a, b = (RadianceField(CONFIG, "torch", torch.Generator().manual_seed(3)).state_dict() for _ in range(2))
    assert all(torch.equal(a[name], b[name]) for name in a)
