"""A report shows the verdict of every rule in every state, what was not judged and where numbers are from."""

from dataclasses import replace

from tests.support import surveys
from tests.support.rules import with_rules

from plnerf.report.page import html_page
from plnerf.report.rule_table import rule_summary, rule_tables
from plnerf.report.tables import Verdict

SURVEY = with_rules(surveys.short(0.05))


def test_the_worst_of_every_rule_and_state_comes_first() -> None:
    worst, every, missing, rules = rule_tables(SURVEY)
    assert [[str(cell).replace("\u00a0", " ") for cell in row[1:3]] for row in worst.rows] == [
        ["1: ground, vertical", "75 °C"], ["1: ground, vertical", "as surveyed"],
        ["2: building, horizontal", "as surveyed"],
    ]  # fmt: skip
    verdict = worst.rows[0][0]
    assert isinstance(verdict, Verdict) and (verdict.words, verdict.sign) == ("closer than required", "✕")
    assert worst.rows[0][5:8] == ["6.25\u202f±\u202f0.20", "6.50", "−0.25\u202f±\u202f0.20"]
    assert len(every.rows) == 4 and every.folded == "All 4 verdicts, by span"
    assert missing.rows == [["3: rail, vertical", "no rail of a map is given (--objects)"]]
    assert [row[6:9] for row in rules.rows][:2] == [
        ["a page <i>", "unverified", "farmland"], ["the standard", "with the standard", "–"]
    ]  # fmt: skip


def test_a_verdict_stands_beside_what_was_not_seen_of_its_span() -> None:
    worst, *_ = rule_tables(replace(SURVEY, coverage=surveys.half_seen().coverage))
    assert worst.columns[8] == "not seen at stations" and worst.rows[0][8] == "10 to 30\u00a0m"
    assert "not seen" not in rule_tables(SURVEY)[0].caption


def test_of_several_lines_a_span_has_its_lines_number() -> None:
    worst, *_ = rule_tables(with_rules(surveys.two_lines()))
    assert worst.columns[3] == "line / span" and worst.rows[0][3] == "1 / 1"


def test_the_summary_counts_verdicts() -> None:
    text = "a matrix at 220 kV: 3 verdicts, one of each rule in each state: 1 closer than required and 2"
    assert rule_summary(SURVEY) == f"{text} clear."
    page = html_page(SURVEY)
    assert text in page and "<h3>By rule</h3>" in page and "a page &lt;i&gt;" in page


def test_without_rules_there_is_nothing_of_them() -> None:
    survey = surveys.short(0.05)
    assert rule_tables(survey) == [] and rule_summary(survey) == ""
    assert "<h3>By rule</h3>" not in html_page(survey)
