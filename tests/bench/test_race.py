"""The race's own arithmetic, and how it listens to what it started."""

import importlib.util
import sys
import time
from pathlib import Path
from types import ModuleType

import pytest
from hypothesis import given
from hypothesis import strategies as st
from tests.conftest import ROOT

from plnerf.errors import ConfigError, PlnerfError


def load() -> ModuleType:
    spec = importlib.util.spec_from_file_location("race_cpu", ROOT / "benchmarks" / "race_cpu.py")
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    sys.modules["race_cpu"] = module
    spec.loader.exec_module(module)
    return module


race = load()


def run_of(who: str, rays: int, budget_s: float, rate: float, *points: tuple[float, float]) -> object:
    evaluations = [race.Point(s, 2 * s + 1, round(s), db) for s, db in points]
    return race.Run(who, rays, budget_s, (0.0, 0.0, 0.0), evaluations, rate, 2 * budget_s)


@given(st.lists(st.floats(5, 40), min_size=2, max_size=20), st.floats(6, 39))
def test_the_time_to_a_psnr_lies_between_the_evaluations_around_it(
    heights: list[float], target: float
) -> None:
    run = run_of("x", 1, 1.0, 1.0, *((10.0 * (i + 1), height) for i, height in enumerate(heights)))
    found = run.time_to(target, race.training_s)
    first = next((i for i, height in enumerate(heights) if height >= target), None)
    if first is None:
        assert found is None
    else:
        assert 10 * max(1, first) - 1e-6 <= found <= 10 * (first + 1) + 1e-6
        assert run.time_to(target, race.wall_s) == pytest.approx(2 * found + 1)


def test_a_straight_climb_is_interpolated_exactly() -> None:
    run = run_of("x", 1, 1.0, 1.0, (10.0, 10.0), (20.0, 20.0))
    assert run.time_to(18.5, race.training_s) == pytest.approx(18.5)
    assert run.psnr_after(20.4) == 20.0
    assert run.psnr_after(15.0) is None


def test_the_table_compares_like_with_like(tmp_path: Path) -> None:
    arguments = race.Arguments(tmp_path, tmp_path, tmp_path, tmp_path)
    plan = race.Plan(rounds=2, target_rounds=1)
    runs = [
        run_of("plnerf", 512, 15.0, 3000.0, (1.0, 17.5), (2.0, 19.5), (15.0, 22.0)),
        run_of("nerfacto", 1024, 20.0, 500.0, (20.0, 11.0)),
        run_of("plnerf", 512, 15.0, 8000.0, (1.0, 17.5), (2.0, 19.5), (15.0, 22.0)),
        run_of("nerfacto", 1024, 20.0, 1000.0, (20.0, 11.0)),
        run_of("plnerf", 512, 15.0, 9000.0, (1.0, 17.5), (2.0, 19.5), (15.0, 22.0)),
        run_of("nerfacto", 256, 480.0, 400.0, (150.0, 17.5), (300.0, 19.5)),
        run_of("plnerf", 512, 300.0, 9000.0, (300.0, 24.0)),
        run_of("nerfacto", 1024, 1200.0, 700.0, (300.0, 18.0), (1200.0, 20.0)),
    ]
    rows = {row[0]: row[1:] for row in race.table(arguments, plan, runs).rows}
    assert rows["s of training to 18.5 dB (nerfacto: 256 rays)"] == ("225", "1.50", "150×")
    assert rows["rays/s (nerfacto: 1024 rays)"][2] == "7.00×"  # the median of 6 and 8, each of one pair
    assert rows["PSNR after 300 s of both (nerfacto: 256 rays)"] == ("19.50", "24.00", "+4.50 dB")
    assert rows["PSNR after 300 s of both (nerfacto: 1024 rays)"] == ("18.00", "24.00", "+6.00 dB")
    assert rows["PSNR after 1200 s of nerfacto (1024 rays), 15 s of plnerf"] == ("20.00", "22.00", "+2.00 dB")
    for count in range(len(runs)):  # of a race that is not over yet, too
        race.table(arguments, plan, runs[:count])


def test_slices_alternate_and_fit_into_their_time(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """45 minutes and 3, with 10 s for each start and for each evaluation of the peer."""
    arguments = race.Arguments(tmp_path, tmp_path, tmp_path, tmp_path)
    for plan, most_s in ((race.Plan(), 45 * 60), (race.QUICK, 4 * 60)):
        told: list[tuple[str, float]] = []
        monkeypatch.setattr(race, "run_ours", lambda a, s, c, told=told: told.append(("ours", s + 10)))
        monkeypatch.setattr(
            race, "run_peer",
            lambda a, r, s, every, stop, c, told=told: told.append(("peer", s + 10 + 10 * s / every)),
        )  # fmt: skip
        for count, slice_ in enumerate(race.slices(arguments, plan)):
            slice_(count)
        assert [who for who, _ in told] == ["ours", "peer"] * (len(told) // 2)
        # Runs up to a PSNR end long before their most, unless nothing is learnt.
        assert sum(seconds for _, seconds in told) < most_s + plan.target_rounds * plan.target_most_s


def child(code: str, tmp_path: Path) -> object:
    return race.Child([sys.executable, "-u", "-c", code], tmp_path / "log", {})


def test_lines_come_while_the_process_runs_and_none_is_lost(tmp_path: Path) -> None:
    code = "import time\nfor i in range(3): print('line', i); time.sleep(0.3)\nprint('the end')"
    with child(code, tmp_path) as running:
        came = [(line, time.perf_counter()) for line in running.lines()]
        running.check()
    assert [line for line, _ in came] == ["line 0", "line 1", "line 2", "the end"]
    assert came[2][1] - came[0][1] > 0.3


def test_a_process_that_fails_is_told_and_one_that_is_left_is_ended(tmp_path: Path) -> None:
    failed = pytest.raises(PlnerfError, match=r"(?s)status 3.*because")
    with child("print('because'); raise SystemExit(3)", tmp_path) as failing, failed:
        failing.check()
    begin = time.perf_counter()
    with child("import time; time.sleep(60)", tmp_path) as running:
        assert running.runs()
    assert not running.runs()
    assert time.perf_counter() - begin < 30


def test_what_is_not_there_is_named(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match="which is not there"):
        race.check(race.Arguments(tmp_path, tmp_path, tmp_path, tmp_path / "out"))
