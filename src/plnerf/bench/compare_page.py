"""What a comparison shows: a table, learning curves and a sheet of crops, as Markdown and one HTML page."""

import base64
import html
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from jaxtyping import UInt8

from plnerf.bench.tables import Table, figure
from plnerf.render.panels import side_by_side
from plnerf.render.picture_files import write_png, write_text
from plnerf.render.pictures import DepthRange, depth_picture, rgb_picture, with_legend

CROP_WIDTH_PX = 320
CELLS_IN_A_ROW = 4
COLOURS = ("#1b6ca8", "#d1495b", "#2e933c", "#8f5db7", "#e08e1b", "#444444", "#159a9c", "#a05a2c")
_WIDTH, _HEIGHT, _LEFT, _BOTTOM = 760, 360, 52, 40


def comparison_table(results: Sequence[Mapping[str, Any]], about: Mapping[str, Any]) -> Table:
    """A row for each preset; those that failed have dashes."""
    rows = []
    for one in results:
        if "failed" in one:
            rows.append((one["preset"], *["–"] * 10))
            continue
        mean = one["mean"]
        rows.append((
            one["preset"],
            *(figure(mean[key], 4 if key.endswith("db") else 3)
              for key in ("psnr_db", "ssim", "lpips", "wire_psnr_db", "near_wire_psnr_db")),
            f"{one['steps']:,}", figure(one["training_s"]), figure(one["rays_per_s"]),
            figure(one["peak_bytes"] / 2**30 if one["peak_bytes"] else None, 2),
            f"{one['parameters'] / 1e6:.2f} M",
        ))  # fmt: skip
    columns = (
        "preset", "PSNR dB", "SSIM", "LPIPS", "PSNR in wires dB", "near wires dB", "steps", "training s",
        "rays/s", "peak GiB", "parameters",
    )  # fmt: skip
    budget = f"{about['steps']:,} steps" if about["steps"] else f"{about['seconds']:g} s of training"
    note = (
        f"{budget} each, seed {about['seed']}, images reduced {about['downscale']} times; {about['cpu']}, "
        f"{about['usable_cores']} cores{', ' + about['gpu'] if about['gpu'] else ''}; means over the "
        "held-out images; rays/s: finding conductors included, where a preset does; peak: resident memory "
        "of the training process."
    )
    return Table("Systems compared", columns, tuple(rows), (note,))


def write_pages(out: Path, results: Sequence[Mapping[str, Any]], about: Mapping[str, Any]) -> None:
    """compare.md, compare.html, curves.svg and, where a system has a view, sheet.png."""
    table, done = comparison_table(results, about), [one for one in results if "failed" not in one]
    curves = curves_svg({one["preset"]: [(s, p) for s, _, p in one["curve"]] for one in done})
    write_text(out / "curves.svg", curves + "\n")
    sections = [table.markdown(), "![held-out PSNR against seconds of training](curves.svg)\n"]
    body = [_html_table(table), "<h2>Held-out PSNR while training</h2>", curves]
    if done:
        sheet = crops_sheet(out, done)
        write_png(out / "sheet.png", sheet)
        caption = f"The same part of the held-out view {done[0]['view']}, colour above and depth below."
        sections.append(f"![{caption}](sheet.png)\n")
        body += [f"<h2>Side by side</h2><p>{html.escape(caption)}</p>", _embedded(sheet)]
    failed = [f"{one['preset']}: {one['failed']}" for one in results if "failed" in one]
    sections += [f"Failed: {text}\n" for text in failed]
    body += [f"<p>Failed: {html.escape(text)}</p>" for text in failed]
    write_text(out / "compare.md", "\n".join(sections))
    write_text(out / "compare.html", _PAGE.format(body="\n".join(body)))


def crops_sheet(out: Path, done: Sequence[Mapping[str, Any]]) -> UInt8[np.ndarray, "h w 3"]:
    """The photo and what each system makes of it, its depth below; all depths with one scale."""
    views = {one["preset"]: np.load(out / one["preset"] / "view.npz") for one in done}
    top, left, h, w = done[0]["crop"]
    part = (slice(top, top + h), slice(left, left + w))
    first = views[done[0]["preset"]]
    depths = [view["depth"][part] for view in views.values()]
    surfaces = np.concatenate([np.empty(0), *(depth[depth > 0] for depth in depths)])
    near, far = np.percentile(surfaces, [1, 98]) if surfaces.size else (1.0, 2.0)
    unit = "m" if str(first["unit"]) == "m" else "units, unscaled"
    shown = DepthRange(float(near), float(max(far, near * 1.05)), unit)
    cells = [_cell("photo", _enlarged(first["photo"][part]), None)]
    for name, view in views.items():
        depth = with_legend(_enlarged(depth_picture(view["depth"][part], shown)), shown)
        cells.append(_cell(name, _enlarged(rgb_picture(view["rgb"][part])), depth))
    return _in_rows(cells)


