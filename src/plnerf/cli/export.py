"""The command that writes a survey in further formats."""

from pathlib import Path
from typing import Literal

import tyro

from plnerf.cli.options import OptionalOut
from plnerf.terminal import Terminal

Format = Literal["gpkg", "kml", "copc", "pls-cadd"]


def export(
    survey: tyro.conf.Positional[Path],
    *,
    formats: tuple[Format, ...] | None = None,
    out: OptionalOut = None,
    codes: Path | None = None,
) -> None:
    """Write a survey as GeoPackage, KML, COPC, or PLS-CADD XYZ; needs pip install "plnerf[gis]".

    Args:
        survey: Folder of a survey.
        formats: Which ones; when left out, all but those for which the survey lacks something.
        out: Folder to write; the survey's own when left out.
        codes: Feature codes of PLS-CADD (TOML); 200 upwards when left out.
    """
    from plnerf.console import say
    from plnerf.pipeline import export_survey

    done = export_survey(survey, formats, out, codes)
    for line in (*map(str, done.files.values()), *(f"Left out: {reason}" for reason in done.about)):
        say(Terminal(), line)
