"""The command that writes a run or a survey in further formats."""

from pathlib import Path
from typing import Annotated, Literal

import tyro

from plnerf.cli.options import OptionalOut
from plnerf.export.splat_config import SplatConfig
from plnerf.terminal import Terminal

Format = Literal["ply", "glb", "splat", "html", "gpkg", "kml", "copc", "pls-cadd"]
Formats = Annotated[
    tuple[Format, ...],
    tyro.conf.arg(aliases=["--format"], help_behavior_hint="(default: all that the source has)"),
]
SPLATS = SplatConfig()


def export(
    source: tyro.conf.Positional[Path],
    *,
    formats: Formats = (),
    out: OptionalOut = None,
    codes: Path | None = None,
    splats: SplatConfig = SPLATS,
) -> None:
    """Write a run as Gaussian splats and a page to hand on, or a survey as GIS files.

    Args:
        source: Folder of a run, or of a survey.
        formats: Of a run: ply, glb and splat, Gaussians fitted to its field, and html, an offline page.
            Of a survey: gpkg, kml and copc, which need pip install "plnerf[gis]", and pls-cadd; when left
            out, all but those for which the survey lacks something.
        out: Folder to write; when left out, export in a run's folder, or the survey's own.
        codes: Feature codes of PLS-CADD (TOML); 200 upwards when left out.
        splats: How Gaussians are fitted.
    """
    from plnerf.console import bars, say
    from plnerf.exporting import export_source

    console = Terminal()
    with bars(console) as progress:
        done = export_source(source, formats, out, codes, splats, progress)
    for line in (*map(str, done.files.values()), *(f"Left out: {reason}" for reason in done.about)):
        say(console, line)
