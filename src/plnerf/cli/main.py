"""The command line.  Each subcommand is one call; whatever is heavy is imported where it is used.

Exit status: 0 on success, 1 on bad input (one paragraph on standard error), 2 on wrong arguments, 3 where the
doctor finds a scene not usable for wires, a survey no wire, or a comparison of surveys a change, 70 on a
defect of plnerf (one paragraph that names a crash report), 130 on Ctrl-C, 141 where nobody reads its output
any more, 143 on SIGTERM.
"""

import gc
import os
import re
import sys
import time
import warnings
from collections.abc import Callable, Sequence
from functools import partial
from importlib import import_module
from textwrap import shorten
from typing import Any

import tyro

from plnerf.cli.options import settings_of, words_of
from plnerf.cli.options_help import describe_settings
from plnerf.cli.short_help import ALL, HELPS, grouped, print_groups, without_groups
from plnerf.cli.stop import Terminated, stoppable, unread
from plnerf.cli.torchrun import BEFORE_OTHERS_S, joined, rank_of_process, require_shared
from plnerf.errors import PlnerfError, advice_on
from plnerf.presets._find import presets_by_year
from plnerf.terminal import Terminal, one_line
from plnerf.train.config import Settings

COMMANDS = {
    "demo": "train", "capture": "capture", "reconstruct": "capture", "corridor": "corridor",
    "train": "train", "eval": "train", "render": "train", "synth": "capture", "hang": "hang",
    "survey": "survey", "export": "export", "change": "change", "view": "view", "score": "survey",
    "doctor": "survey", "bench": "measure", "compare": "measure",
}  # fmt: skip
"""Each subcommand's file of `cli/`, imported where the subcommand is parsed."""
ABOUT = "From photos of a power line to a radiance field and its measures."
DEFECT = 70
"""Exit status: EX_SOFTWARE of sysexits.h."""
NO_MEMORY = re.compile(
    r"can't allocate memory|can't start new thread|failed to map segment from shared object$"
    r"|Cannot allocate memory"
)
LESS_MEMORY = (
    "Close other programs, raise the limit (ulimit -v), or ask for less: smaller images, fewer rays, a part "
    "of the cloud."
)
GOES_ON = {"train": "The run goes on with --resume."} | dict.fromkeys(
    ("capture", "reconstruct", "corridor", "compare"), "The same command goes on from what is done."
)
"""What a user can do about a command that was interrupted."""
OF_A_PRESET = ("train", "bench", "compare")
"""Commands whose options are the settings of a preset."""


def starts(arguments: Sequence[str]) -> dict[str, Settings]:
    """The presets that a command line is about, with the settings that its options start from."""
    match arguments:
        case ["compare", *_]:
            names = words_of("--presets", arguments) or presets_by_year()
        case ["bench", *_]:
            from plnerf.bench.config import SPAN_PRESETS, for_the_span

            names = words_of("--preset", arguments)[:1] or ("pl-nerf",)
            if "span" in words_of("--suite", arguments):
                names += SPAN_PRESETS
            elif not words_of("--scene", arguments):
                return {names[0]: for_the_span(settings_of(names[0]))}
        case ["train", *_]:
            names = words_of("--preset", arguments)[:1] or ("pl-nerf",)
        case _:
            names = ("pl-nerf",)
    return {name: settings_of(name) for name in names}


def app_from(settings: Settings) -> tyro.extras.SubcommandApp:
    """All subcommands; options of a preset's commands start from these settings."""
    app = tyro.extras.SubcommandApp()
    for name in COMMANDS:
        app.command(name=name)(function_of(name, settings))
    return app


def function_of(name: str, settings: Settings) -> Callable[..., Any]:
    """The function that is a subcommand; a preset's command starts from these settings."""
    function: Callable[..., Any] = getattr(import_module(f"plnerf.cli.{COMMANDS[name]}"), name)
    return partial(function, settings=settings) if name in OF_A_PRESET else function


def print_help(name: str, of_all: bool, settings: Settings) -> None:
    """Prints a subcommand's help, with all its settings or those in no group, and ends the process."""
    function = function_of(name, settings)
    describe_settings()
    groups = None if of_all else grouped(function)
    app = tyro.extras.SubcommandApp()
    app.command(name=name)(function if groups is None else without_groups(function, groups))
    try:
        app.cli(prog="plnerf", args=(name, "--help"))
    except SystemExit:
        if groups is not None:
            print_groups(name, groups)
        raise


