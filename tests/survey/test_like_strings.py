"""A structure at the end of a line, whose own place is known badly, stands where its strings lead to."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pytest

from plnerf.line.ends import Attached
from plnerf.line.hang import hang
from plnerf.line.line import Line, Span, Structure
from plnerf.line.wire import Wire
from plnerf.survey.config_spans import TensionStringConfig
from plnerf.survey.like_strings import with_like_strings
from plnerf.survey.tension_strings import about_string

CONFIG = TensionStringConfig()
SPAN_M, FREE = 40.0, 0.03
"""Standard deviation of a wire's own place at a structure."""


def end_of(structure: Structure, x: float, y: float, string_m: float | None) -> Attached:
    sigma = float(np.hypot(structure.sigma_m, FREE))
    return Attached(structure.id, np.array([x, y, 10.0]), sigma, string_m)


Strings = tuple[float | None, float | None]


def wire_of(id_: int, both: Sequence[Structure], y: float, strings: Strings) -> Wire:
    """From one structure to the other, or from string to string."""
    x = [float(one.foot[0]) for one in both]
    at = x[0] + (strings[0] or 0.0), x[1] - (strings[1] or 0.0)
    wire = hang((at[0], y, 10.0), (at[1], y, 10.0), 0.6)
    ends = [end_of(*one) for one in zip(both, at, (y, y), strings, strict=True)]
    notes = tuple(about_string(one, k) for k, one in enumerate(strings) if one)
    return replace(wire, id=id_, ends=(ends[0], ends[1]), notes=notes)


def attached(wire: Wire) -> list[Attached]:
    return [end for end in wire.ends if isinstance(end, Attached)]


def line_with(own_m: float, sigma_m: float = 0.6, others_m: float | None = 0.9) -> Line:
    """Two phases and a shield over two spans; the last structure, placed badly, has strings of `own_m`."""
    places = [(0.0, 0.04), (SPAN_M, 0.04), (2 * SPAN_M, sigma_m)]
    every = [
        Structure(k, np.array([x, 0.0, 0.0]), 12.0, sigma, "seen") for k, (x, sigma) in enumerate(places, 1)
    ]
    spans = []
    for k in range(2):
        both = every[k : k + 2]
        strings = (others_m, own_m if k else others_m)
        wires = [wire_of(3 * k + n, both, y, strings) for n, y in ((1, -2.0), (2, 2.0))]
        shield = replace(wire_of(3 * k + 3, both, 0.0, (None, None)), kind="shield")
        spans.append(Span(k + 1, (k + 1, k + 2), (*wires, shield)))
    return Line(1, tuple(every), tuple(spans))


def test_its_strings_are_as_long_as_the_others() -> None:
    (found,) = with_like_strings([line_with(0.7)], CONFIG)
    before, (first, second, last) = line_with(0.7), found.structures
    assert [first.foot[0], second.foot[0]] == [0.0, SPAN_M]
    sigma = np.hypot(CONFIG.sigma_m, CONFIG.alike_m)
    assert last.foot[0] == pytest.approx(2 * SPAN_M + 0.2, abs=0.02)
    assert 0.9 * sigma < last.sigma_m < sigma and "line's others" in last.evidence
    *phases, shield = found.spans[1].wires
    end, was = shield.ends[1], before.spans[1].wires[2].ends[1]
    assert isinstance(end, Attached) and isinstance(was, Attached)
    assert end.point[0] == pytest.approx(last.foot[0]) and end.sigma_m == pytest.approx(last.sigma_m, rel=0.1)
    ends_at = shield.points(np.array([0.0, shield.base.length_m]))[1]
    assert ends_at == pytest.approx(end.point)  # the curve goes on as far
    for wire, same in zip(phases, before.spans[1].wires, strict=False):
        end, was = wire.ends[1], same.ends[1]
        assert isinstance(end, Attached) and isinstance(was, Attached)
        assert end.point == pytest.approx(was.point) and end.sigma_m == pytest.approx(FREE)
        assert end.string_m == pytest.approx(0.9, abs=0.02) and about_string(0.9, 1) in wire.notes
        assert about_string(0.7, 1) not in wire.notes


@pytest.mark.parametrize(("own_m", "sigma_m", "others_m"), [
    (0.7, 0.05, 0.9), (2.5, 0.6, 0.9), (0.7, 0.6, 0.0), (0.7, 0.6, None), (0.0, 0.6, 0.9),
])  # fmt: skip
def test_else_it_stays_where_it_is(own_m: float, sigma_m: float, others_m: float | None) -> None:
    """Where it is known well, where its strings are of another kind, and where either has none."""
    line = line_with(own_m, sigma_m, others_m)
    (found,) = with_like_strings([line], CONFIG)
    assert found is line


def test_a_structure_between_spans_stays_where_kinks_show_it() -> None:
    line = line_with(0.7)
    loose = tuple(replace(one, sigma_m=0.6 if one.id == 2 else 0.04) for one in line.structures)

    def held(wire: Wire) -> Wire:
        ends = [replace(end, string_m=0.7 if end.structure == 2 else 0.9) for end in attached(wire)]
        return replace(wire, ends=(ends[0], ends[1]))

    spans = tuple(replace(span, wires=tuple(held(wire) for wire in span.wires)) for span in line.spans)
    line = replace(line, structures=loose, spans=spans)
    (found,) = with_like_strings([line], CONFIG)
    assert [one.foot[0] for one in found.structures] == [0.0, SPAN_M, 2 * SPAN_M]


def test_of_another_lines_structure_nothing_is_known_here() -> None:
    """A line that tees off ends at a structure that it does not list."""
    line = line_with(0.7)
    tee = replace(line, structures=line.structures[:2])
    (found,) = with_like_strings([tee], CONFIG)
    assert found is tee
