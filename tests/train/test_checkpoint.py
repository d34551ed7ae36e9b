"""A checkpoint comes back bit for bit, or not at all: no failure may cost the one before it."""

import gc
import json
import re
import subprocess
import sys
from collections.abc import Callable
from dataclasses import replace
from itertools import pairwise
from pathlib import Path

import pytest
import torch
from safetensors import safe_open
from safetensors.torch import load_file, save_file
from tests.conftest import ROOT, SNAPSHOTS
from tests.support.tiny_run import assert_same_bits, tiny_config
from torch import Tensor

from plnerf.errors import CheckpointError, PlnerfError, TrainingError
from plnerf.render.config import ModelConfig
from plnerf.render.model import PLNeRF
from plnerf.train.checkpoint import (
    drop_old_checkpoints,
    list_checkpoints,
    load_checkpoint,
    save_checkpoint,
)
from plnerf.train.optimizer import TableAdam, build_optimizer

FRAMES = {"scale": 1 / 3, "unit": "m"}


def a_model(seed: int = 0, config: ModelConfig | None = None) -> tuple[PLNeRF, TableAdam]:
    run = tiny_config(Path("/none"))
    model = PLNeRF(config or run.model, 12, "torch", torch.Generator().manual_seed(seed))
    return model, build_optimizer(model, run.train)


def a_trained_model(seed: int = 0) -> tuple[PLNeRF, TableAdam]:
    """Three steps of Adam with random gradients: every weight has a state."""
    model, optimizer = a_model(seed)
    generator = torch.Generator().manual_seed(seed)
    for _ in range(3):
        for group in optimizer.param_groups:
            group["lr"] = group["rate"]
            for value in group["params"]:
                value.grad = torch.randn(value.shape, generator=generator)
        optimizer.step()
    return model, optimizer


def state_of(optimizer: TableAdam) -> dict[str, Tensor]:
    state = optimizer.state_dict()
    return {f"{index}.{key}": value for index, items in state.items() for key, value in items.items()}


def save(folder: Path, step: int, seed: int = 0) -> Path:
    model, optimizer = a_trained_model(seed)
    return save_checkpoint(folder, model, optimizer, step=step, seconds=step / 7, frames=FRAMES).path


def names(folder: Path) -> list[str]:
    return sorted(path.name for path in folder.iterdir())


def test_weights_and_optimiser_come_back_bit_for_bit(tmp_path: Path) -> None:
    model, optimizer = a_trained_model()
    saved = save_checkpoint(tmp_path, model, optimizer, step=40, seconds=1 / 3, frames=FRAMES)
    other, other_optimizer = a_model(seed=1)
    assert not torch.equal(other.field.grid.table, model.field.grid.table)
    assert load_checkpoint(saved.path, other, other_optimizer) == saved
    assert (saved.step, saved.seconds, saved.frames) == (40, 1 / 3, FRAMES)
    assert_same_bits(other.state_dict(), model.state_dict())
    state = state_of(other_optimizer)
    assert {key.split(".")[1] for key in state} == {"step", "exp_avg", "exp_avg_sq"}
    assert_same_bits(state, state_of(optimizer))


def test_the_next_step_is_the_same_as_without_the_disk_between(tmp_path: Path) -> None:
    model, optimizer = a_trained_model()
    path = save_checkpoint(tmp_path, model, optimizer, step=3, seconds=0.0, frames=FRAMES).path
    other, other_optimizer = a_model(seed=1)
    load_checkpoint(path, other, other_optimizer)
    for one, its in ((model, optimizer), (other, other_optimizer)):
        for group in its.param_groups:
            group["lr"] = group["rate"] / 2
        for value in one.parameters():
            value.grad = value.detach().sin()
        its.step()
    assert_same_bits(other.state_dict(), model.state_dict())


@pytest.mark.slow
def test_loading_keeps_nothing(tmp_path: Path) -> None:
    """As a reader did that kept two objects of every tensor, in every round; others may keep some in one."""
    path = save(tmp_path, 5)
    model, optimizer = a_model()
    blocks = []
    for _ in range(3):
        for _ in range(4):
            load_checkpoint(path, model, optimizer)
        gc.collect()
        blocks.append(sys.getallocatedblocks())
    assert min(b - a for a, b in pairwise(blocks)) < 4 * len(list(model.parameters())), blocks


