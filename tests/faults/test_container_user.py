"""The demo runs as containers run it: any user, without a home, with packages that only root may write."""

import os
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import Any

import pytest

import plnerf

pytestmark = pytest.mark.faults

USER = 12345
"""Without an entry in the system's list."""
AS_USER: dict[str, Any] = {"user": USER, "group": USER, "extra_groups": []}


def may_run_python() -> bool:
    """Whether this process may become the user, who may run this Python and read its packages."""
    if os.name == "nt" or os.geteuid() != 0:
        return False
    try:
        subprocess.run([sys.executable, "-c", "import numpy"], cwd="/", check=True, **AS_USER)
    except (OSError, subprocess.SubprocessError):
        return False
    return True


def test_the_demo_runs_for_a_user_without_a_home() -> None:
    if not may_run_python():
        pytest.skip("needs root, to become another user, and a Python that others may run")
    package = Path(plnerf.__file__).parent
    with tempfile.TemporaryDirectory() as folder:
        os.chown(folder, USER, USER)
        done = subprocess.run(
            [sys.executable, "-m", "plnerf.cli.main", "demo", "--quick", "-o", "demo"],
            env={"PATH": os.environ["PATH"], "PYTHONPATH": str(package.parent), "TMPDIR": folder},
            cwd=folder, **AS_USER, capture_output=True, text=True, check=False, timeout=1800,
        )  # fmt: skip
        assert done.returncode == 0, done.stdout + done.stderr
        assert f"Compiled kernels are kept in {folder}" in " ".join(done.stderr.split())
        assert (Path(folder) / "demo" / "survey" / "report.html").is_file()
