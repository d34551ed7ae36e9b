"""JSON values to frozen dataclasses, strictly: what does not fit is an error, not a guess."""

import dataclasses
import math
import types
from collections.abc import Mapping, Sequence
from typing import Any, Literal, TypeVar, Union, get_args, get_origin, get_type_hints

from jaxtyping import AbstractArray

from plnerf.errors import ConfigError, PlnerfError
from plnerf.scene.strict_json import shown

T = TypeVar("T")

_WORDS = {bool: "true or false", int: "a whole number", float: "a finite number", str: "a text"}


def from_json(kind: type[T], data: object, where: str, error: type[PlnerfError] = ConfigError) -> T:
    """A dataclass of the given kind from JSON values; keys left out keep their defaults.

    where: names the source in errors.  error: what is raised for unknown keys, wrong types, missing values.
    """
    try:
        result: T = _convert(kind, data, "")
    except ConfigError as cause:
        raise error(f"{where}: {cause}") from cause
    return result


def _convert(kind: Any, value: Any, key: str) -> Any:
    if dataclasses.is_dataclass(kind):
        return _convert_dataclass(kind, value, key)
    origin, choices = get_origin(kind), get_args(kind)
    if origin is Literal:
        if any(type(value) is type(choice) and value == choice for choice in choices):
            return value
        raise ConfigError(f"{key} must be one of {', '.join(map(repr, choices))}, but is {shown(value)}.")
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
        raise ConfigError(f"{key} must be {_WORDS[kind]}, but is {shown(value)}.")
    return value


def _of_kind(choices: list[Any], value: Any, key: str) -> Any:
    """The one of several dataclasses whose field `kind` is the value's: the first where it says none."""
    if len(choices) == 1 or not isinstance(value, dict) or "kind" not in value:
        return choices[0]
    kinds = {get_args(get_type_hints(choice)["kind"])[0]: choice for choice in choices}
    if not isinstance(value["kind"], str) or value["kind"] not in kinds:
        raise ConfigError(
            f"{_below(key, 'kind')} must be one of {', '.join(map(repr, kinds))}, but is "
            f"{shown(value['kind'])}."
        )
    return kinds[value["kind"]]


def _convert_dataclass(kind: Any, value: Any, key: str) -> Any:
    if not isinstance(value, dict):
        raise ConfigError(
            f"{key or 'the whole'} must be an object with the settings of {kind.__name__}, but is "
            f"{shown(value)}."
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
        raise ConfigError(f"{key} must be a list, but is {shown(value)}.")
    kinds = [choices[0]] * len(value) if choices[-1] is Ellipsis else list(choices)
    if len(kinds) != len(value):
        raise ConfigError(f"{key} must have {len(kinds)} items, but has {len(value)}: {shown(value)}.")
    return tuple(
        _convert(kind, item, _below(key, str(i)))
        for i, (kind, item) in enumerate(zip(kinds, value, strict=True))
    )


def _below(key: str, name: str) -> str:
    """A key's path, as an error shows it: train.loss.colour."""
    return f"{key}.{name}" if key else name


def kind_problem(value: object, hint: Any, key: str = "") -> str | None:
    """What in a value is not of the kind that an annotation states; None where all is.

    Looks into dataclasses, tuples and mappings.  For values that were built of JSON field by field, which
    Python does not check.
    """
    origin, choices = get_origin(hint), get_args(hint)
    if origin in {Union, types.UnionType}:
        problems = [kind_problem(value, choice, key) for choice in choices]
        return None if None in problems else max((text for text in problems if text), key=len)
    if origin is Literal:
        fits = any(type(value) is type(choice) and value == choice for choice in choices)
    elif origin is tuple and isinstance(value, tuple):
        kinds = [choices[0]] * len(value) if choices[-1] is Ellipsis else list(choices)
        fits = len(kinds) == len(value)
        parts = [(kind, one, str(i)) for i, (kind, one) in enumerate(zip(kinds, value, strict=False))]
        return _first_problem(parts, key) if fits else f"{key} has {len(value)} items"
    elif isinstance(origin, type) and issubclass(origin, Mapping) and isinstance(value, Mapping):
        return _first_problem([(choices[1], one, str(name)) for name, one in value.items()], key)
    elif dataclasses.is_dataclass(hint) and isinstance(hint, type) and isinstance(value, hint):
        hints = get_type_hints(hint)
        names = [field.name for field in dataclasses.fields(hint)]
        return _first_problem([(hints[name], getattr(value, name), name) for name in names], key)
    elif isinstance(hint, type) and issubclass(hint, AbstractArray):
        # Not isinstance(value, hint), which remembers lengths: one wire's k is not another's.
        fits = isinstance(value, hint.array_type) and value.ndim == len(hint.dims)
    elif hint is float:
        fits = type(value) in {int, float}
    elif hint in {int, str, bool}:
        fits = type(value) is hint
    else:
        fits = hint in {Any, object} or isinstance(value, hint if origin is None else origin)
    return None if fits else f"{key} is {shown(value)}"


def _first_problem(parts: Sequence[tuple[Any, object, str]], key: str) -> str | None:
    problems = (kind_problem(value, kind, _below(key, name)) for kind, value, name in parts)
    return next((problem for problem in problems if problem), None)
