"""JSON is read strictly: what no file of plnerf holds is refused, with the file's name and what to do."""

import dataclasses
import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any, Literal

import numpy as np
import pytest
from jaxtyping import Float

from plnerf.errors import SceneError
from plnerf.scene.strict_json import MAX_DEPTH, object_of, parse_json, read_json, shown
from plnerf.scene.typed_json import from_json, kind_problem

REFUSED: dict[str, tuple[bytes, str]] = {
    "nothing": (b"", "is not valid JSON: Expecting value at line 1, column 1"),
    "cut off": (b'{"a": [1, 2', "is not valid JSON: .* at line 1"),
    "two values": (b"{} {}", "is not valid JSON: Extra data"),
    "another encoding": (b'{"a": "\xe9"}', "cannot be read as UTF-8 text"),
    "UTF-16": ('{"a": 1}'.encode("utf-16"), "cannot be read as UTF-8 text"),
    "not a number": (b'{"a": NaN}', "holds NaN, which is no number of JSON"),
    "infinity": (b'{"a": -Infinity}', "holds -Infinity, which is no number of JSON"),
    "a number that is too large": (b'{"a": 1e999}', "holds the number '1e999', which is too large"),
    "400 digits": (b'{"a": %s}' % (b"9" * 400), "holds a whole number of 400 digits, 9999"),
    "5,000 digits": (b'{"a": -%s}' % (b"9" * 5000), "holds a whole number of 5001 digits"),
    "a key twice": (b'{"b": 0, "a": 1, "a": 2}', "holds the key 'a' twice"),
    "deep lists": (b"[" * 200 + b"]" * 200, "has 200 lists and objects within each other"),
    "very deep lists": (b"[" * 300_000, "has 300,000 lists and objects within each other"),
    "deep objects": (b'{"a":' * 100 + b"1" + b"}" * 100, "has 100 lists and objects"),
}


@pytest.mark.parametrize("name", REFUSED)
def test_what_is_refused(name: str, tmp_path: Path) -> None:
    data, text = REFUSED[name]
    (tmp_path / "a.json").write_bytes(data)
    with pytest.raises(SceneError, match=rf"a\.json {text}.*\. Do this\.$"):
        read_json(tmp_path / "a.json", SceneError, "Do this.")


def test_files_that_cannot_be_read_are_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    with pytest.raises(SceneError, match=r"There is no file .*absent\.json"):
        read_json(tmp_path / "absent.json", SceneError)
    with pytest.raises(SceneError, match="cannot be read"):
        read_json(tmp_path, SceneError)
    (tmp_path / "a.json").write_text("[0, 1, 2]")
    monkeypatch.setattr("plnerf.scene.strict_json.MAX_BYTES", 8)
    with pytest.raises(SceneError, match="has 9 bytes, more than the 8 that are read"):
        read_json(tmp_path / "a.json", SceneError)


def test_what_is_read() -> None:
    deep = "[" * MAX_DEPTH + "]" * MAX_DEPTH
    content = {"text": 'brackets [[[[ \\" {{{' * 50, "n": [1, -2.5, 1e-300, None, True], "é": {}}
    for value in (content, json.loads(deep), 3, "x" * 10_000):
        for mark in (b"", b"\xef\xbb\xbf"):
            assert parse_json(mark + json.dumps(value).encode(), "it", SceneError) == value


def test_values_in_errors_are_short() -> None:
    with pytest.raises(SceneError, match=r"it must hold a JSON object, but holds \[0, 0") as caught:
        object_of([0] * 10_000, "it", SceneError)
    assert len(str(caught.value)) < 200 and shown("x") == "'x'"


@dataclasses.dataclass(frozen=True)
class Inner:
    kind: Literal["a", 1]
    pair: tuple[float, float]


@dataclasses.dataclass(frozen=True)
class Outer:
    inner: tuple[Inner, ...]
    name: str | None
    table: Mapping[str, int]


def test_kinds_are_those_of_the_annotations() -> None:
    good = Outer((Inner("a", (0.5, 1)),), None, {"x": 1})
    assert kind_problem(good, Outer) is None
    for change, problem in (
        ({"name": ["x"]}, "name is ['x']"),
        ({"table": {"x": True}}, "table.x is True"),
        ({"table": 3}, "table is 3"),
        ({"inner": (good,)}, "inner.0 is Outer("),
        ({"inner": (Inner("b", (0.5, 1)),)}, "inner.0.kind is 'b'"),  # type: ignore[arg-type]
        ({"inner": (Inner(True, (0.5, 1)),)}, "inner.0.kind is True"),  # type: ignore[arg-type]
        ({"inner": (Inner("a", (0.5, "1")),)}, "inner.0.pair.1 is '1'"),  # type: ignore[arg-type]
        ({"inner": (Inner("a", (0.5,)),)}, "inner.0.pair has 1 items"),  # type: ignore[arg-type]
    ):
        changed: Any = dataclasses.replace(good, **change)
        assert (kind_problem(changed, Outer) or "").startswith(problem)


def test_a_truth_is_no_number_of_a_choice() -> None:
    with pytest.raises(SceneError, match="it: kind must be one of 'a', 1, but is True"):
        from_json(Inner, {"kind": True, "pair": [0.0, 1.0]}, "it", SceneError)


@dataclasses.dataclass(frozen=True)
class Curve:
    s_m: Float[np.ndarray, " k"]
    points: Float[np.ndarray, "k 3"]


def test_arrays_of_two_values_have_lengths_of_their_own() -> None:
    curves = tuple(Curve(np.zeros(k), np.zeros((k, 3))) for k in (2, 5))
    assert kind_problem(curves, tuple[Curve, ...]) is None
    object.__setattr__(curves[1], "points", np.zeros(15))
    assert (kind_problem(curves, tuple[Curve, ...]) or "").startswith("1.points is array")
    object.__setattr__(curves[0], "s_m", [0.0, 1.0])
    assert kind_problem(curves, tuple[Curve, ...]) == "0.s_m is [0.0, 1.0]"
