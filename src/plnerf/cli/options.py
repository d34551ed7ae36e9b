"""Options that several commands have, and the settings of the preset that a command line names."""

from collections.abc import Sequence
from itertools import takewhile
from pathlib import Path
from typing import Annotated, Literal

import tyro

from plnerf.presets import preset_names
from plnerf.presets._find import find_preset
from plnerf.train.config import Settings

Out = Annotated[Path, tyro.conf.arg(aliases=["-o"])]
OptionalOut = Annotated[Path | None, tyro.conf.arg(aliases=["-o"])]
Output = Literal["rgb", "depth", "normals", "uncertainty", "accumulation"]
Device = Literal["auto", "cpu", "cuda"]
BackendName = Literal["auto", "torch", "numba", "triton"]


def _presets(default: str) -> str:
    """The default and the choices, which help shows after an option's text."""
    return f"(default: {default or 'all'}; there are {', '.join(preset_names())})"


PresetName = Annotated[str, tyro.conf.arg(help_behavior_hint=_presets)]
PresetNames = Annotated[tuple[str, ...], tyro.conf.arg(help_behavior_hint=_presets)]


AsOptions = Annotated[tyro.conf.AvoidSubcommands[Settings], tyro.conf.arg(name="")]
"""Every setting is an option: --train.rays 512, --model.field.hidden 32."""


def settings_of(preset: str) -> Settings:
    """The settings of a preset.  Raises ConfigError naming the ones there are."""
    chosen = find_preset(preset)
    return Settings(chosen.model, chosen.train)


def settings_from(preset: str, options: str) -> Settings:
    """A preset's settings changed by options as on the command line, such as "--train.rays 256"."""
    return tyro.cli(AsOptions, default=settings_of(preset), args=options.split())


def words_of(option: str, arguments: Sequence[str]) -> tuple[str, ...]:
    """The words that follow an option on a command line that is not parsed yet."""
    for k, word in enumerate(arguments):
        if word.startswith(f"{option}="):
            return (word.removeprefix(f"{option}="),)
        if word == option:
            return tuple(takewhile(lambda word: not word.startswith("-"), arguments[k + 1 :]))
    return ()
