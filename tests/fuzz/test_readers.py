"""Damaged files of every kind are refused with an error of plnerf's, or give finite content.

Some hundred inputs; `benchmarks/fuzz_readers.py` feeds as many as one likes, led by coverage.
"""

import random
from pathlib import Path

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from tests.fuzz.accepted import Broken, feed, not_finite
from tests.fuzz.mutations import mutated
from tests.fuzz.readers import Reader, all_readers


@pytest.fixture(scope="module")
def readers(tmp_path_factory: pytest.TempPathFactory) -> list[Reader]:
    """In a fixed order."""
    return list(all_readers(tmp_path_factory.mktemp("readers")))


def test_what_fuzzing_begins_from_is_taken(readers: list[Reader]) -> None:
    assert len(readers) >= 40 and len({reader.name for reader in readers}) == len(readers)
    for reader in readers:
        assert all(feed(reader, content) for content in reader.seeds), reader.name


@settings(max_examples=120, deadline=None, suppress_health_check=list(HealthCheck))
@given(which=st.integers(0, 1000), seed=st.integers(0, 2**32))
def test_damaged_files_are_refused_or_taken(readers: list[Reader], which: int, seed: int) -> None:
    reader, draw = readers[which % len(readers)], random.Random(seed)
    feed(reader, mutated(draw.choice(reader.seeds), draw, reader.is_json))


def test_what_is_not_finite_is_found(tmp_path: Path) -> None:
    for value in ({"a": [1.0, float("nan")]}, (1, {"b": float("inf")})):
        assert not_finite(value) is not None
        with pytest.raises(Broken, match="accepted, but it"):
            feed(Reader("broken", tmp_path / "file", lambda value=value: value, ()), b"")
