"""A comparison leaves a table and pages, goes on where it stopped, and outlives a preset that fails."""

import json
import shutil
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PIL import Image
from rich.console import Console
from tests.support.changed import changed

from plnerf.bench.compare import RESULT, CompareConfig, _crop, compare
from plnerf.bench.compare_page import curves_svg
from plnerf.bench.fresh_process import in_fresh_process
from plnerf.errors import ConfigError, PlnerfError
from plnerf.presets._find import find_preset
from plnerf.train.config import Settings

pytestmark = pytest.mark.slow

FEW = (
    "model.field.grid.log2_table=12", "model.field.grid.levels=3", "train.rays=32", "train.normal_rays=0",
    "train.validations=2", "train.detail_share=0",
)  # fmt: skip
QUIET = Console(quiet=True)


def few(preset: str) -> Settings:
    chosen = find_preset(preset)
    return changed(Settings(chosen.model, chosen.train), FEW)


NERF = find_preset("nerf")
WRONG = changed(Settings(NERF.model, NERF.train), ("train.loss.interlevel_blur=[0.1, 0.1, 0.1]",))


@pytest.fixture(scope="module", autouse=True)
def _here_unless_it_fails() -> Iterator[None]:
    """What succeeds is trained in this process, where types are checked: another takes seconds to start."""

    def run(function: Callable[[Any], Any], task: tuple[CompareConfig, str]) -> Any:
        return in_fresh_process(function, task) if task[1] == "nerf" else function(task)

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("plnerf.bench.compare.in_fresh_process", run)
        yield


@pytest.fixture(scope="module")
def compared(built_tiny_scene: Path, tmp_path_factory: pytest.TempPathFactory) -> CompareConfig:
    """Of the three, nerf has a loss that does not fit its rounds of sampling, and fails."""
    out = tmp_path_factory.mktemp("compared")
    systems = {"nerf": WRONG, "nerfacto": few("nerfacto"), "instant-ngp": few("instant-ngp")}
    config = CompareConfig(built_tiny_scene, out, systems, steps=4, backend="torch")
    assert compare(config, QUIET) == out / "compare.json"
    return config


def test_the_table_the_pages_and_the_sheet_are_there(compared: CompareConfig) -> None:
    content = json.loads((compared.out / "compare.json").read_text())
    failed, *done = content["results"]
    assert failed["preset"] == "nerf" and "interlevel_blur" in failed["failed"]
    assert [one["preset"] for one in done] == ["nerfacto", "instant-ngp"]
    for one in done:
        assert one["steps"] == 4 and one["mean"]["psnr_db"] > 0 and one["peak_bytes"] > 1e7
        assert one["model_bytes"] >= 4 * one["parameters"] > 0 and len(one["curve"]) == 2
    assert done[0]["view"] == done[1]["view"] and done[0]["crop"] == done[1]["crop"]
    markdown, page = ((compared.out / name).read_text() for name in ("compare.md", "compare.html"))
    assert all(name in markdown and name in page for name in ("nerfacto", "instant-ngp", "Failed: nerf"))
    assert "data:image/png;base64," in page and "http" not in page.replace("http://www.w3.org/2000/svg", "")
    with Image.open(compared.out / "sheet.png") as sheet:
        assert sheet.width > 3 * 300  # the photo and two systems


def test_what_is_done_is_not_done_again(compared: CompareConfig) -> None:
    before = (compared.out / "nerfacto" / RESULT).stat().st_mtime_ns
    again = replace(compared, systems={name: few(name) for name in ("nerfacto", "instant-ngp")})
    compare(again, QUIET)
    assert (compared.out / "nerfacto" / RESULT).stat().st_mtime_ns == before
    assert len(json.loads((compared.out / "compare.json").read_text())["results"]) == 2


def test_a_preset_that_was_cut_off_before_its_first_checkpoint_goes_on(compared: CompareConfig) -> None:
    folder = compared.out / "nerfacto"
    before = json.loads((folder / RESULT).read_text())
    (folder / RESULT).unlink()
    shutil.rmtree(folder / "checkpoints")
    compare(replace(compared, systems={"nerfacto": few("nerfacto")}), QUIET)
    assert json.loads((folder / RESULT).read_text())["mean"] == before["mean"]


def test_the_crop_is_where_the_wires_are(tmp_path: Path) -> None:
    mask = np.zeros((96, 120), np.uint8)
    mask[70:80, 90:115] = 255
    Image.fromarray(mask).save(tmp_path / "mask.png")
    for h, w in ((96, 120), (48, 60)):
        top, left, height, width = _crop(tmp_path / "mask.png", (h, w))
        assert (height, width) == (h // 3, w // 3)
        assert top <= 70 * h / 96 and top + height >= 80 * h / 96
        assert left <= 90 * w / 120 and left + width >= 115 * w / 120
    assert _crop(None, (90, 60)) == (30, 20, 30, 20)


def test_unequal_budgets_are_not_mixed(compared: CompareConfig) -> None:
    with pytest.raises(ConfigError, match="steps 4 -> 5"):
        compare(replace(compared, steps=5), QUIET)
    other = replace(few("nerfacto"), train=replace(few("nerfacto").train, rays=33))
    with pytest.raises(ConfigError, match="other values: settings of nerfacto"):
        compare(replace(compared, systems={"nerfacto": other}), QUIET)


def test_where_all_fail_the_command_does(tiny_scene: Path, tmp_path: Path) -> None:
    with pytest.raises(PlnerfError, match="Every preset failed"):
        compare(CompareConfig(tiny_scene, tmp_path, {"nerf": WRONG}, steps=2), QUIET)
    assert "Failed: nerf" in (tmp_path / "compare.md").read_text()


def test_wrong_arguments_are_told(tiny_scene: Path, tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match="each once"):
        CompareConfig(tiny_scene, tmp_path, {}, steps=1)
    for budget in ({}, {"steps": 1, "seconds": 1.0}):
        with pytest.raises(ConfigError, match="--steps N or --seconds S"):
            CompareConfig(tiny_scene, tmp_path, {"nerf": WRONG}, **budget)


def test_curves_lie_within_the_picture() -> None:
    svg = curves_svg({"a": [(0.0, 10.0), (5.0, 20.0)], "<b>": [(10.0, 15.0)]})
    assert svg.count("<polyline") == 2 and "&lt;b&gt;" in svg
    points = [part.split('"')[1] for part in svg.split("points=")[1:]]
    for x, y in (pair.split(",") for line in points for pair in line.split()):
        assert 0 <= float(x) <= 760 and 0 <= float(y) <= 360
