"""One line of the surveys of a corridor's blocks: each span out of its own block, structures shared."""

import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from plnerf.findings import Finding
from plnerf.line.cloud import Cloud
from plnerf.line.coverage import Coverage
from plnerf.line.files import SURVEY_FILE, read_survey
from plnerf.line.frame import LineFrame
from plnerf.line.line import Line, Span, Structure
from plnerf.line.move import move_wire
from plnerf.line.survey import Survey
from plnerf.line.wire import Wire

MOST_ALIKE = 3
"""Findings that differ in numbers alone, of so many blocks each."""
_NUMBER = re.compile(r"\d+(?:\.\d+)?")


@dataclass(frozen=True, eq=False)
class BlockSurvey:
    """The survey of a block, without the points of its cloud."""

    folder: Path
    survey: Survey
    spans: tuple[int, ...]
    """Numbers of its own spans."""

    def own(self) -> Iterator[tuple[Line, Span]]:
        """Its own spans, with their lines."""
        return ((line, span) for line in self.survey.lines for span in line.spans if span.id in self.spans)


def read_blocks(folders: Mapping[Path, Sequence[int]]) -> tuple[BlockSurvey, ...]:
    """The surveys in some folders, with the numbers of the spans that are each one's own."""
    return tuple(
        BlockSurvey(folder, read_survey(folder / SURVEY_FILE), tuple(spans))
        for folder, spans in folders.items()
    )


def merged(
    blocks: Sequence[BlockSurvey], planned: Sequence[int], frame: LineFrame, source: str,
    made: Mapping[str, str],
) -> Survey:  # fmt: skip
    """The survey of the whole corridor in one frame: lines, coverage, findings.

    planned: numbers of all spans that it should have.  Cloud, clearances and pictures stay with the blocks.
    A structure that two blocks show is where the one that knows it better has it.
    """
    structures: dict[int, dict[int, Structure]] = {}
    spans: dict[int, dict[int, Span]] = {}
    detected: dict[int, Wire] = {}
    coverage: list[Coverage] = []
    for block in blocks:
        old = block.survey.frame
        detected |= {wire.id: move_wire(wire, old, frame) for wire in block.survey.detected}
        for line, span in block.own():
            wires = tuple(move_wire(wire, old, frame) for wire in span.wires)
            spans.setdefault(line.id, {})[span.id] = replace(span, wires=wires)
            its = structures.setdefault(line.id, {})
            for one in line.structures:
                if one.id in span.structures:
                    its[one.id] = _better(its.get(one.id), _moved(one, old, frame))
        coverage += [one for one in block.survey.coverage if one.span in block.spans]
    lines = tuple(
        Line(
            number,
            tuple(of for _, of in sorted(structures.get(number, {}).items())),
            tuple(of for _, of in sorted(its.items())),
        )
        for number, its in sorted(spans.items())
    )
    first = blocks[0].survey if blocks else None
    return Survey(
        frame, lines, Cloud.empty(), source, made,
        settings={} if first is None else first.settings,
        coverage=tuple(sorted(coverage, key=lambda one: one.span)),
        findings=_findings(blocks, planned, spans),
        report_units="metres" if first is None else first.report_units,
        temperature_c=None if first is None else first.temperature_c,
        detected=tuple(detected[wire.id] for line in lines for wire in line.wires if wire.id in detected),
        from_images=first is not None and first.from_images,
    )  # fmt: skip


def _moved(one: Structure, old: LineFrame, new: LineFrame) -> Structure:
    factor, R, shift = new.from_frame(old)
    return replace(
        one, foot=factor * R @ one.foot + shift, height_m=factor * one.height_m, sigma_m=factor * one.sigma_m
    )


def _better(one: Structure | None, other: Structure) -> Structure:
    """The one whose place is known better, with the kind and the angle that either knows."""
    if one is None:
        return other
    better, worse = sorted((one, other), key=lambda it: it.sigma_m)
    return replace(
        better,
        kind=worse.kind if better.kind == "unknown" else better.kind,
        line_angle_deg=worse.line_angle_deg if better.line_angle_deg is None else better.line_angle_deg,
        name=better.name or worse.name,
    )


def _findings(
    blocks: Sequence[BlockSurvey], planned: Sequence[int], spans: Mapping[int, Mapping[int, Span]]
) -> tuple[Finding, ...]:
    """Those of the blocks, each with the spans that it is about; the first ones of many that differ in
    numbers alone."""
    texts: dict[tuple[str, str], dict[str, list[BlockSurvey]]] = {}
    first: dict[str, Finding] = {}
    for block in blocks:
        for one in block.survey.findings:
            alike = texts.setdefault((one.kind, _NUMBER.sub("#", one.what)), {})
            alike.setdefault(one.what, []).append(block)
            first.setdefault(one.what, one)
    found: dict[tuple[str, str], Finding] = {}
    for key, alike in texts.items():
        shown = list(alike.items())[:MOST_ALIKE]
        for what, its in shown:
            spans_of = [number for block in its for number in block.spans]
            where = tuple(f"span {number}" for number in spans_of)
            found[key[0], what] = replace(first[what], what=f"{_named(spans_of, its)}: {what}", where=where)
        if len(alike) > MOST_ALIKE:
            what = f"The like is stated of {len(alike) - MOST_ALIKE} more blocks: see their reports."
            found[key[0], key[1]] = replace(first[shown[0][0]], what=what, where=(), do="")
    lost = sorted(set(planned) - {k for its in spans.values() for k in its})
    if lost:
        what = f"{len(lost)} of {len(planned)} spans that were planned are in no block's survey."
        where = tuple(f"span {number}" for number in lost)
        found["corridor", what] = Finding("corridor", "harms", what, where)
    return tuple(found.values())


def _named(spans: Sequence[int], blocks: Sequence[BlockSurvey]) -> str:
    """The spans of a finding, or the folders of blocks without any."""
    if not spans:
        return ", ".join(block.folder.parent.name for block in blocks)
    return f"Span{'s' * (len(spans) > 1)} {', '.join(map(str, spans))}"