def lack_of_memory(error: Exception) -> str | None:
    """The message of an exception about memory that ran out, or of its cause; None where it is another one.

    NumPy and Python raise MemoryError; PyTorch, threads and the loader of libraries say it in words.
    """
    from plnerf.cli.crash import causes  # almost never needed

    for one in causes(error):
        of_gpu = type(one).__name__ == "OutOfMemoryError"
        if isinstance(one, MemoryError) or of_gpu or NO_MEMORY.search(str(one)):
            return shorten(str(one), 300) or "an allocation failed"
    return None


def about_defect(error: Exception, arguments: Sequence[str]) -> str:
    """What to print of an exception that nobody expected; writes its crash report."""
    from plnerf.cli.crash import write_crash_report  # almost never needed

    try:
        where = f"{write_crash_report(error, arguments)} (no photos, no positions, no values of options)"
        do = f"Please report it to the maintainers, with the file {where} and a line on what the input was."
    except (OSError, MemoryError) as why:
        do = f"Please report it to the maintainers. No crash report could be written ({why})."
    message = shorten(str(error), 300) or "no message"
    return f"plnerf met an error that it should have handled: {type(error).__name__}, {message}. {do}"


def main() -> None:
    """Entry point of the `plnerf` command."""
    # PyTorch brings a pool of OpenMP threads, whose idle threads spin and starve the kernels' threads
    # (`ops/threads.py`) and whatever else runs: a step took three times as long.  Read when the library is
    # loaded.
    os.environ.setdefault("OMP_WAIT_POLICY", "PASSIVE")
    # A thread that waits for the next kernel spins for some 30 us before it sleeps: waking it takes
    # longer.  (GNU's OpenMP; ten times as much is a tenth faster alone, and 2.7 times slower beside others.)
    os.environ.setdefault("GOMP_SPINCOUNT", "2000")
    # NumPy's equations have some hundred unknowns, for which its threads only wait for each other, in a busy
    # loop: a survey takes 4 % longer with them, and beside other programs one inverse up to 70 times.
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    console = Terminal(stderr=True, emoji=False)  # a path may read :x:
    arguments, results, rank = sys.argv[1:], {}, rank_of_process()

    def fail(title: str, text: str) -> None:
        if rank and not joined():
            time.sleep(BEFORE_OTHERS_S)  # rank 0 prints the same
            return
        title = f"{title} (rank {rank})" if rank else title
        console.print(f"[bold red]{title}[/]: ", end="")
        console.print(one_line(text), markup=False, highlight=False, soft_wrap=True)

    def note(message: Warning | str, *_: object, **__: object) -> None:
        if rank == 0:
            console.print(f"note: {one_line(str(message))}", markup=False, highlight=False, soft_wrap=True)

    try:
        with stoppable(), warnings.catch_warnings():
            require_shared(arguments)
            warnings.simplefilter("once", UserWarning)
            warnings.showwarning = note
            helps = not set(HELPS).isdisjoint(arguments)
            if helps:
                gc.disable()  # a help is some hundred thousand small objects, then the process ends
            for preset, settings in starts(arguments).items():  # the same options on top of each
                if helps and arguments[0] in COMMANDS:
                    print_help(arguments[0], ALL in arguments, settings)
                app, words = app_from(settings), ["--help" if one == ALL else one for one in arguments]
                results[preset] = app.cli(prog="plnerf", description=ABOUT, args=words)
            from plnerf.cli.measure import Measuring, measure

            if isinstance(next(iter(results.values())), Measuring):
                measure(results)
    except PlnerfError as error:
        fail(type(error).__name__, str(error))
        sys.exit(1)
    except KeyboardInterrupt as stop:
        ended, status = ("Terminated", 143) if isinstance(stop, Terminated) else ("Interrupted", 130)
        if rank == 0:
            console.print(f"{ended}. {GOES_ON.get(next(iter(arguments), ''), '')}".strip())
        sys.exit(status)
    except Exception as error:
        if (what := lack_of_memory(error)) is not None:
            fail("Out of memory", f"{what}. {LESS_MEMORY}")
            sys.exit(1)
        if isinstance(error, OSError):
            if unread(error):
                sys.exit(141)
            fail("OSError", f"{error}. {advice_on(error)}")
            sys.exit(1)
        fail("Defect", about_defect(error, sys.argv[1:]))
        sys.exit(DEFECT)
    finally:
        gc.enable()


if __name__ == "__main__":
    main()
