"""The parts of the loop, its budget, and what it does when a loss is no longer finite."""

import itertools
from collections.abc import Mapping
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st
from tests.support.tiny_run import Recorder, assert_same_bits, newest_tensors, tiny_config
from torch import Tensor

from plnerf.errors import CheckpointError, ConfigError, TrainingError
from plnerf.presets.pl_nerf import PRESET as PL_NERF
from plnerf.render.model import PLNeRF
from plnerf.scene import memory
from plnerf.train import loop
from plnerf.train import step as training_step
from plnerf.train.checkpoint import list_checkpoints
from plnerf.train.config import TrainConfig
from plnerf.train.loop import (
    anneal,
    set_learning_rates,
    step_generator,
    train,
)
from plnerf.train.optimizer import build_optimizer
from plnerf.train.run import open_run, read_config
from plnerf.train.schedule import due, progress_of


def steps_saved(run: Path) -> list[int]:
    return [int(path.stem.removeprefix("step-")) for path in list_checkpoints(run / "checkpoints")]


# -- the parts


@given(st.integers(1, 300), st.integers(0, 40))
def test_due_is_true_as_often_as_asked_and_at_the_end(steps: int, times: int) -> None:
    marks = [due(step / steps, (step + 1) / steps, times) for step in range(steps)]
    assert sum(marks) == min(steps, times) if times <= steps else all(marks)
    assert marks[-1] == (times > 0)


@given(st.lists(st.floats(1e-3, 1), min_size=1, max_size=50), st.integers(1, 20))
def test_due_misses_no_mark_however_uneven_the_steps(lengths: list[float], times: int) -> None:
    total = sum(lengths)
    progress = [0.0, *(min(1.0, done / total) for done in itertools.accumulate(lengths))]
    progress[-1] = 1.0
    passed = [(a, b) for a, b in itertools.pairwise(progress) if due(a, b, times)]
    for mark in range(1, times + 1):
        assert any(a < mark / times + 1e-9 and mark / times <= b + 1e-9 for a, b in passed)


def test_progress_is_the_used_part_of_the_budget() -> None:
    steps, seconds = tiny_config(Path("/s"), steps=8), tiny_config(Path("/s"), seconds=4.0)
    assert [progress_of(steps, step, 1e9) for step in (0, 2, 8, 9)] == [0.0, 0.25, 1.0, 1.0]
    assert [progress_of(seconds, 10**9, spent) for spent in (0.0, 1.0, 4.0, 5.0)] == [0.0, 0.25, 1.0, 1.0]


def test_learning_rates_rise_wait_and_fall_to_their_share() -> None:
    cfg = TrainConfig(warmup_steps=10, lr_fall_from=0.6, lr_final_factor=0.05)
    groups = [{"params": [torch.zeros(1, requires_grad=True)], "rate": rate} for rate in (1e-2, 5e-4)]
    optimizer = torch.optim.Adam(groups)

    def rates(step: int, progress: float) -> list[float]:
        set_learning_rates(optimizer, cfg, step, progress)
        return [group["lr"] / group["rate"] for group in optimizer.param_groups]

    rise = [rates(step, 0.0)[0] for step in range(10)]
    assert rise == pytest.approx([(step + 1) / 10 for step in range(10)])
    assert rates(10, 0.0) == rates(60, 0.6) == pytest.approx([1.0, 1.0])
    assert rates(100, 1.0) == pytest.approx([0.05, 0.05])
    assert rates(100, 0.8)[0] ** 2 == pytest.approx(rates(100, 0.7)[0] * rates(100, 0.9)[0])


def test_annealing_rises_from_flat_to_untouched() -> None:
    """Mip-NeRF 360 eq. 18: b x / ((b - 1) x + 1) is 0 at 0, 1 at 1, and steepest at the start."""
    curve = [anneal(step, 100) for step in range(150)]
    assert 0 < curve[0] < 0.1
    assert curve[99:] == [1.0] * 51
    rises = [b - a for a, b in itertools.pairwise(curve[:100])]
    assert all(a > b > 0 for a, b in itertools.pairwise(rises))


def test_every_weight_is_trained_once_and_poses_only_when_refined() -> None:
    model = PLNeRF(PL_NERF.model, 5, "torch", torch.Generator().manual_seed(0))
    for refined in (False, True):
        groups = build_optimizer(model, TrainConfig(pose_refinement=refined)).param_groups
        held = [id(value) for group in groups for value in group["params"]]
        every = {id(value): name for name, value in model.named_parameters()}
        assert len(held) == len(set(held))
        left_out = {name for key, name in every.items() if key not in held}
        assert left_out == (set() if refined else {"poses.correction"})
        assert [every[id(value)] for value in groups[0]["params"]] == [
            "field.grid.table",
            "proposals.0.grid.table",
            "proposals.1.grid.table",
        ]


