"""The bench: what is compared was measured in turn, what is written is whole, what cannot be is refused."""

import dataclasses
import json
import math
from pathlib import Path
from typing import Any

import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st
from rich.console import Console
from tests.support.tiny_run import Recorder, small, tiny_config
from torch.autograd.profiler_util import FunctionEvent

from plnerf.bench import (
    breakdown,
    render_suite,
    suites,
    train_suite,
)
from plnerf.bench.config import BenchConfig
from plnerf.bench.tables import Table, figure
from plnerf.errors import ConfigError
from plnerf.scene.memory import peak_resident_bytes
from plnerf.train.config import Settings
from plnerf.train.loop import train
from plnerf.train.run import open_run

# -- the training loop


@given(st.lists(st.floats(1e-3, 1.0), min_size=0, max_size=300))
def test_windows_are_whole_and_after_the_warm_up(steps: list[float]) -> None:
    seconds = torch.tensor(steps, dtype=torch.float64).cumsum(0).tolist()
    windows = train_suite.windows_of(seconds)
    warm = max(20, round(0.1 * len(steps)))
    assert len(windows) == max(0, (len(steps) - warm) // 20)
    for i, window in enumerate(windows):
        first = warm + 20 * i
        assert window == pytest.approx(sum(steps[first : first + 20]))


@pytest.mark.slow
def test_a_stopwatch_listens_to_a_real_run(built_tiny_scene: Path, tmp_path: Path) -> None:
    watch, recorder = train_suite.Stopwatch(), Recorder()
    config = tiny_config(built_tiny_scene, steps=70)
    train(config, tmp_path / "run", watch)
    found = watch.figures()
    assert found.steps == 70
    assert found.config == config
    assert (found.training_images, found.held_out_images) == (10, 2)
    assert 0 < found.begin_wall_s < found.first_step_wall_s < found.total_wall_s
    assert 0 < found.training_s < found.total_wall_s - found.first_step_wall_s + 0.1
    assert len(found.window_s) == 2
    assert found.rays_per_s == pytest.approx(128 * found.steps_per_s)
    assert [one.step for one in found.validations] == [35, 70]
    reached = found.reached(0.0)
    assert reached == found.validations[0]
    assert found.reached(99.0) is None
    train(config, tmp_path / "again", recorder)  # listening changes nothing
    assert [one.psnr_db for one in found.validations] == recorder.held_out_db


def test_a_run_too_short_for_a_rate_is_refused() -> None:
    with pytest.raises(ConfigError, match="after 0 steps"):
        train_suite.Stopwatch().figures()


def test_memory_grows_with_what_is_held() -> None:
    before = peak_resident_bytes()
    assert before is not None
    held = bytearray(before + 2**28)  # more than has been resident at once so far
    held[:: 2**12] = bytes(len(held[:: 2**12]))
    after = peak_resident_bytes()
    assert after is not None
    assert after - before > 2**27


# -- where a step's time goes


class Trace:
    """Profiler events as torch makes them: each begins where its parent's last child ended."""

    def __init__(self) -> None:
        self.events: list[FunctionEvent] = []

    def add(
        self, name: str, own_us: float, *inner: FunctionEvent, sequence: int = -1, scope: int = 0
    ) -> FunctionEvent:
        length = own_us + sum(one.cpu_time_total for one in inner)
        event = FunctionEvent(len(self.events), name, 1, 0.0, length, sequence_nr=sequence, scope=scope)
        for one in inner:
            event.append_cpu_child(one)
            one.set_cpu_parent(event)
        self.events.append(event)
        return event


def test_each_event_goes_to_one_part_and_the_parts_add_up() -> None:
    trace = Trace()
    mul = trace.add("aten::mul", 5.0, sequence=7)
    sampling = trace.add("part: sampling, rest", 10.0, mul)
    product = trace.add("aten::addmm", 40.0, sequence=8)
    losses = trace.add("part: losses", 1.0, product)
    inner = trace.add("MulBackward0", 1.0, trace.add("aten::mul", 3.0), sequence=7, scope=1)
    node = trace.add("autograd::engine::evaluate_function: MulBackward0", 2.0, inner, sequence=7)
    adam = trace.add("part: optimiser", 0.5, trace.add("aten::_fused_adam_", 3.5))
    trace.add("a step", 100.0, sampling, losses, node, adam)
    trace.add("a step", 900.0, trace.add("aten::mm", 500.0))  # the noisier half
    found = breakdown.summed(trace.events, 1.0)
    assert dict(found.parts_s) == pytest.approx({
        "networks, matrix products": 40e-6,
        "sampling, rest": 21e-6,  # the forward op, its node, and what the node called
        "optimiser": 4e-6,
        "losses": 1e-6,
        "other": 100e-6,
    })
    assert sum(seconds for _, seconds in found.parts_s) == pytest.approx(found.step_s)
    assert found.all_steps_s == pytest.approx((166e-6, 1400e-6))


def test_labels_are_there_wherever_a_function_was_imported_and_are_taken_away_again() -> None:
    """A function that was renamed would go unseen into another part."""
    from plnerf.ops import cpu_hash  # loaded where a field is first used on a CPU
    from plnerf.train import loop, losses  # the loop, or what it calls, has imported it by its name

    before = losses.loss_terms
    callers = [module for module in breakdown._plnerf_modules() if vars(module).get("loss_terms") is before]
    assert len(callers) > 1, loop
    with breakdown.labelled():
        assert all(module.loss_terms.__wrapped__ is before for module in callers)
    assert all(module.loss_terms is before for module in callers)
    assert "_HashEncode" in breakdown.op_parts(), cpu_hash


# -- rendering


@pytest.mark.slow
def test_renderers_are_compared_with_the_first(built_tiny_scene: Path, tmp_path: Path) -> None:
    run = open_run(train(tiny_config(built_tiny_scene, steps=2), tmp_path / "run", Recorder()))
    whole = render_suite.RENDERERS[0]

    def brighter(*arguments: Any) -> Any:
        view = whole.render(*arguments)
        return dataclasses.replace(view, rgb=view.rgb + 0.1)

    renderers = (whole, render_suite.Renderer("brighter", brighter), dataclasses.replace(whole, name="again"))
    found = render_suite.measure_rendering(run, renderers, views=1, repeats=2)
    assert [one.renderer for one in found] == ["every sample", "brighter", "again"]
    assert all(len(one.raw_s) == 2 and one.seconds_per_megapixel > 0 for one in found)
    assert [one.agreement_db for one in found] == [None, pytest.approx(20.0, abs=1e-3), math.inf]
    assert "brighter" in render_suite.render_table(run, found).markdown()


# -- tables and files


def test_a_table_reads_the_same_on_the_console_and_in_markdown() -> None:
    table = Table("Title [x]", ("what", "a|b"), (("first [bold]", "1.0"), ("second", "–")), ("A note.",))
    console = Console(width=80, record=True, file=open("/dev/null", "w"))  # noqa: SIM115 (the console's)
    console.print(table.for_console())
    text, page = console.export_text(), table.markdown()
    for word in ("Title [x]", "first [bold]", "second", "1.0", "A note."):
        assert word in text
        assert word in page
    assert "| what | a\\|b |\n| --- | ---: |\n" in page
    with pytest.raises(ConfigError, match="2 columns"):
        Table("T", ("a", "b"), (("only one",),))


@given(st.floats(1e-6, 1e9))
def test_figures_keep_three_digits(value: float) -> None:
    assert float(figure(value).replace(",", "")) == pytest.approx(value, rel=5.1e-3)


def test_figures_of_round_numbers() -> None:
    texts = [figure(v) for v in (0.0, None, 0.0123456, 0.5, 1.0, 9.999, 12.345, 123.4, 12345.0, 999.6)]
    assert texts == ["0", "–", "0.0123", "0.5", "1.00", "10.0", "12.3", "123", "12,300", "1,000"]


@pytest.mark.parametrize(
    ("changed", "text"),
    [
        ({"suites": ("ops", "spam")}, "no suite 'spam'"),
        ({"suites": ()}, "one or more of ops, train, render, span"),
        ({"suites": ("ops", "ops")}, "each once"),
        ({"seconds": 0.0}, "--seconds is 0.0"),
        ({"targets_db": (math.nan,)}, "nan"),
    ],
)
def test_what_cannot_be_measured_is_refused(tmp_path: Path, changed: Any, text: str) -> None:
    with pytest.raises(ConfigError, match=text):
        BenchConfig(tmp_path / "out", **changed)


def test_another_bench_is_not_overwritten(tmp_path: Path) -> None:
    (tmp_path / "bench.json").write_text("{}")
    with pytest.raises(ConfigError, match="is there already"):
        BenchConfig(tmp_path)


@pytest.mark.slow
def test_the_whole_bench_writes_its_files(
    built_tiny_scene: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """In this process, where the checks of types are on."""
    monkeypatch.setattr(suites, "in_fresh_process", lambda function, bench: function(bench))
    chosen = small()
    systems = {chosen["preset"]: Settings(chosen["model"], chosen["train"])}
    bench = BenchConfig(tmp_path / "b", scene=built_tiny_scene, systems=systems, seconds=6.0, quick=True)
    console = Console(width=120, record=True)
    path = suites.run_bench(bench, console)
    found = json.loads(path.read_text())
    assert found["format_version"] == 1
    assert found["versions"].keys() == {"plnerf", "python", "torch", "numba", "numpy", "triton"}
    assert {
        "date_utc",
        "device",
        "cpu",
        "cores",
        "torch_threads",
        "numba_threads",
        "seed",
        "backend",
    } <= found.keys()
    assert found["date_utc"].endswith("+00:00")
    assert found["suites"].keys() == {"ops", "train", "render"}
    for case in found["suites"]["ops"]["cases"]:
        ratios = [a / b for a, b in zip(case["times"]["reference_s"], case["times"]["kernel_s"], strict=True)]
        assert case["median_ratio"] == sorted(ratios)[len(ratios) // 2]
    trained = found["suites"]["train"]
    assert len(trained["window_s"]) > 0
    assert trained["peak_bytes"] > 2**26
    parts = dict(trained["breakdown"]["parts_s"])
    assert {
        "hash encoding",
        "networks, matrix products",
        "losses",
        "optimiser",
        "batch",
        "other",
    } <= parts.keys()
    assert parts["other"] < 0.7 * trained["breakdown"]["step_s"]
    assert found["suites"]["render"]["views"][0]["seconds_per_megapixel"] > 0
    page, shown = (path.parent / "bench.md").read_text(), console.export_text()
    for title in ("Ops", "Ceilings", "Training", "Time to a held-out PSNR", "A training step", "Rendering"):
        assert f"## {title}\n" in page
        assert title in shown


@pytest.mark.slow
def test_a_suite_runs_in_a_process_of_its_own_and_its_errors_come_back(tmp_path: Path) -> None:
    bench = BenchConfig(tmp_path / "b", run=tmp_path / "no-run")
    with pytest.raises(ConfigError, match="is not a run folder"):
        suites.in_fresh_process(suites.run_render, bench)
