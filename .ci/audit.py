"""Asks pip-audit for known vulnerabilities of all that requirements.lock pins: `python audit.py PIP_AUDIT`.

Status 1 where there is one.  Where the database cannot be reached, or does not know the packages, this says
SKIPPED with the number of packages that nobody checked, and ends with 0.
"""

import json
import subprocess
import sys
from pathlib import Path

LOCK = Path(__file__).resolve().parent.parent / "requirements.lock"
LIMIT_S = 300


def main() -> int:
    options = ["--disable-pip", "--require-hashes", "--format=json", "--progress-spinner=off"]
    command = [sys.argv[1], "-r", LOCK, *options]
    try:
        done = subprocess.run(command, capture_output=True, text=True, check=False, timeout=LIMIT_S)
    except (OSError, subprocess.TimeoutExpired) as error:
        return skipped(f"pip-audit did not run ({type(error).__name__})")
    try:
        packages = json.loads(done.stdout)["dependencies"]
    except (ValueError, KeyError):
        return skipped(f"pip-audit gave no answer ({' '.join(done.stderr.split())[-200:]})")
    return verdict(packages)


def verdict(packages: list[dict]) -> int:
    """Prints what was found of the packages; the exit status."""
    unchecked = [one["name"] for one in packages if "skip_reason" in one]
    if len(unchecked) == len(packages):
        return skipped(f"the database of vulnerabilities knows none of the {len(packages)} packages")
    for one in packages:
        for found in one.get("vulns", ()):
            fixed = ", ".join(found.get("fix_versions", ())) or "no version"
            print(f"{one['name']} {one['version']}: {found['id']}, fixed in {fixed}")
    if unchecked:
        print(f"NOT AUDITED, {len(unchecked)} of {len(packages)}: {', '.join(unchecked)}")
    bad = sum(bool(one.get("vulns")) for one in packages)
    print(f"audit: {len(packages) - len(unchecked)} packages checked, {bad} with known vulnerabilities")
    return 1 if bad else 0


def skipped(why: str) -> int:
    """Says that nothing was checked."""
    print(f"!! AUDIT SKIPPED: {why}. Run it again where there is a network before a release.")
    return 0


if __name__ == "__main__":
    sys.exit(main())
