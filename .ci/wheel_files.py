"""Compares a wheel with the repository: every file that git knows below src/ must be in it, and no other.

python .ci/wheel_files.py dist/plnerf-VERSION-py3-none-any.whl
"""

import subprocess
import sys
import zipfile

wheel = sys.argv[1]
listed = subprocess.run(["git", "ls-files", "src"], check=True, capture_output=True, text=True).stdout
known = {path.removeprefix("src/") for path in listed.splitlines()}
with zipfile.ZipFile(wheel) as archive:
    packed = {name for name in archive.namelist() if ".dist-info/" not in name and not name.endswith("/")}
for what, names in (("not in the wheel", known - packed), ("not in the repository", packed - known)):
    for name in sorted(names):
        print(f"{what}: {name}")
if known != packed:
    sys.exit(f"{wheel} is not whole. See package-data in pyproject.toml.")
print(f"{wheel}: {len(packed)} files, as in the repository")
