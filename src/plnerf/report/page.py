"""The survey's report: one HTML file that needs nothing from elsewhere.

The page is `data/report/page.html`, a Jinja template; all that it shows is escaped unless it is made here of
numbers alone.
"""

from collections.abc import Sequence
from functools import cache
from importlib.resources import files as resources
from pathlib import Path

from jinja2 import Environment, PackageLoader, StrictUndefined

from plnerf.line.survey import Survey
from plnerf.report.coverage_view import coverage_tables
from plnerf.report.encroachment_table import (
    about_encroachments,
    encroachment_crops,
    encroachment_summary,
    encroachment_tables,
)
from plnerf.report.line_tables import crossing_table, span_table, structure_table
from plnerf.report.nearest import by_need, check_parts
from plnerf.report.overlay import shown_picture
from plnerf.report.page_tables import cards, clearance_tables, protocol, wire_tables
from plnerf.report.plan import plan
from plnerf.report.possible_view import possible_crops, possible_table
from plnerf.report.profile import profiles
from plnerf.report.quality import quality_table
from plnerf.report.rule_table import rule_summary, rule_tables
from plnerf.report.scene_view import view
from plnerf.report.state_table import state_tables
from plnerf.report.words import found, judged, name_of, no_states, sorted_caveats, where
from plnerf.scene.files import write_text

SECTIONS = {
    "summary": "Summary",
    "space": "In space",
    "plan": "Plan",
    "profiles": "Profiles",
    "coverage": "Coverage",
    "encroachments": "Encroachments",
    "clearances": "Clearances",
    "states": "Other states",
    "wires": "Wires",
    "structures": "Structures",
    "quality": "Quality",
    "pictures": "Fitted wires over the photos",
    "protocol": "Protocol",
}
"""Headings by the ids that links lead to."""


def write_report(
    path: Path, survey: Survey, files: Sequence[str] = (), about_files: Sequence[str] = ()
) -> None:
    """Writes the page, complete or not at all.

    files: names of what was written beside it; about_files: what their coordinates mean, and which were left
    out and why.  Raises SurveyError for a survey whose parts do not belong together or a picture without
    pixels, PlnerfError where the file cannot be written.
    """
    write_text(path, html_page(survey, files, about_files))


def html_page(survey: Survey, files: Sequence[str] = (), about_files: Sequence[str] = ()) -> str:
    """The whole page, as `write_report` writes it."""
    check_parts(survey)
    rows = by_need(survey)
    main, notes = sorted_caveats(survey)
    page: str = environment().get_template("page.html").render(
        title=f"Survey of {name_of(survey)}",
        sections=SECTIONS,
        style=asset("page.css"),
        script=asset("view.js"),
        found=found(survey),
        where=where(survey),
        judged=judged(rows),
        cards=cards(survey, rows),
        caveats=main,
        notes=notes,
        quality=quality_table(survey),
        view=view(survey, rows),
        plan=plan(survey),
        spans=span_table(survey),
        drawings=profiles(survey, rows),
        coverage=coverage_tables(survey),
        encroached=encroachment_summary(survey),
        encroachments=encroachment_tables(survey),
        about_encroachments=about_encroachments(survey),
        encroachment_crops=encroachment_crops(survey),
        clearances=clearance_tables(survey, rows),
        possible=possible_table(survey),
        crops=possible_crops(survey),
        crossings=crossing_table(survey),
        unscaled=survey.frame.unit == "unscaled",
        states=state_tables(survey),
        by_rule=rule_summary(survey),
        rules=rule_tables(survey),
        no_states=no_states(survey),
        wires=wire_tables(survey),
        structures=structure_table(survey),
        pictures=[shown_picture(one, survey.wires) for one in survey.pictures],
        protocol=protocol(survey, files, about_files),
    )  # fmt: skip
    return page


@cache
def environment() -> Environment:
    """The templates of the package's pages; what they show is escaped."""
    environment = Environment(
        loader=PackageLoader("plnerf", "data/report"),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
        keep_trailing_newline=True,
    )
    environment.policies["json.dumps_kwargs"] = {"separators": (",", ":"), "allow_nan": False}
    return environment


def asset(name: str) -> str:
    """The text of a style sheet or script of the pages."""
    return resources("plnerf").joinpath(f"data/report/{name}").read_text(encoding="utf-8")
