"""Named settings, a file each: a plain value PRESET that says which paper it follows and what it changes.

A preset is a start: single settings are changed with --set path.to.key=value.  A further one is a further
file here; its name is the file's.
"""

from pkgutil import iter_modules


def preset_names() -> tuple[str, ...]:
    """By the alphabet, and without importing any: they bring PyTorch."""
    return tuple(sorted(module.name.replace("_", "-") for module in iter_modules(__path__)))
