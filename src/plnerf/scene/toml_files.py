"""TOML files of the user's, or of the package by their names, with errors that name file and key."""

import math
import sys
import tomllib
from collections.abc import Collection, Mapping
from importlib.resources import files
from importlib.resources.abc import Traversable
from pathlib import Path
from typing import Any

from plnerf.errors import ConfigError


def read_toml(path: Path, folder: str | None, what: str) -> dict[str, Any]:
    """A TOML file's values.

    path: where nothing is there, the name of a file in the package's `data/<folder>`, with or without its
    suffix; folder: None: the package has none of its kind.  what: such as "conductor", for errors.  Raises
    ConfigError where it is missing or no TOML.
    """
    if folder is None and not path.is_file():
        raise ConfigError(f"There is no {what} {path}. Give the path of a TOML file.")
    own = files("plnerf") / "data" / (folder or "")
    place = path
    if not path.is_file() and len(path.parts) == 1:
        place = Path(str(own / f"{path.name.removesuffix('.toml').lower()}.toml"))
    if not place.is_file():
        known = ", ".join(sorted(one.name.removesuffix(".toml") for one in own.iterdir()))
        raise ConfigError(
            f"There is no {what} file {path}. Give the path of a TOML file, or one of the package: {known}."
        )
    try:
        return toml_of(place)
    except OSError as error:
        raise ConfigError(f"The {what} file {path} cannot be read ({error.strerror or error}).") from error
    except ValueError as error:  # of TOML, or of the encoding
        raise ConfigError(f"{path} is not valid TOML ({error}).") from error


def toml_of(path: Path | Traversable) -> dict[str, Any]:
    """A TOML file's values.  Raises OSError where it cannot be read, ValueError where it is no TOML."""
    try:
        return tomllib.loads(path.read_text(encoding="utf-8"))
    except RecursionError:
        raise ValueError("its values lie too deeply within each other") from None


def _is_number(value: Any) -> bool:
    """A finite one, also as a float: a whole number may have any length."""
    return (
        isinstance(value, int | float)
        and not isinstance(value, bool)
        and abs(value) <= sys.float_info.max  # not of NaN
    )


class Fields:
    """The values of one table of a file, taken out by name and checked; what is left over is an error."""

    def __init__(self, values: Mapping[str, Any], where: str) -> None:
        self._left, self._where = dict(values), where

    def text(self, name: str, default: str | None = None) -> str:
        """A text that is not empty."""
        value = self._left.pop(name, default)
        if not isinstance(value, str) or not value.strip():
            raise self._wrong(name, "a text", value)
        return value

    def number(
        self, name: str, default: float | None = None, *, least: float = -math.inf, most: float = math.inf,
        above: float = -math.inf,
    ) -> float:  # fmt: skip
        """A finite number within bounds."""
        value = self._left.pop(name, default)
        if value is None or not _is_number(value) or not max(least, above) <= value <= most or value == above:
            bounds = [
                *[f"greater than {above:g}"] * math.isfinite(above),
                *[f"at least {least:g}"] * math.isfinite(least), *[f"at most {most:g}"] * math.isfinite(most),
            ]  # fmt: skip
            raise self._wrong(name, " and ".join(["a number", *bounds]).replace(" and ", " ", 1), value)
        return float(value)

    def flag(self, name: str, default: bool) -> bool:
        """True or false."""
        value = self._left.pop(name, default)
        if not isinstance(value, bool):
            raise self._wrong(name, "true or false", value)
        return value

    def one_of(self, name: str, choices: Collection[str], default: str | None = None) -> str:
        """One of some words."""
        value = self._left.pop(name, default)
        if value not in choices:
            raise self._wrong(name, f"one of {', '.join(choices)}", value)
        return str(value)

    def tables(self, name: str) -> list[dict[str, Any]]:
        """The tables of an array, such as [[state]]; at least one."""
        value = self._left.pop(name, None)
        if not isinstance(value, list) or not value or not all(isinstance(one, dict) for one in value):
            raise self._wrong(name, f"tables [[{name}]]", value)
        return value

    def table(self, name: str) -> dict[str, Any] | None:
        """A table, such as [thermal]; None where there is none."""
        value = self._left.pop(name, None)
        if value is not None and not isinstance(value, dict):
            raise self._wrong(name, f"a table [{name}]", value)
        return value

    def numbers(self, name: str) -> tuple[int, ...]:
        """Whole numbers; none where it is not there."""
        value = self._left.pop(name, [])
        if not isinstance(value, list) or not all(type(one) is int for one in value):
            raise self._wrong(name, "whole numbers in brackets", value)
        return tuple(value)

    def floats(self, name: str) -> tuple[float, ...]:
        """Finite numbers; none where it is not there."""
        value = self._left.pop(name, [])
        if not isinstance(value, list) or not all(_is_number(one) for one in value):
            raise self._wrong(name, "numbers in brackets", value)
        return tuple(float(one) for one in value)

    def numbers_or(self, name: str, word: str) -> tuple[float | None, ...]:
        """A number, or several in brackets; `word` in place of one is None."""
        value = self._left.pop(name, None)
        some = value if isinstance(value, list) else [value]
        if not some or not all(_is_number(one) or one == word for one in some):
            raise self._wrong(name, f"a number, or several in brackets ({word!r} in place of one)", value)
        return tuple(None if one == word else float(one) for one in some)

    def texts(self, name: str) -> tuple[str, ...]:
        """Texts; none where it is not there."""
        value = self._left.pop(name, [])
        if not isinstance(value, list) or not all(isinstance(one, str) for one in value):
            raise self._wrong(name, "texts in brackets", value)
        return tuple(value)

    def has(self, name: str) -> bool:
        """Whether it is given."""
        return name in self._left

    def done(self) -> None:
        """Raises ConfigError where something is left over, which nobody would have read."""
        if self._left:
            raise ConfigError(
                f"{self._where} has {', '.join(self._left)}, which is not known there. Check the spelling."
            )

    def _wrong(self, name: str, expected: str, value: Any) -> ConfigError:
        came = "it is missing" if value is None else f"got {str(value)[:60]!r}"
        return ConfigError(f"{self._where} needs {name}, {expected}: {came}.")
