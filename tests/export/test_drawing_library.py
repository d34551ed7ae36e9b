"""DXF files are written for a user whom the system does not know, as containers have them."""

import os
import subprocess
import sys

UNKNOWN_USER = """
import os, pwd

def unknown(uid):
    raise KeyError(f"getpwuid(): uid not found: {uid}")

pwd.getpwuid = unknown
import plnerf.export.dxf
print("HOME" in os.environ)
"""


def test_a_user_without_a_home_loads_the_library_quietly() -> None:
    names = os.environ.keys() - {"HOME", "XDG_CONFIG_HOME", "XDG_CACHE_HOME"}
    environment = {name: os.environ[name] for name in names}
    done = subprocess.run(
        [sys.executable, "-c", UNKNOWN_USER], env=environment, capture_output=True, text=True, check=False
    )
    assert (done.returncode, done.stdout, done.stderr) == (0, "False\n", "")
