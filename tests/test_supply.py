"""A release is built from the tested set of versions, each with its hashes, and an audit hides nothing."""

import re
import runpy
import tomllib
from pathlib import Path
from typing import Any

import pytest

ROOT = Path(__file__).resolve().parent.parent
PIN = re.compile(r"^([A-Za-z0-9._-]+)==(\S+)(.*(?:\n +.*)*)", re.MULTILINE)


def plain(name: str) -> str:
    """A package's name as registries compare it."""
    return re.sub(r"[-_.]+", "-", name).lower()


def pins(path: Path) -> dict[str, tuple[str, str]]:
    """Version, and what else is stated, of each package."""
    return {plain(name): (version, more) for name, version, more in PIN.findall(path.read_text())}


def test_the_lock_is_of_the_tested_versions() -> None:
    lock, tested = pins(ROOT / "requirements.lock"), pins(ROOT / "constraints.txt")
    assert {name: lock[name][0] for name in tested} == {
        name: version for name, (version, _) in tested.items()
    }
    project = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
    wanted = [
        *project["dependencies"],
        *(one for extra in project["optional-dependencies"].values() for one in extra),
    ]
    assert {plain(re.split(r"[\[<>=;]", one)[0]) for one in wanted} <= lock.keys()


def test_every_package_of_the_lock_has_hashes_and_no_address() -> None:
    text = (ROOT / "requirements.lock").read_text()
    assert "://" not in text and "--index-url" not in text and "--find-links" not in text
    for name, version, more in PIN.findall(text):
        assert re.search(r"--hash=sha256:[0-9a-f]{64}", more), f"{name} {version}"


@pytest.mark.parametrize(
    ("packages", "status", "said"),
    [
        ([{"name": "a", "skip_reason": "not found"}], 0, "!! AUDIT SKIPPED: the database"),
        ([{"name": "a", "version": "1", "vulns": []}], 0, "audit: 1 packages checked, 0 with"),
        (
            [{"name": "a", "version": "1", "vulns": []}, {"name": "b", "skip_reason": "not found"}],
            0,
            "NOT AUDITED, 1 of 2: b",
        ),
        ([{"name": "a", "version": "1", "vulns": [{"id": "CVE-1", "fix_versions": ["2"]}]}], 1, "fixed in 2"),
    ],
)
def test_an_audit_says_what_was_not_checked(
    packages: list[dict[str, Any]], status: int, said: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert runpy.run_path(str(ROOT / ".ci" / "audit.py"))["verdict"](packages) == status
    assert said in capsys.readouterr().out
