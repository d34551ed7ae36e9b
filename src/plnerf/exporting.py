"""What `plnerf export` writes of a run or a survey: each has formats of its own.

A run is a radiance field: Gaussians fitted to it, and a page about it.  A survey is a line: layers of a map,
a cloud, a table.
"""

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Literal, get_args

from plnerf.errors import ConfigError
from plnerf.export.exports import Exports
from plnerf.export.formats import FORMATS, Format, write_formats
from plnerf.export.run_formats import (
    SIDECAR,
    SPLAT_FORMATS,
    SPLAT_NAMES,
    SplatFormat,
    splats_of,
    write_splats,
)
from plnerf.export.splat_config import SplatConfig
from plnerf.line.files import SURVEY_FILE, read_survey, survey_in
from plnerf.report.handout import write_handout
from plnerf.scene.only_writer import only_writer
from plnerf.scene.whole_result import whole_result
from plnerf.train.run import open_run

Page = Literal["html"]
AnyFormat = Format | SplatFormat | Page
RUN_FORMATS: tuple[str, ...] = (*SPLAT_FORMATS, *get_args(Page))
HANDOUT = "handout.html"
FOLDER = "export"
"""In that of a run, unless another one is given."""
Stage = Callable[[str, int, int], None]
"""Called with a stage's name, what is done of it, and of how much."""


def export_source(
    source: Path,
    formats: Sequence[AnyFormat] = (),
    out: Path | None = None,
    codes: Path | None = None,
    splats: SplatConfig | None = None,
    progress: Stage | None = None,
) -> Exports:
    """Writes a run or a survey in further formats; returns the files, and what was left out and why.

    formats: none: all that the source has what they need for.  codes: feature codes of PLS-CADD.  Raises
    ConfigError where the source is neither, or has not a format; other PlnerfErrors where it cannot be read
    or written.
    """
    if source.name == SURVEY_FILE or survey_in(source) is not None:
        do = "Give the folder of the run that it was made of,"
        chosen = _known(source, "a survey", formats, FORMATS, do)
        return export_survey(source, chosen or None, out, codes)  # type: ignore[arg-type]  # all FORMATS
    if (source / "config.json").is_file():
        survey = source / "survey"
        surveyed = survey_in(survey) is not None
        do = f"Give its survey, {survey}," if surveyed else f"Survey it, plnerf survey {source},"
        chosen = _known(source, "a run", formats, RUN_FORMATS, do)
        if codes is not None:
            raise ConfigError(f"{codes} holds codes of PLS-CADD, a format of surveys, but {source} is a run.")
        written = export_run(source, chosen or RUN_FORMATS, out, splats, progress)
        return Exports({path.name: path for path in written}, ())
    raise ConfigError(
        f"{source} is neither a run, which has a config.json, nor a survey, which has a {SURVEY_FILE}. Give "
        "the folder of one of these: plnerf train writes runs, plnerf survey writes surveys."
    )


def _known(source: Path, kind: str, formats: Sequence[str], known: Sequence[str], do: str) -> tuple[str, ...]:
    """The formats, each once.  Raises ConfigError for one of the other kind."""
    wrong = [one for one in formats if one not in known]
    if wrong:
        raise ConfigError(
            f"{source} is {kind}, with the formats {', '.join(known)}, but {', '.join(wrong)} was asked for. "
            f"{do} or leave --formats out."
        )
    return tuple(dict.fromkeys(formats))


def export_survey(
    folder: Path,
    formats: Sequence[Format] | None = None,
    out: Path | None = None,
    codes: Path | None = None,
) -> Exports:
    """Writes the survey of a folder in further formats, into `out` or the same folder; returns what was
    written, and what was left out and why.

    formats: None: all but those for which the survey lacks something.  codes: feature codes of PLS-CADD.
    Raises PlnerfError as `write_formats`.
    """
    root = folder.parent if folder.name == SURVEY_FILE else folder
    with only_writer(out or root):
        return write_formats(read_survey(root / SURVEY_FILE), root, out or root, formats, codes)


def export_run(
    folder: Path,
    formats: Sequence[str] = RUN_FORMATS,
    out: Path | None = None,
    config: SplatConfig | None = None,
    progress: Stage | None = None,
) -> list[Path]:
    """Writes Gaussians fitted to a run's field, and a page about the run; returns the files.

    out: None: `export` in the run's folder.  An earlier result there is replaced once the new one is
    complete; of the splats all files, since one sidecar is about them all.  Raises CheckpointError or
    ConfigError where the run has no weights, TrainingError where its field shows no surface.
    """
    report = progress or (lambda stage, done, total: None)
    config = config or SplatConfig()
    place = out or folder / FOLDER
    run = open_run(folder)
    splats: list[SplatFormat] = [one for one in SPLAT_FORMATS if one in formats]
    patterns = [*SPLAT_NAMES.values(), SIDECAR] * bool(splats) + [HANDOUT] * ("html" in formats)
    with only_writer(place):
        fitted = splats_of(run, config, report) if splats else None
        with whole_result(place, patterns) as new:
            written = write_splats(run, fitted, new, splats, config) if fitted is not None else []
            if "html" in formats:
                write_handout(new / HANDOUT, run, lambda done, total: report("page", done, total))
                written.append(new / HANDOUT)
    return [place / path.name for path in written]
