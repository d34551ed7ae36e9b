"""The suite `coverage`: a row for each kind of figure, a test of each share, no scene surveyed twice."""

import csv
from pathlib import Path

import numpy as np
import pytest
from rich.console import Console
from tests.support.catenary_surveys import corridor

from plnerf.bench import coverage_suite
from plnerf.bench.config import BenchConfig
from plnerf.bench.coverage_page import coverage_svg, coverage_table
from plnerf.errors import ConfigError
from plnerf.score.intervals import FIGURE_KINDS, LIMIT, Figure


def figures(kind: str, deviations: np.ndarray) -> list[Figure]:
    return [Figure(kind, "A", 1.0, 1.0 + 0.1 * float(z), 0.1) for z in deviations]  # type: ignore[arg-type]


def test_normal_errors_are_not_rejected_and_intervals_too_narrow_or_too_wide_are() -> None:
    errors = np.random.default_rng(1).normal(size=400)
    some = [*figures("sag", errors), *figures("ground", 3 * errors), *figures("vegetation", errors / 4)]
    table = coverage_table("lidar", 20, some)
    rows = {row[0]: row for row in table.rows}
    assert list(rows) == list(FIGURE_KINDS) and rows["building"][1] == "0"
    assert rows["sag"][1] == "400" and 93 < float(rows["sag"][2].split()[0]) < 97
    assert "*" not in rows["sag"][3] and "*" in rows["ground"][3] and "*" in rows["vegetation"][3]
    assert float(rows["ground"][4]) == pytest.approx(3 * np.abs(errors).max(), rel=0.1)
    assert rows["sag"][5] == "0.1" and float(rows["sag"][6]) == pytest.approx(0.067, abs=0.01)
    assert coverage_svg(some).count("<polyline") == 4


def test_upper_limits_that_all_hold_are_not_rejected_and_have_no_curve() -> None:
    some = figures(LIMIT, np.abs(np.random.default_rng(1).normal(size=400)))
    (row,) = [row for row in coverage_table("images", 20, some).rows if row[0] == LIMIT]
    assert row[1:3] == ("400", "100.0 %") and "*" not in row[3]
    assert coverage_svg(some).count("<polyline") == 1
    low = figures(LIMIT, np.full(400, -3.0))
    assert "*" in next(row for row in coverage_table("images", 20, low).rows if row[0] == LIMIT)[3]


def test_a_scene_that_has_its_figures_is_not_surveyed_again(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    made: list[int] = []

    def survey(seed: int, folder: Path) -> object:
        made.append(seed)
        if seed == 3 and made.count(3) == 1:
            raise KeyboardInterrupt
        return corridor(count=60), folder / "truth.json"

    errors = np.random.default_rng(2).normal(size=20)
    monkeypatch.setattr(coverage_suite, "_of_lidar", survey)
    monkeypatch.setattr(coverage_suite, "figures_of", lambda *_: tuple(figures("sag", errors)))
    bench = BenchConfig(tmp_path / "out", suites=("coverage",), seeds=(1, 3))
    with pytest.raises(KeyboardInterrupt):
        coverage_suite.measure_coverage(bench, Console(quiet=True))
    tables, measured = coverage_suite.measure_coverage(bench, Console(quiet=True))
    assert made == [1, 3, 3]
    assert list(measured["figures"]["lidar"]) == ["lidar-1", "lidar-3"]
    assert tables[0].rows[0][:2] == ("sag", "40")
    with (bench.out / "coverage.csv").open() as file:
        rows = list(csv.DictReader(file))
    assert len(rows) == 40 and {row["scene"] for row in rows} == {"lidar-1", "lidar-3"}
    assert float(rows[0]["error_sigmas"]) == pytest.approx(errors[0], abs=1e-3)
    page = (bench.out / "coverage.md").read_text()
    assert "| sag | 40 |" in page and "(coverage-lidar.svg)" in page
    assert (bench.out / "coverage-lidar.svg").exists()


def test_a_suite_without_scenes_and_scenes_of_one_name_are_refused(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match="--seeds"):
        coverage_suite.measure_coverage(
            BenchConfig(tmp_path, suites=("coverage",), seeds=()), Console(quiet=True)
        )
    with pytest.raises(ConfigError, match="two have one name"):
        BenchConfig(tmp_path, scenes=(tmp_path / "a" / "span", tmp_path / "b" / "span"))
    with pytest.raises(ConfigError, match="0 or more"):
        BenchConfig(tmp_path, seeds=(-1,))
