"""When a run ends that goes on until it is settled: on known curves of held-out PSNR, and in training."""

import json
import math
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import pytest
from tests.support.tiny_run import Recorder, assert_same_bits, newest_tensors, tiny_config

from plnerf.errors import CheckpointError, ConfigError
from plnerf.train.checkpoint import list_checkpoints
from plnerf.train.config import SettleConfig
from plnerf.train.loop import train
from plnerf.train.schedule import HeldOut, Moment, UntilSettled

SMALL_LOOKS = ("train.settle.first=4", "train.settle.gain_db=100")


@dataclass
class Played:
    """What a schedule said after each step."""

    moments: list[Moment] = field(default_factory=list)
    looks: list[int] = field(default_factory=list)

    @property
    def steps(self) -> int:
        return len(self.moments)

    def first_cooling(self) -> int:
        return next(k for k, one in enumerate(self.moments) if one.progress > SettleConfig().hold)


def play(
    seen_after: Callable[[int], HeldOut],
    steps: int = 10**5,
    state: dict[str, Any] | None = None,
    start: int = 0,
) -> Played:
    """A run to its end, one second a step."""
    schedule, played = UntilSettled(tiny_config(Path("/s"), "until=settled", steps=steps), state), Played()
    for step in range(start + 1, steps + 1):
        now = schedule.at(step, float(step))
        played.moments.append(now)
        if now.look:
            played.looks.append(step)
            schedule.heard(step, seen_after(step))
        if now.progress >= 1:
            return played
    raise AssertionError("the run did not end")


def gains_until(end: int) -> Callable[[int], HeldOut]:
    """Held-out pixels that gain 3 dB whenever a run is twice as long, and nothing from some step on."""
    return lambda step: HeldOut(20 + 3 * math.log2(min(step, end)))


@pytest.mark.parametrize("end", [600, 3000, 20000])
def test_rates_wait_while_held_out_pixels_gain_and_fall_after(end: int) -> None:
    played = play(gains_until(end))
    settled = played.first_cooling()
    assert end <= settled <= end * 1.25**3 + 500 * 1.25**2
    assert played.steps == pytest.approx(1.5 * settled, abs=2)
    progress = [one.progress for one in played.moments]
    assert progress == sorted(progress) and progress[-1] == 1.0
    assert set(progress[500:settled]) == {SettleConfig().hold}


def test_the_share_that_is_over_never_goes_back() -> None:
    share = [one.share for one in play(gains_until(3000)).moments]
    assert share == sorted(share) and share[-1] == 1.0


def test_wires_that_gain_keep_a_run_going() -> None:
    whole = play(gains_until(1000))
    wires = play(lambda step: HeldOut(gains_until(1000)(step).psnr_db, gains_until(8000)(step).psnr_db))
    assert whole.first_cooling() < 3000 < 8000 <= wires.first_cooling()


def test_a_single_bad_look_ends_nothing() -> None:
    looks = play(gains_until(20000)).looks

    def dip(step: int) -> HeldOut:
        return HeldOut(gains_until(20000)(step).psnr_db - 5.0 * (step == looks[5]))

    assert play(dip).steps == play(gains_until(20000)).steps


def test_the_budget_is_used_where_the_run_does_not_settle() -> None:
    played = play(gains_until(10**9), steps=6000)
    assert played.first_cooling() == pytest.approx(4000, abs=2) and played.steps == 6000


def test_what_was_kept_goes_on_as_it_was() -> None:
    schedule = UntilSettled(tiny_config(Path("/s"), "until=settled", steps=10**5), None)
    seen, whole = gains_until(1500), play(gains_until(1500))
    stopped = whole.looks[-3]
    for step in range(1, stopped + 1):
        if schedule.at(step, float(step)).look:
            schedule.heard(step, seen(step))
    rest = play(seen, state=schedule.state(), start=stopped)
    assert rest.moments == whole.moments[stopped:]


