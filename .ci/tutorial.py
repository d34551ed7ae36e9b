"""Runs every command of the tutorial: the fenced `bash` blocks of docs/tutorial.md, in order, in one shell.

    python .ci/tutorial.py OUT [--quick]

OUT: new folder in which the commands run.  --quick: with the small values that the page itself names, in
its block with the title `quick`.  Prints how long each command took; ends with the first that fails.
"""

import argparse
import re
import subprocess
import sys
from pathlib import Path

PAGE = Path(__file__).resolve().parent.parent / "docs" / "tutorial.md"
BLOCK = re.compile(r'^```(\w+)(?: title="(\w+)")?\n(.*?)^```$', re.MULTILINE | re.DOTALL)


def blocks(kind: str, name: str | None = None) -> list[str]:
    """The texts of the page's fenced blocks of a kind."""
    return [text for found, of, text in BLOCK.findall(PAGE.read_text(encoding="utf-8"))
            if found == kind and of == (name or "")]  # fmt: skip


def commands() -> list[str]:
    """Each command of the bash blocks on a line of its own, without comments."""
    lines = "".join(blocks("bash")).replace("\\\n", " ").splitlines()
    found = [re.sub(r"\s+#.*$", "", line).strip() for line in lines]
    return [line for line in found if line and not line.startswith("#")]


def script(quick: bool) -> str:
    """A bash script that times each command."""
    lines = ["set -euo pipefail"]
    if quick:
        lines += blocks("sh", "quick")
    for command in commands():
        shown = command.replace("'", "'\\''")
        lines += [f"printf '\\n$ %s\\n' '{shown}'", "at=$(date +%s.%N)", command]
        lines.append("""awk -v a=$at -v b=$(date +%s.%N) 'BEGIN {printf "= %.1f s\\n", b - a}'""")
    return "\n".join(lines) + "\n"


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("out", type=Path)
    parser.add_argument("--quick", action="store_true")
    given = parser.parse_args()
    given.out.mkdir(parents=True)
    sys.exit(subprocess.run(["bash", "-c", script(given.quick)], cwd=given.out, check=False).returncode)
