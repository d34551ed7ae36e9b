"""A training step holds nothing that a CUDA graph cannot, and does what a step shall."""

import dataclasses
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path

import pytest
import torch
from tests.support.changed import changed
from tests.support.no_sync import Watch
from tests.support.tiny_run import open_tiny, tiny_config
from torch import Tensor

from plnerf.ops import cuda_hash, cuda_launch
from plnerf.presets.pl_nerf import PRESET as PL_NERF
from plnerf.render.model import PLNeRF
from plnerf.scene.cameras import Cameras
from plnerf.train.config import RunConfig
from plnerf.train.pixels import PixelBatch, PixelSampler, detail_pools
from plnerf.train.step import NonFiniteMonitor, Training

CAMERAS, RAYS = 5, 64
META = torch.device("meta")


def meta_training(*settings: str) -> Training:
    """A preset's model on the device that stands for a GPU; its optimiser has the least there can be."""
    start = RunConfig("", 1, "pl-nerf", "triton", "cuda", PL_NERF.model, PL_NERF.train, steps=1)
    config = changed(start, settings)
    model = PLNeRF(config.model, CAMERAS, "triton", torch.Generator()).to(META)
    for value in model.parameters():
        value.grad = torch.empty_like(value)
    sizes = [(3, 3), (3,), (2,), (2,), (5,)]
    cameras = Cameras(
        *(torch.empty(CAMERAS, *size) for size in sizes), torch.empty(CAMERAS, 2, dtype=torch.int64)
    )
    cameras = cameras.to(META)
    vars(cameras)["distorted"] = True  # what has no content cannot be asked for it
    optimizer = torch.optim.SGD(model.parameters(), lr=0.1)
    return Training(model, optimizer, cameras, config.train, NonFiniteMonitor(META))


def meta_batch() -> PixelBatch:
    return PixelBatch(
        torch.empty(RAYS, dtype=torch.int64, device=META),
        torch.empty(RAYS, 2, device=META),
        torch.empty(RAYS, 3, device=META),
        torch.empty(RAYS, device=META),
    )


