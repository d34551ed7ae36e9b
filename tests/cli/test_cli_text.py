"""What `--help` says, and how fast: the texts are stored, 100 wide, in tests/snapshots/cli_help_*.txt."""

import os
import re
import subprocess
import sys
from collections.abc import Callable
from functools import cache

import pytest
from tests.conftest import ROOT

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


def help_of(command: str) -> tuple[str, float]:
    """The text, and the processor time it took in seconds: the wall clock would measure the neighbours."""
    arguments = [sys.executable, "-m", "plnerf.cli.main", *command.split(), "--help"]
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


@pytest.mark.parametrize("command", COMMANDS)
def test_text(command: str, snapshot: Callable[[str, str], None]) -> None:
    text = text_of(command)
    usage, *lines = text.splitlines()
    assert usage.startswith("usage: ")  # one line, however many commands or options there are
    assert all(len(line) <= 100 for line in lines)
    # Nested settings follow in groups of their own, with their classes' texts.
    own = re.split(r"^╭─ (?:model|train|poses|detect|points)\b", text, maxsplit=1, flags=re.MULTILINE)[0]
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


def test_every_option_says_what_it_is_and_its_default() -> None:
    for command in COMMANDS[1:]:
        words = plain(text_of(command))
        options = set(re.findall(r"(?<=\s)--[a-z-]+", words.split("options", 1)[1])) - {"--help"}
        assert words.count("(default:") + words.count("(required)") + words.count("(repeatable)") >= len({
            option.replace("--no-", "--") for option in options
        })


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
