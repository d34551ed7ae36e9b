"""What the suite `coverage` shows: tables and plots by kind of input, all figures as CSV, one page."""

import csv
import io
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
from scipy.stats import binomtest, norm

from plnerf.bench.machine import circumstances
from plnerf.bench.tables import Table, figure
from plnerf.scene.files import write_text
from plnerf.score.intervals import FIGURE_KINDS, LIMIT, Figure

Found = Mapping[str, Mapping[str, Sequence[Figure]]]
"""Figures by source and name of the scene."""
STATED = 0.95
REJECTED_P = 0.05
COLUMNS = ("figure", "n", "inside 95 %", "p", "worst, σ", "median σ, m", "median error, m")
NOTES = (
    "inside 95 %: share of figures whose true value lies in the stated 95 % interval; p: of a binomial test "
    f"of this share against {STATED:.0%}, which rejects it below {REJECTED_P:g} (marked *); worst: the "
    "greatest error in stated standard deviations; medians: of the stated standard deviations, and of the "
    "absolute errors.",
    f"{LIMIT}: where too little of the air nearer than the nearest plant was seen; inside is what is at most "
    "so far, more is an error, and p is one-sided.",
    "Figures of one scene share errors, so that n counts for more than there is: p is too small where a few "
    "scenes fail as a whole.",
)
SOURCES = {"lidar": "simulated LiDAR flights", "images": "scenes of images"}
COLOURS = ("#1b6ca8", "#d1495b", "#2e933c", "#8f5db7", "#e08e1b", "#444444", "#b0b0b0", "#159a9c", "#a05a2c")
_WIDTH, _HEIGHT, _LEFT, _RIGHT, _BOTTOM = 760, 380, 52, 610, 44
_MOST_SIGMAS = 4.0


def write_coverage(out: Path, found: Found) -> tuple[Table, ...]:
    """Writes coverage.csv, coverage-SOURCE.svg and coverage.md, and returns the tables."""
    tables = []
    lines = [f"# Do stated intervals hold?\n\n{_how(found)}\n"]
    for source, scenes in found.items():
        figures = [one for some in scenes.values() for one in some]
        table, plot = coverage_table(source, len(scenes), figures), f"coverage-{source}.svg"
        write_text(out / plot, coverage_svg(figures) + "\n")
        lines += [table.markdown(), f"![Share of errors within so many stated deviations]({plot})\n"]
        tables.append(table)
    write_text(out / "coverage.csv", _csv(found))
    write_text(out / "coverage.md", "\n".join(lines))
    return tuple(tables)


def coverage_table(source: str, scenes: int, figures: Sequence[Figure]) -> Table:
    """A row for each kind of figure."""
    rows = []
    for kind in FIGURE_KINDS:
        some = [one for one in figures if one.kind == kind]
        if not some:
            rows.append((kind, "0", *["–"] * (len(COLUMNS) - 2)))
            continue
        inside = sum(one.within_95 for one in some)
        sides = "less" if kind == LIMIT else "two-sided"
        p = float(binomtest(inside, len(some), STATED, sides).pvalue)
        rows.append((
            kind, str(len(some)), f"{100 * inside / len(some):.1f} %",
            f"{figure(p, 2)}{' *' if p < REJECTED_P else ''}",
            figure(max(abs(one.deviations) for one in some), 2),
            figure(float(np.median([one.sigma_m for one in some])), 2),
            figure(float(np.median([abs(one.error_m) for one in some])), 2),
        ))  # fmt: skip
    return Table(f"Coverage over {scenes} {SOURCES.get(source, source)}", COLUMNS, tuple(rows), NOTES)


def coverage_svg(figures: Sequence[Figure]) -> str:
    """Share of the errors of each kind within so many stated deviations; grey: of normal errors."""
    parts = [
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {_WIDTH} {_HEIGHT}" width="{_WIDTH}" '
        'font-family="sans-serif" font-size="13" role="img">',
        f'<rect width="{_WIDTH}" height="{_HEIGHT}" fill="white"/>',
        *_axes(),
    ]
    sigmas = np.linspace(0.0, _MOST_SIGMAS, 60)
    parts.append(_line([(float(s), float(2 * norm.cdf(s) - 1)) for s in sigmas], "#bbb", 5.0))
    for k, kind in enumerate(FIGURE_KINDS):
        off = sorted(abs(one.deviations) for one in figures if one.kind == kind)
        if off and kind != LIMIT:
            steps = [(0.0, 0.0), *((one, (i + 1) / len(off)) for i, one in enumerate(off))]
            shown = [(one, share) for one, share in steps if one <= _MOST_SIGMAS]
            parts.append(_line([*shown, (_MOST_SIGMAS, shown[-1][1])], COLOURS[k], 2.0))
            parts.append(f'<text x="{_RIGHT + 10}" y="{24 + 20 * k}" fill="{COLOURS[k]}">{kind}</text>')
    return "\n".join([*parts, "</svg>"])


def _axes() -> list[str]:
    parts = []
    for share in (0.0, 0.25, 0.5, 0.75, STATED, 1.0):
        y = _place(0.0, share).split(",")[1]
        parts.append(f'<line x1="{_LEFT}" y1="{y}" x2="{_RIGHT}" y2="{y}" stroke="#ddd"/>')
        parts.append(f'<text x="{_LEFT - 6}" y="{y}" text-anchor="end" dy="4">{100 * share:.0f} %</text>')
    for sigmas in range(int(_MOST_SIGMAS) + 1):
        x = _place(float(sigmas), 0.0).split(",")[0]
        parts.append(f'<text x="{x}" y="{_HEIGHT - 24}" text-anchor="middle">{sigmas}</text>')
    parts.append(f'<text x="{_LEFT}" y="{_HEIGHT - 6}">error in stated standard deviations</text>')
    return parts


def _line(points: Sequence[tuple[float, float]], colour: str, width: float) -> str:
    path = " ".join(_place(*point) for point in points)
    return f'<polyline points="{path}" fill="none" stroke="{colour}" stroke-width="{width:g}"/>'


def _place(sigmas: float, share: float) -> str:
    x = _LEFT + (_RIGHT - _LEFT) * sigmas / _MOST_SIGMAS
    return f"{x:.1f},{_HEIGHT - _BOTTOM - (_HEIGHT - _BOTTOM - 12) * share:.1f}"


def _how(found: Found) -> str:
    """The machine and the scenes, in words."""
    about = circumstances("cpu")
    scenes = "; ".join(f"{source}: {', '.join(of)}" for source, of in found.items())
    return (
        f"Written by `plnerf bench --suite coverage` ({about['date_utc'][:10]}, {about['cpu']}, "
        f"{about['usable_cores']} cores, plnerf {about['versions']['plnerf']}). Scenes: {scenes}."
    )


def _csv(found: Found) -> str:
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(["source", "scene", "figure", "of", "true_m", "found_m", "sigma_m", "error_sigmas"])
    for source, scenes in found.items():
        for name, figures in scenes.items():
            for one in figures:
                lengths = (f"{value:.5f}" for value in (one.true_m, one.found_m, one.sigma_m))
                writer.writerow([source, name, one.kind, one.of, *lengths, f"{one.deviations:.3f}"])
    return text.getvalue()
