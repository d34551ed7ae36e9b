"""Changes of files that readers have stumbled over: of bytes, of numbers in text, and of values in JSON."""

import json
import random
import re
from typing import Any

BYTES = (b"", b"\0", b"\xff", b"\xff\xff\xff\xff", b"\0\0\0\x80", b"\xef\xbb\xbf", b"\n", b",", b"[" * 50)
NUMBERS = (
    b"0", b"-1", b"nan", b"inf", b"-inf", b"1e308", b"1e400", b"1e-320", b"9" * 400, b"2147483648",
    b"9223372036854775808", b"1000000000000", b"0x10", b"1_0", b"", b"\xd9\xa3",
)  # fmt: skip
VALUES: tuple[Any, ...] = (
    None, True, 0, -1, 1e308, -1e-320, 10**30, 2**63, 1.5, "", "x", "\0", "\ud800", "../../x", [], {}, [[]],
    [1], [None], {"x": 1}, ["a", 1], [[1e300] * 3] * 3,
)  # fmt: skip
NUMBER = re.compile(rb"-?\d+(?:\.\d+)?(?:e[+-]?\d+)?")


def mutated(content: bytes, draw: random.Random, is_json: bool = False) -> bytes:
    """A content with one to four changes."""
    for _ in range(draw.choice((1, 1, 2, 4))):
        kinds = [_cut, _replaced, _repeated, _flipped, _number]
        content = draw.choice([*kinds, *[_value] * (5 * is_json)])(content, draw)
    return content


def _places(content: bytes, draw: random.Random) -> tuple[int, int]:
    start = draw.randrange(len(content) + 1)
    return start, min(len(content), start + draw.choice((0, 1, 1, 2, 4, 8, 40)))


def _cut(content: bytes, draw: random.Random) -> bytes:
    start, end = _places(content, draw)
    return content[:start] + content[end:] if draw.random() < 0.7 else content[:start]


def _replaced(content: bytes, draw: random.Random) -> bytes:
    start, end = _places(content, draw)
    return content[:start] + draw.choice(BYTES) + content[end:]


def _repeated(content: bytes, draw: random.Random) -> bytes:
    start, end = _places(content, draw)
    return content[:end] + content[start:end] * draw.choice((1, 2, 100)) + content[end:]


def _flipped(content: bytes, draw: random.Random) -> bytes:
    if not content:
        return content
    at = draw.randrange(min(len(content), draw.choice((64, 400, len(content)))))
    return content[:at] + bytes([content[at] ^ 1 << draw.randrange(8)]) + content[at + 1 :]


def _number(content: bytes, draw: random.Random) -> bytes:
    found = list(NUMBER.finditer(content[:20_000]))
    if not found:
        return content
    one = draw.choice(found)
    return content[: one.start()] + draw.choice(NUMBERS) + content[one.end() :]


def _value(content: bytes, draw: random.Random) -> bytes:
    """One value of a JSON file replaced, removed, or put elsewhere."""
    try:
        whole = json.loads(content)
    except (ValueError, RecursionError):
        return content
    places: list[tuple[Any, Any]] = []

    def collect(value: Any) -> None:
        lists = enumerate(value) if isinstance(value, list) else ()
        parts = value.items() if isinstance(value, dict) else lists
        for key, part in parts:
            places.append((value, key))
            collect(part)

    collect(whole)
    if not places:
        return json.dumps(draw.choice(VALUES)).encode()
    # As often near the top as deep in long lists.
    inside, key = draw.choice(places[: draw.choice((12, 60, len(places)))])
    match draw.randrange(4):
        case 0:
            del inside[key]
        case 1:
            other, name = draw.choice(places)
            if name in other if isinstance(other, dict) else name < len(other):
                inside[key] = json.loads(json.dumps(other[name]))
        case _:
            inside[key] = draw.choice(VALUES)
    return json.dumps(whole).encode()