def test_what_masks_ignore_settles_nothing_and_comes_back_from_json() -> None:
    played = play(lambda step: HeldOut(math.nan, math.nan), steps=6000)
    assert played.steps == 6000
    config = tiny_config(Path("/s"), "until=settled", steps=6000)
    schedule = UntilSettled(config, None)
    schedule.heard(500, HeldOut(math.nan, 25.0))
    state = json.loads(json.dumps(schedule.state(), allow_nan=False))
    assert UntilSettled(config, state).state() == schedule.state()


def test_a_larger_budget_lets_a_run_gain_again() -> None:
    schedule = UntilSettled(tiny_config(Path("/s"), "until=settled", steps=3000), None)
    for step in range(1, 3001):
        if schedule.at(step, float(step)).look:
            schedule.heard(step, gains_until(10**9)(step))
    larger = UntilSettled(tiny_config(Path("/s"), "until=settled", steps=30000), schedule.state())
    assert larger.at(3000, 0.0).progress == SettleConfig().hold


@pytest.mark.parametrize("part", [{"looks": [[1.0]]}, {"settled_at": "soon"}, {"settled_at": -4}])
def test_a_damaged_schedule_is_an_error(part: dict[str, Any]) -> None:
    state = {"looks": [[20.0, None]], "settled_at": 40, "forced": False}
    config = tiny_config(Path("/s"), "until=settled", steps=100)
    assert UntilSettled(config, state).state() == state
    with pytest.raises(CheckpointError, match="how far the run had settled"):
        UntilSettled(config, {**state, **part})
    with pytest.raises(CheckpointError, match="how far the run had settled"):
        UntilSettled(config, {})


@pytest.mark.parametrize("part", [{"first": 0}, {"growth": 1.0}, {"hold": 1.0}, {"hold": 0.0}])
def test_settings_that_mean_nothing_are_refused(part: dict[str, Any]) -> None:
    with pytest.raises(ConfigError, match="that is to settle"):
        SettleConfig(**part)


# -- in training


def test_a_run_ends_once_it_is_settled(built_tiny_scene: Path, tmp_path: Path) -> None:
    """Nothing gains 100 dB: it settles at its third look, and its rates fall for half as many steps."""
    report = Recorder()
    config = tiny_config(built_tiny_scene, "until=settled", *SMALL_LOOKS, steps=400, seed=3)
    train(config, tmp_path, report)
    assert report.done[-1] == 7 + 4 and len(report.held_out_db) == 5  # after 4, 5, 7, 9, and at the end
    again = Recorder()
    train(config, tmp_path, again)
    assert again.told_nothing_left and not again.done


def test_a_run_that_settles_is_resumed_to_the_same_bits(built_tiny_scene: Path, tmp_path: Path) -> None:
    class Stops(Recorder):
        def step(self, step: int, *rest: Any) -> None:
            super().step(step, *rest)
            if step == 8:
                raise KeyboardInterrupt

    config = tiny_config(built_tiny_scene, "until=settled", *SMALL_LOOKS, steps=400, seed=3)
    train(config, tmp_path / "whole", Recorder())
    with pytest.raises(KeyboardInterrupt):
        train(config, tmp_path / "parts", Stops())
    saved = list_checkpoints(tmp_path / "parts" / "checkpoints")
    assert [path.stem for path in saved] == ["step-5", "step-7"]
    train(config, tmp_path / "parts", Recorder())
    assert_same_bits(newest_tensors(tmp_path / "parts"), newest_tensors(tmp_path / "whole"))


def test_a_run_whose_budget_was_spent_goes_on_until_it_settles(
    built_tiny_scene: Path, tmp_path: Path
) -> None:
    train(tiny_config(built_tiny_scene, steps=6, seed=3), tmp_path, Recorder())
    report = Recorder()
    train(tiny_config(built_tiny_scene, "until=settled", *SMALL_LOOKS, steps=400, seed=3), tmp_path, report)
    assert report.done[0] == 7 and report.done[-1] < 40