def _cell(
    name: str, colour: UInt8[np.ndarray, "h w 3"], depth: UInt8[np.ndarray, "h2 w 3"] | None
) -> UInt8[np.ndarray, "h3 w3 3"]:
    upper = side_by_side([(name, colour)])
    return upper if depth is None else np.concatenate([upper, side_by_side([("", depth)])])


def _in_rows(cells: Sequence[UInt8[np.ndarray, "_h w 3"]]) -> UInt8[np.ndarray, "h2 w2 3"]:
    """CELLS_IN_A_ROW side by side, white where there is none."""
    h, w = max(len(cell) for cell in cells), cells[0].shape[1]
    rows = -(-len(cells) // CELLS_IN_A_ROW)
    sheet = np.full((rows * h, min(len(cells), CELLS_IN_A_ROW) * w, 3), 255, np.uint8)
    for k, cell in enumerate(cells):
        top, left = k // CELLS_IN_A_ROW * h, k % CELLS_IN_A_ROW * w
        sheet[top : top + len(cell), left : left + w] = cell
    return sheet


def curves_svg(curves: Mapping[str, Sequence[tuple[float, float]]]) -> str:
    """Held-out PSNR in dB against seconds of training, a line for each system."""
    points = [point for curve in curves.values() for point in curve]
    if not points:
        return "<p>no validations</p>"
    last = max(s for s, _ in points)
    low, high = np.floor(min(p for _, p in points)), np.ceil(max(p for _, p in points))

    def place(s: float, p: float) -> str:
        x = _LEFT + (_WIDTH - _LEFT - 150) * s / last
        y = _HEIGHT - _BOTTOM - (_HEIGHT - _BOTTOM - 12) * (p - low) / max(high - low, 1)
        return f"{x:.1f},{y:.1f}"

    parts = [
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {_WIDTH} {_HEIGHT}" width="{_WIDTH}" '
        'font-family="sans-serif" font-size="13" role="img">',
        f'<rect width="{_WIDTH}" height="{_HEIGHT}" fill="white"/>',
    ]
    for level in np.linspace(low, high, 5):
        (x0, y0), (x1, _) = (place(s, level).split(",") for s in (0.0, last))
        parts.append(f'<line x1="{x0}" y1="{y0}" x2="{x1}" y2="{y0}" stroke="#ddd"/>')
        parts.append(f'<text x="{_LEFT - 6}" y="{y0}" text-anchor="end" dy="4">{level:g}</text>')
    for s in np.linspace(0, last, 5):
        x = place(s, low).split(",")[0]
        parts.append(f'<text x="{x}" y="{_HEIGHT - 18}" text-anchor="middle">{s:.0f}</text>')
    parts.append(f'<text x="{_LEFT}" y="{_HEIGHT - 3}">seconds of training; held-out PSNR in dB</text>')
    for k, (name, curve) in enumerate(curves.items()):
        colour = COLOURS[k % len(COLOURS)]
        line = " ".join(place(s, p) for s, p in curve)
        parts.append(f'<polyline points="{line}" fill="none" stroke="{colour}" stroke-width="2"/>')
        parts.append(f'<text x="{_WIDTH - 142}" y="{24 + 20 * k}" fill="{colour}">{html.escape(name)}</text>')
    return "\n".join([*parts, "</svg>"])


def _enlarged(picture: UInt8[np.ndarray, "h w 3"]) -> UInt8[np.ndarray, "h2 w2 3"]:
    """By a whole factor, without smoothing: wires shall be seen as they are."""
    factor = max(1, round(CROP_WIDTH_PX / picture.shape[1]))
    size = (picture.shape[1] * factor, picture.shape[0] * factor)
    return cv2.resize(picture, size, interpolation=cv2.INTER_NEAREST)


def _embedded(picture: UInt8[np.ndarray, "h w 3"]) -> str:
    _, data = cv2.imencode(".png", cv2.cvtColor(picture, cv2.COLOR_RGB2BGR))
    text = base64.b64encode(data.tobytes()).decode()
    return f'<img src="data:image/png;base64,{text}" alt="crops side by side">'


def _html_table(table: Table) -> str:
    def row(cells: Sequence[str], tag: str) -> str:
        return "<tr>" + "".join(f"<{tag}>{html.escape(cell)}</{tag}>" for cell in cells) + "</tr>"

    rows = "\n".join([row(table.columns, "th"), *(row(cells, "td") for cells in table.rows)])
    notes = "".join(f"<p>{html.escape(note)}</p>" for note in table.notes)
    return f"<h1>{html.escape(table.title)}</h1>\n<table>{rows}</table>{notes}"


_PAGE = """<!doctype html>
<html lang="en"><head><meta charset="utf-8"><title>plnerf compare</title><style>
body {{ font-family: system-ui, sans-serif; margin: 2rem; color: #222; }}
table {{ border-collapse: collapse; }}
th, td {{ padding: .35rem .7rem; text-align: right; border-bottom: 1px solid #ddd; }}
th:first-child, td:first-child {{ text-align: left; }}
img {{ max-width: 100%; }}
</style></head><body>
{body}
</body></html>
"""