def test_files_hold_no_pickle(tmp_path: Path) -> None:
    path = save(tmp_path, 5)
    assert names(tmp_path) == ["step-5.json", "step-5.safetensors"]
    assert json.loads(path.read_text()).keys() == {"format_version", "step", "seconds", "frames"}
    data = path.with_suffix(".safetensors").read_bytes()
    header = json.loads(data[8 : 8 + int.from_bytes(data[:8], "little")])
    assert {name.split(".")[0] for name in header} == {"model", "optimizer"}
    tensors = sum(end - start for start, end in (entry["data_offsets"] for entry in header.values()))
    assert len(data) == 8 + int.from_bytes(data[:8], "little") + tensors  # a header and numbers, nothing else


def test_weights_alone_can_be_loaded(tmp_path: Path) -> None:
    path = save(tmp_path, 5)
    model, _ = a_model(seed=1)
    load_checkpoint(path, model)
    assert_same_bits(model.state_dict(), a_trained_model()[0].state_dict())


def test_whole_seconds_are_seconds(tmp_path: Path) -> None:
    path = save(tmp_path, 5)
    path.write_text(json.dumps(json.loads(path.read_text()) | {"seconds": 0}))
    assert type(load_checkpoint(path, a_model(seed=1)[0]).seconds) is float


def test_newest_is_by_number_and_a_json_file_alone_makes_a_checkpoint(tmp_path: Path) -> None:
    for step in (9, 100, 20):
        save(tmp_path, step)
    (tmp_path / "step-500.safetensors").write_bytes(b"")
    (tmp_path / "step-600.json.part").write_text("{")
    (tmp_path / "step-x.json").write_text("{}")
    assert [path.name for path in list_checkpoints(tmp_path)] == [
        "step-9.json",
        "step-20.json",
        "step-100.json",
    ]
    assert list_checkpoints(tmp_path / "none") == []


def test_dropping_old_ones_keeps_the_newest_and_clears_remains(tmp_path: Path) -> None:
    for step in (9, 100, 20):
        save(tmp_path, step)
    for remains in ("step-5.safetensors", "step-100.json.part", "step-120.safetensors.part"):
        (tmp_path / remains).write_bytes(b"")
    (tmp_path / "notes.txt").write_text("mine")
    drop_old_checkpoints(tmp_path, keep=2)
    kept = [f"step-{step}.{suffix}" for step in (100, 20) for suffix in ("json", "safetensors")]
    assert names(tmp_path) == ["notes.txt", *kept]


