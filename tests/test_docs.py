"""What pages show can be run and found: commands, options, functions, pictures, figures of formulas."""

import math
import re
import runpy
import tomllib
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch
from tests.conftest import ROOT, SNAPSHOTS

import plnerf
from plnerf.cli.options import settings_of
from plnerf.doctor.observability import observe_wire
from plnerf.presets import preset_names
from plnerf.scene.cameras import Cameras
from plnerf.survey.config import SurveyConfig

PAGES = sorted([
    *(ROOT / "docs").rglob("*.md"), *(ROOT / name for name in ("README.md", "CONTRIBUTING.md", "SECURITY.md"))
])  # fmt: skip
TUTORIAL = runpy.run_path(str(ROOT / ".ci" / "tutorial.py"))
LARGEST_KB, ALL_KB = 80, 600


def commands_of(page: Path) -> list[str]:
    """Every `plnerf ...` of a page's shell blocks and of its inline code."""
    text = page.read_text(encoding="utf-8").replace("\\\n", " ")
    blocks = "\n".join(re.findall(r"^```(?:bash|shell|sh)[^\n]*\n(.*?)^```", text, re.MULTILINE | re.DOTALL))
    shown = [line.split("#")[0].split("&& ")[-1].strip() for line in blocks.splitlines()]
    shown += re.findall(r"`(plnerf [a-z][^`]*)`", re.sub(r"^```.*?^```", "", text, flags=re.M | re.S))
    return [line for line in shown if line.startswith("plnerf ")]


def is_setting(command: str, option: str) -> bool:
    """Whether an option is a field of the settings that a command takes; stored helps leave these out."""
    if command not in {"survey", "train", "compare", "bench"}:
        return False
    presets = [settings_of(one) for one in preset_names()]
    owners: list[Any] = [SurveyConfig()] if command == "survey" else presets

    def has(owner: Any, parts: list[str]) -> bool:
        if not parts:
            return True
        name = parts[0].removeprefix("no_")
        if isinstance(owner, tuple):
            return name.isdigit() and int(name) < len(owner) and has(owner[int(name)], parts[1:])
        return hasattr(owner, name) and has(getattr(owner, name), parts[1:])

    return any(has(owner, option.removeprefix("--").replace("-", "_").split(".")) for owner in owners)


def test_commands_of_all_pages_have_the_options_that_they_are_shown_with() -> None:
    count = 0
    for page in PAGES:
        for line in commands_of(page):
            command, *words = line.split()[1:]
            if command.startswith("-"):
                continue
            stored = SNAPSHOTS / f"cli_help_{command}.txt"
            assert stored.is_file(), f"{page.name}: there is no command {command} ({line})"
            known = {"--help-all", *re.findall(r"--[\w.-]+", stored.read_text(encoding="utf-8"))}
            for word in words:
                if re.match(r"--[a-z]", word):
                    count += 1
                    option = word.rstrip(".,;:)…")
                    assert option in known or is_setting(command, option), f"{page.name}: {word} in {line}"
    assert count > 80


def test_functions_named_beside_the_method_are_in_the_files_that_they_link_to() -> None:
    named = 0
    for name in ("method.md", "filming.md", "conventions.md"):
        page = ROOT / "docs" / name
        for what, link in re.findall(r"\[`(\w+)`\]\(([^)]+\.py)\)", page.read_text(encoding="utf-8")):
            code = (page.parent / link).resolve().read_text(encoding="utf-8")
            assert re.search(rf"^ *(def|class) {what}\b", code, re.MULTILINE), f"{name}: {what} in {link}"
            named += 1
    assert named >= 40


def test_the_tutorial_runs_every_stage_and_shows_a_small_picture_of_it() -> None:
    commands = [line for line in TUTORIAL["commands"]() if line.startswith("plnerf ")]
    assert [line.split()[1] for line in commands] == [
        "synth", "doctor", "capture", "doctor", "train", "eval", "render", "survey", "view", "export", "score"
    ]  # fmt: skip
    page = (ROOT / "docs" / "tutorial.md").read_text(encoding="utf-8")
    steps = re.split(r"^## \d+\. ", page, flags=re.MULTILINE)[1:]
    pictures = [re.findall(r"!\[[^\]]+\]\(([^)]+)\)", step) for step in steps]
    assert len(steps) == 11 and all(pictures), [step.splitlines()[0] for step in steps]
    sizes = [(ROOT / "docs" / one).stat().st_size for of_step in pictures for one in of_step]
    assert max(sizes) < 1000 * LARGEST_KB and sum(sizes) < 1000 * ALL_KB


def test_the_quick_form_sets_every_variable_that_the_tutorial_takes() -> None:
    (quick,) = TUTORIAL["blocks"]("sh", "quick")
    taken = set(re.findall(r"\$([A-Z]+)", "\n".join(TUTORIAL["commands"]())))
    assert taken == set(re.findall(r"\b([A-Z]+)=", quick)) == set(re.findall(r"\{([A-Z]+):=", "".join(
        TUTORIAL["blocks"]("bash"))))  # fmt: skip
    script = TUTORIAL["script"](True)
    assert script.index("export VIEWS") < script.index("plnerf synth")


@pytest.mark.parametrize(("angle_deg", "views"), [(2, 6), (10, 12), (40, 24)])
def test_the_page_on_filming_states_what_the_doctor_computes(angle_deg: float, views: int) -> None:
    page = (ROOT / "docs" / "filming.md").read_text(encoding="utf-8")
    row = re.search(rf"^\| {angle_deg}° \|(.*)\|$", page, re.MULTILINE)
    assert row is not None
    stated = float(row[1].split("|")[{6: 0, 12: 1, 24: 2}[views]].split()[0])
    around = np.radians(np.repeat([-angle_deg / 2, angle_deg / 2], views // 2))
    distance, focal = 10.0, 2000.0
    forward = np.stack([np.zeros(views), -np.cos(around), -np.sin(around)], 1)
    right = np.tile([1.0, 0.0, 0.0], (views, 1))
    rotation = np.stack([right, np.cross(forward, right), forward], 2)
    cameras = Cameras(
        torch.from_numpy(rotation), torch.from_numpy(-distance * forward),
        torch.full((views, 2), focal), torch.full((views, 2), 500.0), torch.zeros(views, 5),
        torch.full((views, 2), 1000),
    )  # fmt: skip
    found = observe_wire(cameras, np.zeros((1, 3)), np.array([[1.0, 0.0, 0.0]]), sigma_px=0.5)
    assert found.views[0] == views
    in_px = float(found.worst[0]) * focal / distance
    assert math.isclose(in_px, 0.5 / (math.sqrt(views) * math.sin(math.radians(angle_deg) / 2)), rel_tol=1e-3)
    assert abs(in_px - stated) <= 0.051


def test_versions_agree() -> None:
    version = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]["version"]
    assert f"\nversion: {version}\n" in (ROOT / "CITATION.cff").read_text(encoding="utf-8")
    assert f" {version}\n" in (ROOT / "CHANGELOG.md").read_text(encoding="utf-8")
    assert (ROOT / ".github/workflows/ci.yml").read_text().count("run: bash .ci/run") == 1


def test_every_name_of_the_library_is_on_the_page_of_names() -> None:
    page = (ROOT / "docs" / "api.md").read_text(encoding="utf-8")
    listed = set(re.findall(r"^::: ([\w.]+)$", page, re.MULTILINE))
    assert listed == {f"{module}.{name}" for name, module in plnerf._MODULES.items()}
