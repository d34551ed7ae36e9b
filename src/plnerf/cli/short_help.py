"""The help of a command: its own options, and a table of its groups of settings.

`--help-all` lists every setting.  There are up to eight hundred, in thousands of lines between which nobody
finds the options of every day, and they take more than a second to print.
"""

import inspect
import shutil
from collections.abc import Callable, Iterator
from dataclasses import Field, field, fields, is_dataclass, make_dataclass
from typing import Annotated, Any

import tyro
from rich import box
from rich.panel import Panel
from rich.table import Table

from plnerf.cli.options_help import text_of_type
from plnerf.terminal import Terminal

ALL = "--help-all"
HELPS = ("-h", "--help", ALL)
SETTINGS = "settings"
"""Name of the parameter that holds a command's settings, which are options without a prefix."""


def grouped(command: Callable[..., Any]) -> Any:
    """The settings that a command starts from where it takes settings in groups, and None elsewhere."""
    taken = inspect.signature(command).parameters.get(SETTINGS)
    return taken and taken.default


def without_groups(command: Callable[..., Any], settings: Any) -> Callable[..., Any]:
    """Stands for a command in its help: the same options, but of its settings those that are in no group."""
    taken = dict(inspect.signature(command).parameters)
    single = [
        (one.name, one.type, field(default=value, metadata=one.metadata))
        for one, value in _values(settings)
        if not _is_group(value)
    ]
    if single:
        Single = make_dataclass("Single", single)
        kind = Annotated[Single, tyro.conf.arg(name="")]  # type: ignore[valid-type]  # made above
        taken[SETTINGS] = taken[SETTINGS].replace(annotation=kind, default=Single())
    else:
        del taken[SETTINGS]

    def shown(**_: object) -> None: ...

    shown.__doc__ = getattr(command, "func", command).__doc__
    shown.__annotations__ = {name: one.annotation for name, one in taken.items()}
    vars(shown)["__signature__"] = inspect.Signature(list(taken.values()))
    return shown


def print_groups(command: str, settings: Any) -> None:
    """Prints what each group of a command's settings is about, and how many settings it has."""
    table = Table.grid(padding=(0, 2), expand=True)
    table.add_column(no_wrap=True)
    table.add_column(ratio=1)
    table.add_column(justify="right", no_wrap=True)
    for one, value in _values(settings):
        if _is_group(value):
            about, *_ = (one.metadata.get("help") or text_of_type(type(value))).split("\n\n")
            options = sum(1 for _ in _leaves(value))
            table.add_row(f"--{one.name.replace('_', '-')}.*", about, f"{options} options")
    width = max(40, shutil.get_terminal_size().columns)
    title = f"settings; plnerf {command} {ALL} lists them"
    Terminal(width=width, highlight=False).print(
        Panel(table, title=title, title_align="left", box=box.ROUNDED, border_style="dim")
    )


def _values(settings: Any) -> Iterator[tuple[Field[Any], Any]]:
    return ((one, getattr(settings, one.name)) for one in fields(settings))


def _is_group(value: Any) -> bool:
    return (is_dataclass(value) and not isinstance(value, type)) or (
        isinstance(value, tuple) and any(_is_group(one) for one in value)
    )


def _leaves(value: Any) -> Iterator[Any]:
    """The settings of a group and of the groups in it."""
    if not _is_group(value):
        yield value
        return
    for one in value if isinstance(value, tuple) else (inner for _, inner in _values(value)):
        yield from _leaves(one)
