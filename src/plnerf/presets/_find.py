"""Presets by their names."""

from importlib import import_module

from plnerf.errors import ConfigError
from plnerf.presets import preset_names
from plnerf.render.config import SystemConfig
from plnerf.train.config import Preset


def find_preset(name: str) -> Preset[SystemConfig]:
    """The preset of a name.  Raises ConfigError naming the ones there are."""
    if name not in preset_names():
        raise ConfigError(f"There is no preset {name!r}. Presets: {', '.join(preset_names())}.")
    preset: Preset[SystemConfig] = import_module(f"plnerf.presets.{name.replace('-', '_')}").PRESET
    return preset


def presets_by_year() -> tuple[str, ...]:
    """The names of all presets, the oldest method first."""
    return tuple(sorted(preset_names(), key=lambda name: (find_preset(name).year, name)))