@given(st.integers(0, (1 << 63) - 1), st.integers(0, 10**7))
def test_draws_are_a_function_of_seed_and_step(seed: int, step: int) -> None:
    cpu = torch.device("cpu")

    def draw(seed: int, step: int) -> list[float]:
        return torch.rand(4, generator=step_generator(seed, step, cpu)).tolist()

    assert draw(seed, step) == draw(seed, step)
    assert draw(seed, step) != draw(seed, step + 1)
    assert draw(seed, step) != draw((seed + 1) % (1 << 63), step)


# -- a whole run


@pytest.fixture(scope="module")
def reference_run(built_tiny_scene: Path, tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Recorder]:
    """Twelve steps with seed 3, and what was reported."""
    folder, report = tmp_path_factory.mktemp("reference") / "run", Recorder()
    train(tiny_config(built_tiny_scene, "train.validations=3", steps=12, seed=3), folder, report)
    return folder, report


def test_a_run_reports_every_step_and_keeps_two_checkpoints(reference_run: tuple[Path, Recorder]) -> None:
    folder, report = reference_run
    assert report.done == list(range(1, 13))
    assert len(report.held_out_db) == 3
    assert report.ended and report.closed and not report.told_nothing_left
    assert steps_saved(folder) == [11, 12]
    assert report.seconds[0] == 0.0 < report.seconds[1]
    names = {"colour", "interlevel", "distortion"}
    assert all(terms.keys() - {"normals", "orientation"} == names for terms in report.terms)


def test_the_same_seed_gives_the_same_bits(
    reference_run: tuple[Path, Recorder], built_tiny_scene: Path, tmp_path: Path
) -> None:
    folder, report = reference_run
    again = Recorder()
    train(tiny_config(built_tiny_scene, "train.validations=3", steps=12, seed=3), tmp_path, again)
    assert again.terms == report.terms and again.held_out_db == report.held_out_db
    assert_same_bits(newest_tensors(tmp_path), newest_tensors(folder))


def test_another_seed_gives_others(
    reference_run: tuple[Path, Recorder], built_tiny_scene: Path, tmp_path: Path
) -> None:
    folder, report = reference_run
    other = Recorder()
    train(tiny_config(built_tiny_scene, steps=12, seed=4), tmp_path, other)
    assert all(a["colour"] != b["colour"] for a, b in zip(other.terms, report.terms, strict=True))
    mine, its = newest_tensors(tmp_path), newest_tensors(folder)
    ever_equal = {"model.poses.correction"}  # never trained here
    same = {name for name in mine if torch.equal(mine[name], its[name]) and not name.endswith(".step")}
    assert same == ever_equal


def test_validation_does_not_change_what_is_trained(
    reference_run: tuple[Path, Recorder], built_tiny_scene: Path, tmp_path: Path
) -> None:
    folder, _ = reference_run
    report = Recorder()
    train(tiny_config(built_tiny_scene, "train.validations=0", steps=12, seed=3), tmp_path, report)
    assert report.held_out_db == []
    assert_same_bits(newest_tensors(tmp_path), newest_tensors(folder))


class Interrupted(Recorder):
    """Ctrl-C after some steps."""

    def __init__(self, at: int) -> None:
        super().__init__()
        self._at = at

    def step(self, step: int, seconds: float, progress: float, terms: Mapping[str, Tensor]) -> None:
        super().step(step, seconds, progress, terms)
        if step == self._at:
            raise KeyboardInterrupt