@pytest.mark.parametrize("refine_poses", [False, True], ids=["poses fixed", "poses refined"])
@pytest.mark.parametrize(
    "settings",
    [
        (),
        ("model.contraction=false", "model.field.direction_encoding=both", "model.field.appearance=0"),
        ("train.loss.normals_shape_density=true", "model.field.grid.interpolation=cubic"),
        ("model.field.normals=false", "model.field.direction_encoding=sh", "train.loss.distortion=0"),
    ],
    ids=["preset", "clamped", "normals shape density", "no normals"],
)
def test_nothing_in_a_step_waits_for_the_device_or_copies_to_it(
    settings: tuple[str, ...], refine_poses: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    for module, name in ((cuda_hash, "_launch"), (cuda_launch, "_run")):
        monkeypatch.setattr(module, name, lambda *_: None)  # kernels; there is nothing for them to run on
    training = meta_training(*settings)

    def step() -> None:
        training.step(meta_batch(), torch.empty((), device=META), torch.Generator(), refine_poses)

    step()  # outside of the graph: constants are copied once
    with Watch() as watch:
        step()
    assert watch.offences == []


OFFENCES: dict[str, Callable[[Tensor, Tensor], object]] = {
    "item": lambda x, i: x.sum().item(),
    "truth of a tensor": lambda x, i: bool((x > 0).any()),
    "mask as an index": lambda x, i: x[x > 0],
    "masked assignment": lambda x, i: x.__setitem__(x > 0, x.new_zeros(())),
    "nonzero": lambda x, i: x.nonzero(),
    "unique": lambda x, i: i.unique(),
    "matrix exponential": lambda x, i: torch.linalg.matrix_exp(x[:, None] * x[:, :, None]),
    "constant by torch.tensor": lambda x, i: x + torch.tensor([1.0, 2.0, 3.0], device=x.device),
    "constant by new_tensor": lambda x, i: x.new_tensor([1.0, 2.0, 3.0]),
    "copy to the device": lambda x, i: torch.zeros(3).to(x.device),
    "copy into a tensor": lambda x, i: x.copy_(torch.zeros(4, 3)),
    "number of the host": lambda x, i: x + torch.zeros(()),
    "index of the host": lambda x, i: x[torch.zeros(2, dtype=torch.int64)],
}


@pytest.mark.parametrize("name", OFFENCES)
def test_the_watch_sees(name: str) -> None:
    x, i = torch.empty(4, 3, device=META), torch.empty(4, dtype=torch.int64, device=META)
    # What has no content cannot be asked for it.
    with Watch() as watch, suppress(RuntimeError, NotImplementedError):
        OFFENCES[name](x, i)
    assert watch.offences


def test_the_watch_lets_pass_what_a_graph_can_hold() -> None:
    x, i = torch.empty(4, 3, device=META), torch.empty(4, dtype=torch.int64, device=META)
    with Watch() as watch:
        x[i].add_(torch.rand(4, 3, device=META, generator=torch.Generator())).clamp_(0, 1).sum()
        torch.where(x > 0, x, 0.0).masked_fill(x > 1, 1.0).cumsum(-1).fill_(0.5)
        torch.nn.functional.one_hot(i, 3)
        torch.searchsorted(x, x)
        torch.ones(3).sum().item()  # on the host
        torch.tensor([1.0])
    assert watch.offences == []


def test_steps_learn_and_leave_their_inputs_alone(tiny_scene: Path, tmp_path: Path) -> None:
    scene, config = open_tiny(tiny_scene, tmp_path), tiny_config(tiny_scene)
    generator = torch.Generator().manual_seed(0)
    model = PLNeRF(config.model, len(scene.names), "numba", generator)
    for value in model.parameters():
        value.grad = torch.zeros_like(value)
    finite = NonFiniteMonitor(torch.device("cpu"))
    optimizer = torch.optim.Adam(model.parameters(), lr=0.01)
    training = Training(model, optimizer, scene.cameras, config.train, finite)
    batch = PixelSampler(scene.images, scene.train, detail_pools(scene.images, scene.train, 0.5, 0.1)).draw(
        64, generator
    )
    before = [value.clone() for value in (batch.camera, batch.pixel_px, batch.colour, batch.importance)]
    first, *_, last = (training.step(batch, 0.5, generator)["colour"].item() for _ in range(8))
    assert last < 0.8 * first
    for a, b in zip(before, (batch.camera, batch.pixel_px, batch.colour, batch.importance), strict=True):
        assert torch.equal(a, b)
    assert finite.count() == 8


def test_finite_counts_up_to_the_first_loss_that_is_not() -> None:
    finite = NonFiniteMonitor(torch.device("cpu"))
    for value in (1.0, -2.0, 0.0, float("nan"), 3.0, float("inf")):
        finite.add(torch.tensor(value))
    assert finite.count() == 3


def test_terms_carry_no_graph(tiny_scene: Path, tmp_path: Path) -> None:
    """Kept until the next line of the log, they would keep the whole step's memory."""
    scene, config = open_tiny(tiny_scene, tmp_path), tiny_config(tiny_scene)
    generator = torch.Generator().manual_seed(0)
    model = PLNeRF(config.model, len(scene.names), "numba", generator)
    optimizer = torch.optim.SGD(model.parameters(), lr=0.01)
    loss = dataclasses.replace(config.train.loss, colour=2.0)
    training = Training(
        model,
        optimizer,
        scene.cameras,
        dataclasses.replace(config.train, loss=loss),
        NonFiniteMonitor(torch.device("cpu")),
    )
    batch = PixelSampler(scene.images, scene.train).draw(32, generator)
    terms = training.step(batch, 1.0, generator)
    assert set(terms) == {"colour", "interlevel", "distortion", "normals", "orientation"}
    assert not any(term.requires_grad for term in terms.values())


@pytest.mark.slow
@pytest.mark.parametrize("refine_poses", [False, True], ids=["poses fixed", "poses refined"])
@pytest.mark.skipif(torch.cuda.is_available(), reason="Triton's kernels are not interpreted beside a GPU")
def test_a_step_with_triton_is_a_step_with_torch(
    refine_poses: bool, tiny_scene: Path, tmp_path: Path
) -> None:
    """Loss terms and every gradient, with normals that shape the density; poses only where refined."""
    scene = open_tiny(tiny_scene, tmp_path)
    config = tiny_config(
        tiny_scene, "model.field.grid.levels=2",
        "model.proposals.0.grid.levels=2", "model.proposals.1.grid.levels=2",
        "model.sampler.proposals=[8,6]", "model.sampler.final=5", "train.normal_rays=4",
        "train.loss.normals_shape_density=true",
    )  # fmt: skip
    batch = PixelSampler(scene.images, scene.train).draw(16, torch.Generator().manual_seed(0))
    found = []
    for backend in ("torch", "triton"):
        model = PLNeRF(config.model, len(scene.names), backend, torch.Generator().manual_seed(1))
        for value in model.parameters():
            value.grad = torch.zeros_like(value)
        optimizer = torch.optim.SGD(model.parameters(), lr=0.0)
        monitor = NonFiniteMonitor(torch.device("cpu"))
        training = Training(model, optimizer, scene.cameras, config.train, monitor)
        terms = training.step(batch, 0.5, torch.Generator().manual_seed(2), refine_poses)
        found.append(terms | {name: value.grad for name, value in model.named_parameters()})
    for name, truth in found[0].items():
        scale = float(truth.abs().max())
        assert scale > 0 or (name.startswith("poses") and not refine_poses), name
        torch.testing.assert_close(
            found[1][name], truth, atol=1e-4 * scale, rtol=0, msg=lambda m, n=name: f"{n}: {m}"
        )
