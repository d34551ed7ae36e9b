"""The command that compares two surveys of one line."""

import sys
from pathlib import Path

import tyro

from plnerf.cli.options import OptionalOut
from plnerf.terminal import Terminal


def change(
    a: tyro.conf.Positional[Path],
    b: tyro.conf.Positional[Path],
    *,
    out: OptionalOut = None,
    conductor: Path | None = None,
    temperature_sigma_c: float = 3.0,
) -> None:
    """What differs between two surveys of one line beyond their uncertainties; status 3 if anything does.

    Args:
        a: The earlier survey: its folder, or survey.json.
        b: The later survey.
        out: Folder to write change.json and change.csv into; nothing is written when left out.
        conductor: Of the phases, as of the command survey: then differences of sag that the
            temperatures of both surveys (--temperature-c) explain are recognised.
        temperature_sigma_c: Standard deviation of each of these temperatures, in degrees.
    """
    from plnerf.change.change_files import change_text, write_change
    from plnerf.change.compare_surveys import compare_surveys
    from plnerf.line.files import SURVEY_FILE, read_survey

    first, second = (path / SURVEY_FILE if path.is_dir() else path for path in (a, b))
    found = compare_surveys(read_survey(first), read_survey(second), conductor, temperature_sigma_c)
    Terminal().print(change_text(found), highlight=False, markup=False, soft_wrap=True)
    if out is not None:
        write_change(out, found, first, second)
    sys.exit(3 if found.different else 0)
