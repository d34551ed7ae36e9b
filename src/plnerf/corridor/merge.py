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
from plnerf.report.figures import runs_of

_NUMBER = re.compile(r"\d[\d.,]*")


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
    """The findings of the blocks, each with the spans that it is about; of several that differ in numbers
    alone the first."""
    texts: dict[tuple[str, str], list[tuple[Finding, BlockSurvey]]] = {}
    for block in blocks:
        for one in block.survey.findings:
            texts.setdefault((one.kind, _NUMBER.sub("#", one.what)), []).append((one, block))
    found = []
    for alike in texts.values():
        first = alike[0][0]
        same = [block for one, block in alike if one.what == first.what]
        others = [block for one, block in alike if one.what != first.what]
        what = f"{_named(same).capitalize()}: {first.what}"
        if others:
            what += f" The like is stated of {_named(others)}: see their reports."
        where = tuple(f"span {number}" for _, block in alike for number in block.spans)
        found.append(replace(first, what=what, where=where))
    lost = sorted(set(planned) - {k for its in spans.values() for k in its})
    if lost:
        what = f"{len(lost)} of {len(planned)} spans that were planned are in no block's survey."
        found.append(Finding("corridor", "harms", what, tuple(f"span {number}" for number in lost)))
    return tuple(found)


def _named(blocks: Sequence[BlockSurvey]) -> str:
    """The spans of some blocks, or the folders of blocks without any."""
    spans = [number for block in blocks for number in block.spans]
    if not spans:
        return ", ".join(block.folder.parent.name for block in blocks)
    return f"span{'s' * (len(spans) > 1)} {runs_of(spans)}"
