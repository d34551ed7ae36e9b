"""Options that several commands have."""

from pathlib import Path
from typing import Annotated, Literal

import tyro

Out = Annotated[Path, tyro.conf.arg(aliases=["-o"])]
Output = Literal["rgb", "depth", "normals", "accumulation"]


def _presets(default: str) -> str:
    """What help says after the option's text."""
    from plnerf.presets import preset_names

    return f"(default: {default or 'all'}; there are {', '.join(preset_names())})"


PresetName = Annotated[str, tyro.conf.arg(help_behavior_hint=_presets)]
PresetNames = Annotated[tuple[str, ...], tyro.conf.arg(help_behavior_hint=_presets)]
