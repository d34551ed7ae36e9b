"""The command line.  Each subcommand is one call; whatever is heavy is imported where it is used.

Exit status: 0 on success, 1 on bad input (one paragraph on standard error), 2 on wrong arguments, 3 where the
doctor finds a scene not usable for wires, or a survey no wire, 130 on Ctrl-C.
"""

import os
import sys
import warnings
from collections.abc import Callable, Sequence
from functools import partial
from typing import Any

import tyro
from rich.console import Console

from plnerf.bench.config import SPAN_PRESETS, for_the_span
from plnerf.cli.capture import capture, reconstruct, synth
from plnerf.cli.measure import bench, bench_all, compare, compare_all
from plnerf.cli.options import settings_of, words_of
from plnerf.cli.survey import doctor, score, survey
from plnerf.cli.train import demo, eval, render, train
from plnerf.errors import PlnerfError
from plnerf.presets._find import presets_by_year
from plnerf.train.config import Settings

COMMANDS: tuple[Callable[..., Any], ...] = (
    demo, capture, reconstruct, train, eval, render, synth, survey, score, doctor, bench, compare,
)  # fmt: skip
OF_A_PRESET = (train, bench, compare)
"""Commands whose options are the settings of a preset."""


def parse(arguments: Sequence[str], settings: Settings) -> Any:
    """Runs the subcommand that the arguments name; its options start from the settings."""
    app = tyro.extras.SubcommandApp()
    for command in COMMANDS:
        function = partial(command, settings=settings) if command in OF_A_PRESET else command
        app.command(function, name=command.__name__)
    about = "From photos of a power line to a radiance field and its measures."
    return app.cli(prog="plnerf", description=about, args=arguments)


def parse_and_run(arguments: Sequence[str]) -> None:
    """Runs a command line."""
    match arguments:
        case ["compare", *_]:
            presets = words_of("--presets", arguments) or presets_by_year()
            # The same options on top of the settings of each.
            compare_all({name: parse(arguments, settings_of(name)) for name in dict.fromkeys(presets)})
        case ["bench", *_]:
            own = (words_of("--preset", arguments) or ("pl-nerf",))[0]
            spans = "span" in words_of("--suite", arguments)
            settings = {name: settings_of(name) for name in dict.fromkeys((own, *(SPAN_PRESETS * spans)))}
            if not spans and not words_of("--scene", arguments):
                settings[own] = for_the_span(settings[own])
            bench_all({name: parse(arguments, one) for name, one in settings.items()})
        case ["train", *_]:
            parse(arguments, settings_of((words_of("--preset", arguments) or ("pl-nerf",))[0]))
        case _:
            parse(arguments, settings_of("pl-nerf"))


def main() -> None:
    """Entry point of the `plnerf` command."""
    # PyTorch and Numba bring a pool of OpenMP threads each, whose idle threads spin and starve the
    # other's: where anything else runs, a step took three times as long.  Read when the libraries are
    # loaded.
    os.environ.setdefault("OMP_WAIT_POLICY", "PASSIVE")
    # A thread that waits for the next kernel spins for some 30 us before it sleeps: waking it takes
    # longer.  (GNU's OpenMP; ten times as much is a tenth faster alone, and 2.7 times slower beside others.)
    os.environ.setdefault("GOMP_SPINCOUNT", "2000")
    console = Console(stderr=True, emoji=False)  # a path may read :x:

    def fail(title: str, text: str) -> None:
        console.print(f"[bold red]{title}[/]: ", end="")
        console.print(text, markup=False, highlight=False, soft_wrap=True)

    def note(message: Warning | str, *_: object, **__: object) -> None:
        console.print(f"note: {message}", markup=False, highlight=False, soft_wrap=True)

    try:
        with warnings.catch_warnings():
            warnings.simplefilter("once", UserWarning)
            warnings.showwarning = note
            parse_and_run(sys.argv[1:])
    except PlnerfError as error:
        fail(type(error).__name__, str(error))
        sys.exit(1)
    except OSError as error:
        fail("OSError", f"{error}. Check that the folder exists, is writable and has space left.")
        sys.exit(1)
    except KeyboardInterrupt:
        console.print("Interrupted. A training run goes on with --resume.")
        sys.exit(130)


if __name__ == "__main__":
    main()
