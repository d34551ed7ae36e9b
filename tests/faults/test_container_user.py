"""The demo runs as containers run it: any user, without a home, with packages that only root may write."""

import os
import subprocess
import sys
import tempfile
from pathlib import Path

import pytest

import plnerf

pytestmark = pytest.mark.faults

USER = 12345
"""Without an entry in the system's list."""


@pytest.mark.skipif(os.name == "nt" or os.geteuid() != 0, reason="needs root, to become another user")
def test_the_demo_runs_for_a_user_without_a_home() -> None:
    package = Path(plnerf.__file__).parent
    with tempfile.TemporaryDirectory() as folder:
        os.chown(folder, USER, USER)
        done = subprocess.run(
            [sys.executable, "-m", "plnerf.cli.main", "demo", "--quick", "-o", "demo"],
            env={"PATH": os.environ["PATH"], "PYTHONPATH": str(package.parent), "TMPDIR": folder},
            cwd=folder, user=USER, group=USER, extra_groups=[],
            capture_output=True, text=True, check=False, timeout=1800,
        )  # fmt: skip
        assert done.returncode == 0, done.stdout + done.stderr
        assert f"Compiled kernels are kept in {folder}" in " ".join(done.stderr.split())
        assert (Path(folder) / "demo" / "survey" / "report.html").is_file()
