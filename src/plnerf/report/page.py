"""The survey's report: one HTML file that needs no network, and the same as JSON."""

import json
from importlib.resources import files
from pathlib import Path

from plnerf.report.data import Report
from plnerf.report.markup import Markup, bullets, joined, picture, safe, section, tag
from plnerf.report.profile import profile
from plnerf.report.scene_view import view
from plnerf.report.survey_json import survey_json
from plnerf.report.tables import cards, clearance_table, conductor_tables, protocol
from plnerf.report.words import caveats, found, judged, name_of, where
from plnerf.scene.files import write_text


def write_report(page: Path, content: Path, report: Report) -> None:
    """Writes the HTML page and the JSON file, each complete or absent.

    Raises SurveyError for a picture without pixels, PlnerfError where a file cannot be written.
    """
    write_text(page, html_page(report))
    write_text(content, json.dumps(survey_json(report), indent=1, allow_nan=False, ensure_ascii=False) + "\n")


def html_page(report: Report) -> str:
    """The whole page: everything it shows is inside of it."""
    sections = [
        ("summary", "Summary", _summary(report)),
        ("space", "In space", view(report)),
        ("profiles", "Profiles", _profiles(report)),
        ("clearances", "Clearances", clearance_table(report)),
        ("conductors", "Conductors", conductor_tables(report)),
        ("pictures", "Fitted wires over the photos", _pictures(report)),
        ("protocol", "Protocol", protocol(report)),
    ]
    title = f"Survey of {name_of(report.survey)}"
    links = tag("nav", tag("div", *(tag("a", name, href=f"#{id_}") for id_, name, _ in sections)))
    header = tag(
        "header", tag("h1", title), tag("p", found(report), class_="lead"),
        tag("p", where(report.survey), class_="place"),
    )  # fmt: skip
    main = tag("main", joined([section(*one) for one in sections]))
    style = files("plnerf").joinpath("data/report/page.css").read_text(encoding="utf-8")
    # An icon of its own, for browsers that would ask a server for one.
    return (
        '<!doctype html>\n<html lang="en"><head><meta charset="utf-8">'
        '<meta name="viewport" content="width=device-width, initial-scale=1"><link rel="icon" href="data:,">'
        f"<title>{safe(title)}</title><style>{style}</style></head>\n"
        f"<body>{joined([header, links, main])}</body></html>\n"
    )


def _summary(report: Report) -> Markup:
    notes = caveats(report)
    title = tag("h3", "What to know before using these figures")
    doubts = tag("div", title, bullets(notes), class_="caveats")
    return joined([tag("p", judged(report), class_="lead"), cards(report), doubts if notes else ""])


def _profiles(report: Report) -> Markup:
    if not report.survey.conductors:
        return tag("p", "Without conductors there is no span to draw.", class_="empty")
    return joined([joined([tag("h3", f"Span {span + 1}"), profile(report, span)]) for span in report.spans])


def _pictures(report: Report) -> Markup:
    if not report.pictures:
        return tag("p", "There are no photos to draw the wires on.", class_="empty")
    told = tag("p", "Each fitted wire is drawn as two thin lines: the wire itself shows between them.")
    shown = tag("div", *(picture(one.rgb, one.caption) for one in report.pictures), class_="pictures")
    return joined([told, shown])
