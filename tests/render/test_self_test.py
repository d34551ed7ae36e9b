"""What is wrong with kernels is found before they are used, and said."""

import os
from collections.abc import Callable
from dataclasses import replace

import pytest
import torch
from torch import Tensor

from plnerf.ops.backends import Backend
from plnerf.ops.dispatch import Kernels, kernels
from plnerf.ops.rendered import Rendered
from plnerf.rays.rays import Rays, pixel_rays
from plnerf.render import self_test
from plnerf.render.ray_ops import RayOps, ray_ops
from plnerf.render.self_test import fault_of

CPU = torch.device("cpu")


@pytest.mark.gpu
@pytest.mark.skipif(not torch.cuda.is_available(), reason="no CUDA device")
def test_sound_kernels_have_no_fault_on_a_gpu() -> None:
    assert fault_of("triton", torch.device("cuda")) is None


@pytest.mark.skipif(os.environ.get("TRITON_INTERPRET") != "1", reason="Triton does not interpret its kernels")
def test_sound_kernels_have_no_fault_interpreted() -> None:
    assert fault_of("triton", CPU, 40) is None  # a point takes a tenth of a second


@pytest.mark.parametrize("backend", ["numba", "torch"])
def test_other_backends_pass_it_too(backend: Backend) -> None:
    assert fault_of(backend, CPU) is None


def raising(error: Exception) -> Callable[..., Tensor]:
    def call(*_: object, **__: object) -> Tensor:
        raise error

    return call


def no_step(param: Tensor, grad: Tensor, m: Tensor, v: Tensor, **_: object) -> None:
    m.add_(0.1 * grad)


SOUND = kernels("torch")
FAULTS = {
    "the hash encoding is off by 0.01 of": {
        "hash_encode": lambda x, table, grid: 1.01 * SOUND.hash_encode(x, table, grid)
    },
    "the hash encoding is off by inf of": {
        "hash_encode": lambda x, table, grid: SOUND.hash_encode(x, table, grid) / 0
    },
    "the hash encoding is off by nan of": {
        "hash_encode": lambda x, table, grid: SOUND.hash_encode(x, table, grid) * float("nan")
    },
    "a step of Adam is off by": {"adam_rows": no_step},
    "they do not run: RuntimeError: no C compiler": {
        "hash_position_gradient": raising(RuntimeError("no C compiler\nmore"))
    },
    "they do not run: OSError: no message": {"hash_encode": raising(OSError())},
}


@pytest.mark.parametrize("said", FAULTS)
def test_a_fault_is_said_in_a_line(said: str, monkeypatch: pytest.MonkeyPatch) -> None:
    def wrong(backend: Backend) -> Kernels:
        return SOUND if backend == "torch" else SOUND._replace(**FAULTS[said])

    monkeypatch.setattr(self_test, "kernels", wrong)
    fault = fault_of("numba", CPU)
    assert fault is not None and fault.startswith(said)
    assert "\n" not in fault


FIELDS = {"origin": "origins", "direction": "directions", "radius": "radius"}


@pytest.mark.parametrize("said", FIELDS)
def test_wrong_rays_of_pixels_are_found(said: str, monkeypatch: pytest.MonkeyPatch) -> None:
    def hundredth_more(*given: object) -> Rays:
        right, field = pixel_rays(*given), FIELDS[said]  # type: ignore[arg-type]
        return right if given[-1] == "torch" else replace(right, **{field: 1.01 * getattr(right, field)})

    monkeypatch.setattr(self_test, "pixel_rays", hundredth_more)
    fault = fault_of("numba", CPU)
    assert fault is not None and fault.startswith(f"the {said} of a ray is off by 0.01")


@pytest.mark.parametrize("name", RayOps._fields)
def test_a_wrong_function_on_rays_is_found(name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """All but the two that only other presets use."""
    right = getattr(ray_ops("torch"), name)

    def hundredth_more(*args: object) -> object:
        found = right(*args)
        if not isinstance(found, tuple):
            return 1.01 * found
        parts = [1.01 * part for part in found]
        return Rendered(*parts) if isinstance(found, Rendered) else parts

    changed = ray_ops("torch")._replace(**{name: hundredth_more})
    monkeypatch.setattr(self_test, "ray_ops", lambda backend: changed)
    fault = fault_of("numba", CPU)
    assert (fault is None) == (name in {"blurred_interlevel_loss", "dilate"})
