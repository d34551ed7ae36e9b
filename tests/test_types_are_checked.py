"""The canary: shape annotations are executed in the tests.  Where it dies, the others are only words."""

import jaxtyping
import pytest
import torch

from plnerf.rays.frustums import Frustums
from plnerf.rays.stepfun import resample_edges
from plnerf.render.volume import weights_from_density


def test_a_wrong_shape_is_refused() -> None:
    sigma = torch.ones(2, 5)
    weights_from_density(sigma, torch.arange(6.0).expand(2, 6))
    with pytest.raises(jaxtyping.TypeCheckError):
        weights_from_density(sigma, torch.arange(5.0).expand(2, 5))
    with pytest.raises(jaxtyping.TypeCheckError):
        weights_from_density(sigma, torch.arange(6.0).expand(3, 6))


def test_a_wrong_dtype_is_refused() -> None:
    with pytest.raises(jaxtyping.TypeCheckError):
        weights_from_density(torch.ones(2, 5, dtype=torch.long), torch.arange(6.0).expand(2, 6))


def test_edges_and_weights_are_counted() -> None:
    s = torch.linspace(0, 1, 5)[None]
    resample_edges(s, torch.ones(1, 4) / 4, torch.rand(1, 3))
    with pytest.raises(jaxtyping.TypeCheckError):
        resample_edges(s, torch.ones(1, 5) / 5, torch.rand(1, 3))


def test_the_fields_of_a_dataclass_are_checked_together() -> None:
    with pytest.raises(jaxtyping.TypeCheckError):
        Frustums(torch.ones(4, 3), torch.ones(4, 3), torch.ones(4), torch.ones(5))
