"""Frozen dataclasses of settings to JSON and back, strictly: what does not fit is an error, not a guess."""

import dataclasses
import json
import math
import types
from typing import Any, Literal, TypeVar, Union, get_args, get_origin, get_type_hints

from plnerf.errors import ConfigError

T = TypeVar("T")

_WORDS = {bool: "true or false", int: "a whole number", float: "a finite number", str: "a text"}


def to_json(settings: Any) -> dict[str, Any]:
    """A dataclass as plain JSON values (tuples become lists, paths texts)."""
    plain: dict[str, Any] = json.loads(json.dumps(dataclasses.asdict(settings), default=str))
    return plain


def from_json(kind: type[T], data: object, where: str) -> T:
    """A dataclass of the given kind from JSON values; keys left out keep their defaults.

    `where` names the source in errors.  Raises ConfigError for unknown keys, wrong types and missing values.
    """
    try:
        result: T = _convert(kind, data, "")
    except ConfigError as error:
        raise ConfigError(f"{where}: {error}") from error
    return result


def _convert(kind: Any, value: Any, key: str) -> Any:
    if dataclasses.is_dataclass(kind):
        return _convert_dataclass(kind, value, key)
    origin, choices = get_origin(kind), get_args(kind)
    if origin is Literal:
        if value in choices:
            return value
        raise ConfigError(f"{key} must be one of {', '.join(map(repr, choices))}, but is {value!r}.")
    if origin in {Union, types.UnionType}:
        if value is None and type(None) in choices:
            return None
        chosen = _of_kind([choice for choice in choices if choice is not type(None)], value, key)
        return _convert(chosen, value, key)
    if origin is tuple:
        return _convert_tuple(choices, value, key)
    if kind is float and type(value) is int:
        value = float(value)
    if type(value) is not kind or (kind is float and not math.isfinite(value)):
        raise ConfigError(f"{key} must be {_WORDS[kind]}, but is {value!r}.")
    return value


def _of_kind(choices: list[Any], value: Any, key: str) -> Any:
    """The one of several dataclasses whose field `kind` is the value's: the first where it says none."""
    if len(choices) == 1 or not isinstance(value, dict) or "kind" not in value:
        return choices[0]
    kinds = {get_args(get_type_hints(choice)["kind"])[0]: choice for choice in choices}
    if value["kind"] not in kinds:
        raise ConfigError(
            f"{_below(key, 'kind')} must be one of {', '.join(map(repr, kinds))}, but is {value['kind']!r}."
        )
    return kinds[value["kind"]]


def _convert_dataclass(kind: Any, value: Any, key: str) -> Any:
    if not isinstance(value, dict):
        raise ConfigError(
            f"{key or 'the whole'} must be an object with the settings of {kind.__name__}, but is {value!r}."
        )
    fields = {field.name: field for field in dataclasses.fields(kind)}
    unknown = sorted(set(value) - set(fields))
    if unknown:
        raise ConfigError(
            f"{_below(key, unknown[0])} is an unknown key. Known there: {', '.join(sorted(fields))}. "
            "Correct or remove it."
        )
    hints = get_type_hints(kind)
    given = {name: _convert(hints[name], item, _below(key, name)) for name, item in value.items()}
    for name in (name for name, field in fields.items() if not field.init):
        given.pop(name, None)  # a Literal of one value, which was checked
    for name, field in fields.items():
        absent = field.default is dataclasses.MISSING and field.default_factory is dataclasses.MISSING
        if absent and name not in given:
            raise ConfigError(f"{_below(key, name)} is not there and has no default. Add it.")
    return kind(**given)


def _convert_tuple(choices: tuple[Any, ...], value: Any, key: str) -> tuple[Any, ...]:
    if not isinstance(value, list):
        raise ConfigError(f"{key} must be a list, but is {value!r}.")
    kinds = [choices[0]] * len(value) if choices[-1] is Ellipsis else list(choices)
    if len(kinds) != len(value):
        raise ConfigError(f"{key} must have {len(kinds)} items, but has {len(value)}: {value!r}.")
    return tuple(
        _convert(kind, item, _below(key, str(i)))
        for i, (kind, item) in enumerate(zip(kinds, value, strict=True))
    )


def _below(key: str, name: str) -> str:
    """A key's path, as an error shows it: train.loss.colour."""
    return f"{key}.{name}" if key else name
