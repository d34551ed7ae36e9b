"""What `--help` says, and how fast: the texts are stored, 100 wide, in tests/snapshots/cli_help_*.txt."""

import os
import re
import subprocess
import sys
from collections import Counter
from collections.abc import Callable
from functools import cache

import pytest
from tests.conftest import ROOT

from plnerf.cli.options import settings_of
from plnerf.presets import preset_names

COMMANDS = (
    "",
    "demo",
    "capture",
    "reconstruct",
    "corridor",
    "train",
    "eval",
    "render",
    "synth",
    "hang",
    "survey",
    "export",
    "change",
    "view",
    "score",
    "doctor",
    "bench",
    "compare",
)
HEAVY = (
    "torch",
    "numba",
    "cv2",
    "numpy",
    "scipy",
    "mitsuba",
    "pycolmap",
    "skimage",
    "tensorboard",
    "imageio",
    "viser",
)
ENVIRONMENT = {**os.environ, "COLUMNS": "100", "NO_COLOR": "1", "PYTHONIOENCODING": "utf-8"}


def help_of(command: str, asked: str = "--help") -> tuple[str, float]:
    """The text, and the processor time it took in seconds: the wall clock would measure the neighbours."""
    arguments = [sys.executable, "-m", "plnerf.cli.main", *command.split(), asked]
    process = subprocess.Popen(arguments, env=ENVIRONMENT, text=True, stdout=subprocess.PIPE)
    assert process.stdout is not None
    text = process.stdout.read()
    _, status, usage = os.wait4(process.pid, 0)
    process.returncode = os.waitstatus_to_exitcode(status)
    assert process.returncode == 0
    return text, usage.ru_utime + usage.ru_stime


@cache
def first_help_of(command: str) -> tuple[str, float]:
    return help_of(command)


def text_of(command: str) -> str:
    return first_help_of(command)[0]


@cache
def text_of_all(command: str) -> str:
    return help_of(command, "--help-all")[0]


@pytest.mark.parametrize("command", COMMANDS)
def test_text(command: str, snapshot: Callable[[str, str], None]) -> None:
    text = text_of(command)
    usage, *lines = text.splitlines()
    assert usage.startswith("usage: ")  # one line, however many commands or options there are
    assert all(len(line) <= 100 for line in lines)
    # A table of the settings follows, whose numbers change with every setting.
    own = re.split(r"^╭─ settings", text, maxsplit=1, flags=re.MULTILINE)[0]
    snapshot(f"cli_help_{command or 'all'}", "\n".join(line.rstrip() for line in own.strip().splitlines()))


@pytest.mark.skipif(not hasattr(os, "wait4"), reason="needs a system that tells a process's time")
@pytest.mark.parametrize("command", COMMANDS)
def test_answers_within_a_second(command: str) -> None:
    """Beside other programs a process takes up to twice its time: the least disturbed one of five counts."""
    times = [first_help_of(command)[1]]
    while min(times) >= 1.0 and len(times) < 5:
        times.append(help_of(command)[1])
    assert min(times) < 1.0, times


def test_imports_nothing_heavy() -> None:
    code = (
        "import sys\nfrom plnerf.cli.main import main\n"
        f"for command in {COMMANDS}:\n"
        "    sys.argv = ['plnerf', *command.split(), '--help']\n"
        "    try:\n        main()\n    except SystemExit:\n        pass\n"
        f"print('loaded:', [name for name in {HEAVY} if name in sys.modules])"
    )
    command = [sys.executable, "-c", code]
    done = subprocess.run(command, env=ENVIRONMENT, text=True, capture_output=True, check=True)
    assert done.stdout.endswith("loaded: []\n")


@pytest.mark.parametrize("command", COMMANDS[1:])
def test_every_option_says_what_it_is_and_its_default(command: str) -> None:
    for text in {text_of(command), text_of_all(command)}:
        words = plain(re.split(r"^╭─ settings", text, flags=re.MULTILINE)[0])
        options = set(re.findall(r"(?<=\s)--[a-z.0-9-]+", words.split("options", 1)[1]))
        options -= {"--help", "--help-all"}
        assert words.count("(default:") + words.count("(required)") + words.count("(repeatable)") >= len({
            re.sub(r"(^--|\.)no-", r"\1", option) for option in options
        })


def test_the_help_counts_the_settings_that_all_of_it_lists() -> None:
    """For the groups of nearly eight hundred: not one of them is among the options above the table."""
    own, table = re.split(r"^╭─ settings", text_of("survey"), maxsplit=1, flags=re.MULTILINE)
    assert "plnerf survey --help-all lists them" in table.splitlines()[0]
    listed = re.findall(r"^│ --([a-z-]+)\.", text_of_all("survey"), re.MULTILINE)
    counted = re.findall(r"^│ --([a-z-]+)\.\* .* (\d+) options │$", table, re.MULTILINE)
    assert {name: int(options) for name, options in counted} == Counter(listed) and len(listed) > 700
    assert not re.search(r"^│ --[a-z-]+\.", own, re.MULTILINE) and "--use-classes" in own


def test_all_of_the_help_shows_the_values_of_a_preset() -> None:
    def rays(preset: str) -> str:
        text = plain(help_of(f"train --preset {preset}", "--help-all")[0])
        found = re.search(r"--train\.rays INT .*?\(default: (\d+)\)", text)
        assert found is not None
        return found[1]

    for preset in ("nerf", "pl-nerf"):
        assert int(rays(preset)) == settings_of(preset).train.rays


def test_commands_without_groups_have_one_help() -> None:
    assert text_of_all("eval") == text_of("eval") and "settings" not in text_of("eval")
    assert "--splats." in text_of("export")


def test_presets_in_the_help_are_those_there_are() -> None:
    for command in ("train", "bench", "compare"):
        named = re.search(r"\(default: (?:pl-nerf|all); there are ([\w, -]+)\)", plain(text_of(command)))
        assert named is not None, command
        assert tuple(named[1].split(", ")) == preset_names()


def test_the_readme_uses_commands_and_options_that_exist() -> None:
    readme = (ROOT / "README.md").read_text(encoding="utf-8")
    blocks = re.findall(r"```bash\n(.*?)```", readme, re.DOTALL)
    commands = re.findall(r"\bplnerf ([a-z]+)((?: [^\n#&]+)?)", "\n".join(blocks))
    assert {name for name, _ in commands} == set(COMMANDS[1:])
    for name, arguments in commands:
        for option in re.findall(r"(?<=\s)--?[a-z-]+", arguments):
            assert re.search(rf"(?<=\s){option}\b", plain(text_of(name))), f"plnerf {name} has no {option}"
        for preset in re.findall(r"--preset (\S+)", arguments):
            assert preset in preset_names()


def plain(text: str) -> str:
    """A help text without its frames and line breaks."""
    return re.sub(r"[\s│╭╮╰╯─]+", " ", text)
