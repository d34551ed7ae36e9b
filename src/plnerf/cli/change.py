"""The command that compares two surveys of one line."""

import sys
from pathlib import Path
from typing import Annotated

import tyro

from plnerf.cli.options import OptionalOut
from plnerf.mechanics.config import MechanicsConfig
from plnerf.terminal import Terminal


def change(
    a: tyro.conf.Positional[Path],
    b: tyro.conf.Positional[Path],
    *,
    out: OptionalOut = None,
    mechanics: Annotated[MechanicsConfig, tyro.conf.arg(name="")] = MechanicsConfig(),
) -> None:
    """What differs between two surveys of one line beyond their uncertainties; status 3 if anything does.

    Args:
        a: The earlier survey: its folder, or survey.json.
        b: The later survey.
        out: Folder to write change.json and change.csv into; nothing is written when left out.
        mechanics: The conductors, as for the command survey: then what the temperatures of both surveys
            (--temperature-c) make of sags and clearances is recognised.
    """
    from plnerf.change.change_files import change_text, write_change
    from plnerf.change.compare_surveys import compare_surveys
    from plnerf.line.files import SURVEY_FILE, read_survey

    first, second = (path / SURVEY_FILE if path.is_dir() else path for path in (a, b))
    found = compare_surveys(read_survey(first), read_survey(second), mechanics)
    Terminal().print(change_text(found), highlight=False, markup=False, soft_wrap=True)
    if out is not None:
        write_change(out, found, first, second)
    sys.exit(3 if found.different else 0)