def test_a_crash_before_the_json_leaves_the_older_one_newest(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Each of the two renames of the second checkpoint fails in turn, as it would at a power cut."""
    older = save(tmp_path, 10)
    rename = Path.replace
    for suffix in (".safetensors", ".json"):

        def fail(self: Path, target: Path, suffix: str = suffix) -> Path:
            if target.suffix == suffix:
                raise KeyboardInterrupt
            return rename(self, target)

        monkeypatch.setattr(Path, "replace", fail)
        with pytest.raises(KeyboardInterrupt):
            save(tmp_path, 20, seed=1)
        monkeypatch.undo()
        assert list_checkpoints(tmp_path) == [older]
    model, optimizer = a_model(seed=2)
    assert load_checkpoint(list_checkpoints(tmp_path)[-1], model, optimizer).step == 10
    assert_same_bits(model.state_dict(), a_trained_model()[0].state_dict())
    save(tmp_path, 20, seed=1)  # and the remains are in nobody's way
    assert names(tmp_path) == [f"step-{s}.{suffix}" for s in (10, 20) for suffix in ("json", "safetensors")]


FULL_DISK = """
import resource, sys
from pathlib import Path
sys.path.insert(0, {tests!r})
from tests.train import test_checkpoint
from plnerf.errors import CheckpointError
folder = Path({folder!r})
test_checkpoint.save(folder, 10)
for limit in (100, 100_000):
    resource.setrlimit(resource.RLIMIT_FSIZE, (limit, resource.RLIM_INFINITY))  # larger files: EFBIG
    try:
        test_checkpoint.save(folder, 20, seed=1)
    except CheckpointError as error:
        print(error)
"""


@pytest.mark.slow
def test_a_full_disk_costs_only_the_new_checkpoint(tmp_path: Path) -> None:
    """Writes that really fail, at the beginning and in the middle of the tensors."""
    pytest.importorskip("resource")
    code = FULL_DISK.format(tests=str(ROOT), folder=str(tmp_path))
    command = [sys.executable, "-c", code]
    done = subprocess.run(command, capture_output=True, text=True, timeout=60, check=False)
    assert done.returncode == 0, done.stderr
    assert done.stdout.count("step-20 could not be written ([Errno 27] File too large)") == 2
    assert names(tmp_path) == ["step-10.json", "step-10.safetensors"]
    model, optimizer = a_model(seed=2)
    assert load_checkpoint(list_checkpoints(tmp_path)[-1], model, optimizer).step == 10
    assert_same_bits(model.state_dict(), a_trained_model()[0].state_dict())


def test_a_disk_that_is_full_for_the_json_leaves_no_tensors(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def full(self: Path, text: str) -> int:
        raise OSError(28, "No space left on device")

    save(tmp_path, 10)
    monkeypatch.setattr(Path, "write_text", full)
    with pytest.raises(CheckpointError, match="No space left on device"):
        save(tmp_path, 20)
    assert names(tmp_path) == ["step-10.json", "step-10.safetensors"]


def test_a_folder_that_cannot_be_made(tmp_path: Path) -> None:
    (tmp_path / "checkpoints").write_text("a file")
    with pytest.raises(CheckpointError, match="could not be written"):
        save(tmp_path / "checkpoints", 10)


@pytest.mark.parametrize("value", [float("nan"), float("inf")])
def test_a_ruined_model_is_not_saved(value: float, tmp_path: Path) -> None:
    save(tmp_path, 10)
    model, optimizer = a_trained_model()
    with torch.no_grad():
        model.field.density_network[0].weight[3, 1] = value
    with pytest.raises(
        TrainingError, match=r"'model\.field.density_network\.0\.weight' is no longer finite"
    ) as caught:
        save_checkpoint(tmp_path, model, optimizer, step=20, seconds=1.0, frames=FRAMES)
    assert f"The last good checkpoint is {tmp_path / 'step-10.json'}" in str(caught.value)
    assert names(tmp_path) == ["step-10.json", "step-10.safetensors"]


def edit(path: Path, **changes: object) -> None:
    path.write_text(json.dumps(json.loads(path.read_text()) | changes))


def truncate(path: Path) -> None:
    path.write_bytes(path.read_bytes()[:-100])


def of_an_unknown_type(path: Path) -> None:
    header = json.dumps({"a": {"dtype": "F6_E2M3", "shape": [8], "data_offsets": [0, 6]}}).encode()
    path.write_bytes(len(header).to_bytes(8, "little") + header + bytes(6))


SPOILT: dict[str, Callable[[Path], object]] = {
    "other_format_version": lambda path: edit(path, format_version=2),
    "no_format_version": lambda path: path.write_text("{}"),
    "json_is_a_list": lambda path: path.write_text("[]"),
    "json_is_cut_off": lambda path: path.write_text('{"format_version": 1,'),
    "json_is_not_text": lambda path: path.write_bytes(b"\xff\x00"),
    "step_is_no_number": lambda path: edit(path, step=None),
    "tensors_are_cut_off": lambda path: truncate(path.with_suffix(".safetensors")),
    "tensors_are_empty": lambda path: path.with_suffix(".safetensors").write_bytes(b""),
    "tensors_are_of_an_unknown_type": lambda path: of_an_unknown_type(path.with_suffix(".safetensors")),
    "tensors_are_gone": lambda path: path.with_suffix(".safetensors").unlink(),
}


@pytest.mark.parametrize("name", SPOILT)
def test_text_of_a_spoilt_checkpoint(name: str, tmp_path: Path, snapshot: Callable[[str, str], None]) -> None:
    path = save(tmp_path, 10)
    SPOILT[name](path)
    model, optimizer = a_model(seed=1)
    before = {key: value.clone() for key, value in model.state_dict().items()}
    with pytest.raises(CheckpointError) as caught:
        load_checkpoint(path, model, optimizer)
    assert_same_bits(model.state_dict(), before)
    snapshot(f"checkpoint_{name}", message(caught.value, tmp_path))


OTHERS: dict[str, Callable[[ModelConfig], ModelConfig]] = {
    "wider": lambda config: replace(config, field=replace(config.field, hidden=48)),
    "without_normals": lambda config: replace(config, field=replace(config.field, normals=False)),
    "other_table": lambda config: replace(
        config, field=replace(config.field, grid=replace(config.field.grid, log2_table=12))
    ),
    "more_layers": lambda config: replace(config, field=replace(config.field, colour_layers=3)),
}


@pytest.mark.parametrize("name", OTHERS)
def test_text_of_another_architecture(
    name: str, tmp_path: Path, snapshot: Callable[[str, str], None]
) -> None:
    path = save(tmp_path, 10)
    model, _ = a_model(0, OTHERS[name](tiny_config(Path("/none")).model))
    before = {key: value.clone() for key, value in model.state_dict().items()}
    with pytest.raises(CheckpointError) as caught:
        load_checkpoint(path, model)
    assert_same_bits(model.state_dict(), before)
    tensor = re.search(r"'([\w.]+)'", str(caught.value))
    assert tensor is not None
    with safe_open(path.with_suffix(".safetensors"), "pt") as file:
        assert f"model.{tensor[1]}" in file.keys() or tensor[1] in before  # noqa: SIM118 (not a mapping)
    snapshot(f"checkpoint_of_another_model_{name}", message(caught.value, tmp_path))


Tensors = dict[str, Tensor]
OTHER_STATE: dict[str, tuple[Callable[[Tensors], Tensors], str]] = {
    "fewer_rows": (
        lambda all: all | {"optimizer.0.exp_avg": all["optimizer.0.exp_avg"][:7].clone()},
        r"'optimizer.0.exp_avg' has shape \(7, 4\), the optimiser expects \(29489, 4\)",
    ),
    "transposed": (
        lambda all: all | {"optimizer.0.exp_avg_sq": all["optimizer.0.exp_avg_sq"].T.contiguous()},
        r"'optimizer.0.exp_avg_sq' has shape \(4, 29489\), the optimiser expects \(29489, 4\)",
    ),
    "steps_of_a_vector": (
        lambda all: all | {"optimizer.1.step": torch.zeros(2)},
        r"'optimizer.1.step' has shape \(2,\), the optimiser expects \(\)",
    ),
    "half_precision": (
        lambda all: all | {"optimizer.3.exp_avg": all["optimizer.3.exp_avg"].half()},
        r"'optimizer.3.exp_avg' has dtype torch.float16, the optimiser expects torch.float32",
    ),
    "one_is_missing": (
        lambda all: {name: value for name, value in all.items() if name != "optimizer.2.exp_avg"},
        r"the optimiser has the tensor 'optimizer.2.exp_avg', the checkpoint has not",
    ),
    "a_parameter_is_missing": (
        lambda all: {name: value for name, value in all.items() if "optimizer.5." not in name},
        r"the optimiser has the tensor 'optimizer.5.exp_avg', the checkpoint has not",
    ),
    "one_too_many": (
        lambda all: all | {"optimizer.2.momentum": torch.zeros(3)},
        r"the checkpoint has the tensor 'optimizer.2.momentum', the optimiser has not",
    ),
    "of_no_parameter": (
        lambda all: all | {"optimizer.first.step": torch.zeros(())},
        r"the checkpoint has the tensor 'optimizer.first.step', the optimiser has not",
    ),
    "weights_of_another_dtype": (
        lambda all: all | {"model.field.grid.table": all["model.field.grid.table"].double()},
        r"'field.grid.table' has dtype torch.float64, the model expects torch.float32",
    ),
}


@pytest.mark.parametrize("name", OTHER_STATE)
def test_state_of_another_optimiser_is_refused_before_any_is_taken(name: str, tmp_path: Path) -> None:
    """The kernels that step it know no bounds: state that is too short would be read past its end."""
    path = save(tmp_path, 10)
    spoil, text = OTHER_STATE[name]
    save_file(spoil(load_file(path.with_suffix(".safetensors"))), path.with_suffix(".safetensors"))
    model, optimizer = a_model(seed=1)
    before = {key: value.clone() for key, value in model.state_dict().items()}
    with pytest.raises(CheckpointError, match=text):
        load_checkpoint(path, model, optimizer)
    assert_same_bits(model.state_dict(), before)
    assert optimizer.state_dict() == {}


@pytest.mark.parametrize("value", [float("nan"), float("inf")])
@pytest.mark.parametrize("name", ["model.field.grid.table", "optimizer.4.exp_avg_sq"])
def test_numbers_that_are_not_finite_are_refused(name: str, value: float, tmp_path: Path) -> None:
    path = save(tmp_path, 10)
    tensors = load_file(path.with_suffix(".safetensors"))
    tensors[name].view(-1)[5] = value
    save_file(tensors, path.with_suffix(".safetensors"))
    model, optimizer = a_model(seed=1)
    before = {key: value.clone() for key, value in model.state_dict().items()}
    count, own = f"{tensors[name].numel():,}", name.removeprefix("model.")
    with pytest.raises(CheckpointError, match=f"1 of the {count} values of '{own}' are not finite. Remove"):
        load_checkpoint(path, model, optimizer)
    assert_same_bits(model.state_dict(), before)
    assert optimizer.state_dict() == {}


def test_poses_may_be_refined_from_a_checkpoint_on_or_no_longer(tmp_path: Path) -> None:
    model, plain = a_trained_model()
    cfg = tiny_config(Path("/none"), "train.pose_refinement=true").train
    refining = build_optimizer(model, cfg)
    path = save_checkpoint(tmp_path, model, plain, step=1, seconds=0.0, frames=FRAMES).path
    load_checkpoint(path, model, refining)
    assert_same_bits(state_of(refining), state_of(plain))
    poses = len(plain.state)
    assert refining.late() == {poses} and plain.late() == set()

    for group in refining.param_groups:
        group["lr"] = group["rate"]
        for value in group["params"]:
            value.grad = torch.ones_like(value)
    refining.step()
    path = save_checkpoint(tmp_path, model, refining, step=2, seconds=0.0, frames=FRAMES).path
    load_checkpoint(path, model, plain)
    its = {name: value for name, value in state_of(refining).items() if name.split(".")[0] != str(poses)}
    assert len(its) == len(state_of(refining)) - 3
    assert_same_bits(state_of(plain), its)


def test_a_checkpoint_without_an_optimiser_cannot_be_resumed(tmp_path: Path) -> None:
    model, optimizer = a_model(seed=0)  # before its first step, Adam has no state
    path = save_checkpoint(tmp_path, model, optimizer, step=0, seconds=0.0, frames=FRAMES).path
    load_checkpoint(path, model)
    with pytest.raises(CheckpointError, match="holds no optimiser state"):
        load_checkpoint(path, model, optimizer)


def message(error: PlnerfError, folder: Path) -> str:
    text = str(error)
    assert "\n" not in text and len(text) < 700 and str(folder) in text
    text = re.sub(r"cannot be read \(.*\)\.", "cannot be read (<why>).", text)  # a library's own words
    return text.replace(str(folder), "<run>")


def test_no_stored_text_is_left_over() -> None:
    stored = {path.stem for path in SNAPSHOTS.glob("checkpoint_*.txt")}
    assert stored == {f"checkpoint_{name}" for name in SPOILT} | {
        f"checkpoint_of_another_model_{name}" for name in OTHERS
    }
