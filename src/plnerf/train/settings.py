"""Frozen dataclasses of settings to JSON and back, strictly: an unknown key or a wrong type is an error, not a guess."""

import dataclasses
import json
import types
from typing import Any, Literal, TypeVar, Union, get_args, get_origin, get_type_hints

from plnerf.errors import ConfigError

T = TypeVar("T")


def to_json(settings: Any) -> dict[str, Any]:
    """A dataclass as plain JSON values (tuples become lists)."""
    plain: dict[str, Any] = json.loads(json.dumps(dataclasses.asdict(settings)))
    return plain


def from_json(kind: type[T], data: object, where: str) -> T:
    """A dataclass of the given kind from JSON values; keys left out keep their defaults.

    `where` names the file and key in errors.  Raises ConfigError for unknown keys, wrong types and missing values.
    """
    result: T = _convert(kind, data, where)
    return result


def override(settings: T, assignments: tuple[str, ...]) -> T:
    """Settings with `path.to.key=value` assignments applied; a value is JSON, or a bare word.

    Raises ConfigError naming the keys that exist where one is unknown.
    """
    data = to_json(settings)
    for assignment in assignments:
        path, equals, text = assignment.partition("=")
        if not equals:
            raise ConfigError(f"A setting is written path.to.key=value, but got {assignment!r}.")
        *parents, last = path.strip().split(".")
        place = data
        for parent in parents:
            if not isinstance(place.get(parent), dict):
                raise ConfigError(_unknown(path, parent, place))
            place = place[parent]
        if last not in place:
            raise ConfigError(_unknown(path, last, place))
        try:
            place[last] = json.loads(text)
        except json.JSONDecodeError:
            place[last] = text.strip()
    return from_json(type(settings), data, "--set")


def _unknown(path: str, key: str, place: dict[str, Any]) -> str:
    return f"There is no setting {path!r}: {key!r} is unknown there. Known: {', '.join(sorted(place))}."


def _convert(kind: Any, value: Any, where: str) -> Any:
    if dataclasses.is_dataclass(kind):
        return _convert_dataclass(kind, value, where)
    origin, choices = get_origin(kind), get_args(kind)
    if origin is Literal:
        if value in choices:
            return value
        raise ConfigError(f"{where} must be one of {', '.join(map(repr, choices))}, but is {value!r}.")
    if origin in {Union, types.UnionType}:
        if value is None and type(None) in choices:
            return None
        (kind,) = (choice for choice in choices if choice is not type(None))
        return _convert(kind, value, where)
    if origin is tuple:
        return _convert_tuple(choices, value, where)
    if kind is float and isinstance(value, int) and not isinstance(value, bool):
        return float(value)
    if type(value) is not kind:
        raise ConfigError(f"{where} must be of type {kind.__name__}, but is {value!r} ({type(value).__name__}).")
    return value


def _convert_dataclass(kind: Any, value: Any, where: str) -> Any:
    if not isinstance(value, dict):
        raise ConfigError(f"{where} must be a JSON object with the settings of {kind.__name__}, but is {value!r}.")
    fields = {field.name: field for field in dataclasses.fields(kind)}
    unknown = sorted(set(value) - set(fields))
    if unknown:
        raise ConfigError(
            f"{where} has the unknown key {unknown[0]!r}. Known keys there: {', '.join(sorted(fields))}. "
            "Correct or remove it."
        )
    hints = get_type_hints(kind)
    given = {name: _convert(hints[name], item, f"{where}.{name}") for name, item in value.items()}
    for name, field in fields.items():
        absent = field.default is dataclasses.MISSING and field.default_factory is dataclasses.MISSING
        if absent and name not in given:
            raise ConfigError(f"{where} lacks the key {name!r}, which has no default. Add it.")
    return kind(**given)


def _convert_tuple(choices: tuple[Any, ...], value: Any, where: str) -> tuple[Any, ...]:
    if not isinstance(value, list):
        raise ConfigError(f"{where} must be a list, but is {value!r}.")
    kinds = [choices[0]] * len(value) if choices[-1] is Ellipsis else list(choices)
    if len(kinds) != len(value):
        raise ConfigError(f"{where} must have {len(kinds)} items, but has {len(value)}: {value!r}.")
    return tuple(_convert(kind, item, f"{where}[{i}]") for i, (kind, item) in enumerate(zip(kinds, value, strict=True)))
