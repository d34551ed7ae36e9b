"""Named settings, a file each: a plain value PRESET that says which paper it follows and what it changes.

A preset is a start: single settings are changed with options like --train.rays 256, in Python with
dataclasses.replace.  A further one is a further file here; its name is the file's.
"""

from pkgutil import iter_modules


def preset_names() -> tuple[str, ...]:
    """All names, sorted; no preset is imported."""
    names = (module.name for module in iter_modules(__path__))
    return tuple(sorted(name.replace("_", "-") for name in names if not name.startswith("_")))
