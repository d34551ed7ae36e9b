"""The page on faults names tests that are there."""

import re
from pathlib import Path

TESTS = Path(__file__).resolve().parent
PAGE = TESTS.parent / "docs" / "trust.md"


def test_every_test_that_the_page_names_is_there() -> None:
    text = PAGE.read_text(encoding="utf-8")
    named = re.findall(r"`(?:tests/)?([\w/]+\.py)::(\w+)`", text)
    assert len({test for _, test in named}) >= 14
    for file, test in named:
        assert f"def {test}(" in (TESTS / file).read_text(encoding="utf-8"), f"{file}::{test}"
    for file in re.findall(r"tests/[\w/]+\.py", text):
        assert (TESTS.parent / file).is_file(), file
