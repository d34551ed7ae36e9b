"""The result of `reconstruct` as what must not depend on when it was made, and where."""

import re
from pathlib import Path

NOT_COMPARED = {
    "run/pixels/index.json": "its fingerprint holds the times of the photos",
    "run/survey/conductors.dxf": "ezdxf writes times and random identifiers",
    "survey/conductors.dxf": "ezdxf writes times and random identifiers",
    "survey/pixels/index.json": "its fingerprint holds the times of the photos",
    "scene/photos.json": "the times of the photos' files",
    "scene/sfm/database.db": "SQLite's pages lie in the order of their writing",
    "scene/sfm/inputs.sha256": "holds the times of the photos",
}
"""Files of which only the existence is compared, and why."""
EVENTS = "events.out.tfevents"
"""Of TensorBoard: every process begins another file."""
TEXTS = {".json", ".jsonl", ".md", ".html", ".csv", ".geojson", ".txt"}
TIMES = re.compile(
    rb'"(?:\w*seconds|rays_per_second|rays_per_s)": [\d.e+-]+|"seconds": \{[^}]*\}'
    rb"|\d{4}-\d\d-\d\d \d\d:\d\d|after \d+ s"
)
DAY = slice(90, 94)
"""Of a LAS header: the day and the year of its creation."""


def result(out: Path) -> dict[str, bytes]:
    """Files by their paths below `out`: their bytes, of texts without durations, dates and `out`."""
    files = sorted(path for path in out.rglob("*") if path.is_file() and not path.name.startswith(EVENTS))
    return {(name := path.relative_to(out).as_posix()): _content(path, name, out) for path in files}


def _content(path: Path, name: str, out: Path) -> bytes:
    if name in NOT_COMPARED:
        return b""
    content = path.read_bytes()
    if path.suffix == ".laz":
        content = content[: DAY.start] + content[DAY.stop :]
    if path.suffix in TEXTS:
        content = TIMES.sub(b"TIME", content.replace(str(out).encode(), b"OUT"))
    return content


def differing(one: dict[str, bytes], other: dict[str, bytes]) -> list[str]:
    """Names of files that only one result holds, or that hold something else."""
    return [name for name in sorted(one.keys() | other.keys()) if one.get(name) != other.get(name)]


def inside(folder: str, files: dict[str, bytes]) -> dict[str, bytes]:
    """Those of a folder."""
    return {name: content for name, content in files.items() if name.startswith(folder)}