@pytest.mark.parametrize("at", [1, 8, 12])
def test_an_interrupted_run_goes_on_to_the_same_bits(
    at: int, reference_run: tuple[Path, Recorder], built_tiny_scene: Path, tmp_path: Path
) -> None:
    """At its first step no checkpoint is there yet: it begins anew."""
    folder, whole = reference_run
    config = tiny_config(
        built_tiny_scene,
        "train.validations=3",
        "train.checkpoints=3",
        "train.pose_refinement=false",
        steps=12,
        seed=3,
    )
    first, second = Interrupted(at), Recorder()
    with pytest.raises(KeyboardInterrupt):
        train(config, tmp_path, first)
    assert first.closed and not first.ended
    train(config, tmp_path, second)
    saved = 4 * ((at - 1) // 4)  # the interrupt comes before the checkpoint of the same step
    assert second.done == list(range(saved + 1, 13))
    assert first.terms == whole.terms[:at] and second.terms == whole.terms[saved:]
    assert_same_bits(newest_tensors(tmp_path), newest_tensors(folder))


def test_refined_poses_are_resumed_too(built_tiny_scene: Path, tmp_path: Path) -> None:
    """The poses join half way, so that their optimiser state begins in the middle of the run."""
    settings = ("train.pose_refinement=true", "train.pose_from=0.5", "train.checkpoints=6")
    config = tiny_config(built_tiny_scene, *settings, steps=12, seed=3)
    train(config, tmp_path / "whole", Recorder())
    for at in (4, 9):
        with pytest.raises(KeyboardInterrupt):
            train(config, tmp_path / "parts", Interrupted(at))
    train(config, tmp_path / "parts", Recorder())
    tensors = newest_tensors(tmp_path / "parts")
    assert_same_bits(tensors, newest_tensors(tmp_path / "whole"))
    scene = open_run(tmp_path / "parts").scene
    moved = tensors["model.poses.correction"].abs().amax(1) > 0
    assert set(moved.nonzero()[:, 0].tolist()) <= set(scene.train) and moved.any()


# -- the budget


class Clock:
    """Every step takes a second, every validation and every save a hundred."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch) -> None:
        self.now = 0.0
        monkeypatch.setattr(loop, "time", SimpleNamespace(perf_counter=self.tick))
        for name in ("validation_psnr", "save_checkpoint"):
            monkeypatch.setattr(loop, name, self.slowed(getattr(loop, name)))

    def tick(self) -> float:
        self.now += 1.0
        return self.now

    def slowed(self, function: Any) -> Any:
        def call(*arguments: Any, **named: Any) -> Any:
            self.now += 100.0
            return function(*arguments, **named)

        return call


def test_only_steps_after_the_first_count_for_a_budget_in_seconds(
    built_tiny_scene: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    clock, report = Clock(monkeypatch), Recorder()
    train(tiny_config(built_tiny_scene, seconds=5.0), tmp_path, report)
    assert report.seconds == [0.0, 1.0, 2.0, 3.0, 4.0, 5.0]
    assert clock.now > 500
    assert open_run(tmp_path).seconds == 5.0


def test_a_budget_in_seconds_goes_on_from_the_seconds_of_the_checkpoint(
    built_tiny_scene: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    Clock(monkeypatch)
    first, second, third = Interrupted(4), Recorder(), Recorder()
    with pytest.raises(KeyboardInterrupt):
        train(tiny_config(built_tiny_scene, seconds=6.0), tmp_path, first)
    assert steps_saved(tmp_path)[-1] == 3  # at 2 s; the next came too late
    train(tiny_config(built_tiny_scene, seconds=6.0), tmp_path, second)
    assert second.seconds == [2.0, 3.0, 4.0, 5.0, 6.0]  # its first step is free again
    assert second.done == [4, 5, 6, 7, 8]
    train(tiny_config(built_tiny_scene, seconds=8.0), tmp_path, third)
    assert third.seconds == [6.0, 7.0, 8.0]


def test_a_finished_run_is_left_as_it_is(
    reference_run: tuple[Path, Recorder], built_tiny_scene: Path
) -> None:
    folder, _ = reference_run
    before = {path: (path.stat().st_mtime_ns, path.stat().st_size) for path in folder.rglob("*")}
    for steps in (12, 7):
        report = Recorder()
        train(tiny_config(built_tiny_scene, steps=steps, seed=3), folder, report)
        assert report.told_nothing_left and report.done == [] and not report.ended
    assert {path: (path.stat().st_mtime_ns, path.stat().st_size) for path in folder.rglob("*")} == before


def test_a_larger_budget_goes_on(built_tiny_scene: Path, tmp_path: Path) -> None:
    train(tiny_config(built_tiny_scene, steps=4), tmp_path, Recorder())
    report = Recorder()
    train(tiny_config(built_tiny_scene, steps=6), tmp_path, report)
    assert report.done == [5, 6]
    assert read_config(tmp_path).steps == 6


# -- failures


class Poisoned(Recorder):
    """Puts a NaN into a weight after some steps, as an overflow would."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch, at: int, name: str) -> None:
        super().__init__()
        self._at, self._name, self._models = at, name, []
        build = loop.build_model

        def keep(*arguments: Any) -> PLNeRF:
            self._models.append(build(*arguments))
            return self._models[-1]

        monkeypatch.setattr(loop, "build_model", keep)

    def step(self, step: int, seconds: float, progress: float, terms: Mapping[str, Tensor]) -> None:
        super().step(step, seconds, progress, terms)
        if step == self._at:
            with torch.no_grad():
                self._models[-1].get_parameter(self._name).fill_(torch.nan)


@pytest.mark.parametrize("term", ["colour", "distortion", "normals"])
@pytest.mark.parametrize("value", [torch.nan, torch.inf])
def test_a_term_that_is_not_finite_is_named(
    term: str, value: float, built_tiny_scene: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    real, calls = training_step.loss_terms, itertools.count()

    def poisoned(*arguments: Any) -> dict[str, Tensor]:
        terms = real(*arguments)
        return terms | ({term: terms[term] * value} if next(calls) == 7 else {})

    monkeypatch.setattr(training_step, "loss_terms", poisoned)
    report = Recorder()
    with pytest.raises(TrainingError, match=f"no longer finite at step 7: {term} = {value}") as caught:
        train(tiny_config(built_tiny_scene), tmp_path, report)
    text = str(caught.value)
    assert f"The last good checkpoint is {tmp_path / 'checkpoints/step-7.json'}" in text and "\n" not in text
    assert report.closed and not report.ended
    assert steps_saved(tmp_path) == [6, 7]
    run = open_run(tmp_path)
    assert run.step == 7 and all(value.isfinite().all() for value in run.model.state_dict().values())


def test_a_ruined_weight_stops_the_run_before_it_is_saved(
    built_tiny_scene: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    report = Poisoned(monkeypatch, 7, "field.density_network.0.weight")
    with pytest.raises(TrainingError, match="After step 7 the tensor 'model"):
        train(tiny_config(built_tiny_scene), tmp_path, report)
    assert steps_saved(tmp_path) == [5, 6]
    assert open_run(tmp_path).step == 6


def test_a_ruined_weight_shows_in_the_next_loss(
    built_tiny_scene: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    report = Poisoned(monkeypatch, 1, "field.density_network.0.weight")
    with pytest.raises(TrainingError, match="at step 1: colour = nan") as caught:
        train(tiny_config(built_tiny_scene, "train.checkpoints=1"), tmp_path, report)
    assert "No checkpoint had been written yet" in str(caught.value)
    assert report.done == [1]


def test_a_disk_that_fills_up_stops_the_run_and_keeps_the_checkpoint(
    built_tiny_scene: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    write = Path.write_bytes

    def full(self: Path, data: bytes) -> int:
        if self.name.startswith("step-4."):
            raise OSError(28, "No space left on device")
        return write(self, data)

    monkeypatch.setattr(Path, "write_bytes", full)
    report = Recorder()
    with pytest.raises(CheckpointError, match="step-4 could not be written"):
        train(tiny_config(built_tiny_scene), tmp_path, report)
    assert report.closed and steps_saved(tmp_path) == [2, 3]
    monkeypatch.undo()
    again = Recorder()
    train(tiny_config(built_tiny_scene), tmp_path, again)
    assert again.done == [4, 5, 6, 7, 8, 9, 10]


@pytest.mark.parametrize(
    ("setting", "text"),
    [
        ("model.field.grid.log2_table=30", "Training this model needs at least"),
        ("model.field.hidden=100000", "Training this model needs at least"),
        ("train.rays=100000000", "A step of 100,000,000 rays needs at least"),
        ("model.sampler.final=10000000", "A step of 128 rays needs at least"),
    ],
)
def test_what_does_not_fit_into_memory_is_refused_before_anything_is_made(
    setting: str, text: str, tiny_scene: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def built(*_: Any, **__: Any) -> None:
        raise AssertionError

    monkeypatch.setattr(memory, "available_bytes", lambda: 8e9)
    monkeypatch.setattr(loop, "build_model", built)
    config = tiny_config(tiny_scene, "model.field.grid.finest=100000", setting)
    with pytest.raises(ConfigError, match=text):
        train(config, tmp_path / "run", Recorder())
    assert not (tmp_path / "run" / "config.json").exists()


@pytest.mark.parametrize(
    ("settings", "steps"),
    [((), [0, 6, 7, 8]), (("train.normals_from=0",), list(range(9))),
     (("train.loss.normals_shape_density=true",), list(range(9)))],
)  # fmt: skip
def test_normals_are_trained_once_the_rates_fall(
    built_tiny_scene: Path, tmp_path: Path, settings: tuple[str, ...], steps: list[int]
) -> None:
    """From two thirds of nine steps on, and in the first, which compiles the kernels; in all of them where
    they shape the density."""
    report = Recorder()
    train(tiny_config(built_tiny_scene, *settings, steps=9), tmp_path / "run", report)
    assert [step for step, terms in enumerate(report.terms) if "normals" in terms] == steps
    assert all(("orientation" in terms) == ("normals" in terms) for terms in report.terms)
