"""Other states of a line agree with mechaphlowers' engine, a hand computation and the cable's equations."""

import json
import math
from dataclasses import replace
from functools import cache
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from tests.support.cable_ode import Cable

from plnerf.line.ends import Attached, Open
from plnerf.line.hang import hang
from plnerf.line.line import Line, Span, Structure, StructureKind
from plnerf.line.states import Load, State, States
from plnerf.line.wire import Wire
from plnerf.mechanics import states as states_module
from plnerf.mechanics.conductor import Conductor, load_conductor
from plnerf.mechanics.config import MechanicsConfig
from plnerf.mechanics.states import compute_states
from plnerf.pipeline import bundled_span
from plnerf.score.truth import read_truth

pytest.importorskip("mechaphlowers", reason="plnerf[mechanics] is not installed")
ALST = Path("243-al1-39-st1a")
"""A conductor of the package."""


def line_of(*points: tuple[float, float], sags: list[float], kind: StructureKind = "suspension") -> Line:
    """One wire through spans between points (x, z); its ends are strain structures, the others of `kind`."""
    kinds: list[StructureKind] = ["strain", *[kind] * (len(points) - 2), "strain"]
    structures = tuple(
        Structure(k, np.array([x, 0.0, 0.0]), z, 0.1, "", kinds[k - 1]) for k, (x, z) in enumerate(points, 1)
    )
    spans = []
    for k, ((x0, z0), (x1, z1)) in enumerate(pairwise(points), 1):
        a, b = np.array([x0, 0.0, z0]), np.array([x1, 0.0, z1])
        ends = (Attached(k, a, 0.0), Attached(k + 1, b, 0.0))
        spans.append(Span(k, (k, k + 1), (hang(a, b, sags[k - 1], id=k, ends=ends),)))
    return Line(1, structures, tuple(spans))


def computed(line: Line, tmp: Path, *states: str, conductor: Path = ALST, at: float = 20.0) -> list[State]:
    """The states of a line that was surveyed with its conductors at some degrees; TOML of each state."""
    path = tmp / "states.toml"
    text = "\n".join(f"[[state]]\nname = 'state {k}'\n{one}\n" for k, one in enumerate(states))
    path.write_text(text, encoding="utf-8")
    found, _ = compute_states([line], at, MechanicsConfig(conductor, states=path, temperature_sigma_c=0.0))
    assert found is not None
    return list(found.states)


def written(path: Path, of: Conductor) -> Path:
    """A conductor's file."""
    names = ("name", "source", "weight_n_m", "diameter_mm", "area_mm2", "modulus_gpa", "expansion_per_k")
    path.write_text("\n".join(f"{name} = {json.dumps(getattr(of, name))}" for name in names))
    return path


RTE = Conductor("default_cable_array", "mechaphlowers' tests", 0.974 * 9.81, 22.4, 345.55, 59.0, 23e-6)
"""Of the conductor of mechaphlowers' own examples, whose kilogram weighs 9.81 N."""


@cache
def engine(spans: tuple[float, ...], heights: tuple[float, ...], p: float, string_m: float) -> Any:
    """mechaphlowers' engine of a section with p at 15 degrees, and strings of a length at suspensions."""
    import pandas as pd
    from mechaphlowers import CableArray, SectionArray, SectionStudy

    n = len(heights)
    inner = [False, *[True] * (n - 2), False]
    section = SectionArray(
        pd.DataFrame({
            "name": [str(k) for k in range(n)], "suspension": inner,
            "conductor_attachment_altitude": list(heights), "crossarm_length": [0.0] * n,
            "line_angle": [0.0] * n,
            "insulator_length": [string_m if one else 0.01 for one in inner],
            "span_length": [*spans, np.nan], "insulator_mass": [1.0 if one else 0.0 for one in inner],
        }),
        sagging_parameter=p, sagging_temperature=15,
    )  # fmt: skip
    names = [f"{letter}{k}" for letter in "ab" for k in range(5)]
    cable = CableArray(
        pd.DataFrame({
            "section": [RTE.area_mm2], "diameter": [RTE.diameter_mm], "linear_mass": [0.974],
            "young_modulus": [59000], "dilatation_coefficient": [23e-6], "temperature_reference": [15],
            **{name: [59000 if name == "a1" else 0] for name in names}, "diameter_heart": [0.0],
            "section_conductor": [RTE.area_mm2], "section_heart": [0.0], "solar_absorption": [0.9],
            "emissivity": [0.8], "electric_resistance_20": [0.0554],
            "linear_resistance_temperature_coef": [0.0036], "is_polynomial": [False],
            "radial_thermal_conductivity": [1.0], "has_magnetic_heart": [False],
        })
    )  # fmt: skip
    study = SectionStudy(cable, section)
    study.solve_adjustment()
    return study


def by_engine(
    spans: tuple[float, ...], heights: tuple[float, ...], p: float, string_m: float, **state: float
) -> np.ndarray:
    """p of each span in a state."""
    study = engine(spans, heights, p, string_m)
    study.solve_change_state(**state)
    parameter = study.balance_engine.span_model.parameter[:-1]
    assert isinstance(parameter, np.ndarray)
    return parameter


EXAMPLE = line_of((0.0, 30.0), (480.0, 40.0), sags=[14.4])


def hung(p: float) -> Line:
    """mechaphlowers' example of one span, with p in place of its sag."""
    wire = EXAMPLE.spans[0].wires[0]
    theta = wire.theta.copy()
    theta[4] = 480.0**2 / (8 * p)
    return replace(EXAMPLE, spans=(replace(EXAMPLE.spans[0], wires=(replace(wire, theta=theta),)),))


@pytest.mark.parametrize(
    ("toml", "state"),
    [
        ("temperature_c = 90", {"new_temperature": 90.0}),
        (
            "temperature_c = 90\nwind_pa = 200\nwind_to = 'left'",
            {"new_temperature": 90.0, "wind_pressure": 200.0},
        ),
        (
            "temperature_c = -10\nice_mm = 10\nice_kg_m3 = 611.83\nwind_pa = 200\nwind_to = 'left'",
            {"new_temperature": -10.0, "wind_pressure": 200.0, "ice_thickness": 0.01},
        ),
    ],
)  # fmt: skip
def test_the_example_of_one_span_agrees_with_mechaphlowers_engine(
    tmp_path: Path, toml: str, state: dict[str, float]
) -> None:
    """480 m with 10 m of rise, p = 2000 m at 15 degrees (its fixture `default_section_array_one_span`)."""
    line = hung(2000.0)
    (found,) = computed(line, tmp_path, toml, conductor=written(tmp_path / "c.toml", RTE), at=15.0)
    p = by_engine((480.0,), (30.0, 40.0), 2000.0, 0.01, **state)
    wire = found.wires[0].of(line.spans[0].wires[0])
    expected = wire.theta.copy()
    expected[4] = 480.0**2 / (8 * p[0])
    assert abs(wire.theta[4] - expected[4]) < 0.01  # metres of sag
    assert wire.sag is not None
    assert abs(wire.sag.value - replace(wire, theta=expected).sag.value) < 0.01  # type: ignore[union-attr]


def test_a_section_over_suspensions_agrees_with_mechaphlowers_engine(tmp_path: Path) -> None:
    """500, 300 and 400 m: strings that are long and light hand on the tension, as a ruling span supposes."""
    spans, heights = (500.0, 300.0, 400.0), (50.0, 50.0, 50.0, 50.0)
    at = np.concatenate([[0.0], np.cumsum(spans)])
    line = line_of(*zip(at.tolist(), heights, strict=True), sags=[a**2 / 16000 for a in spans])
    level = [replace(one, wires=(_with_p(one.wires[0], 2000.0),)) for one in line.spans]
    line = replace(line, spans=tuple(level))
    (found,) = computed(
        line, tmp_path, "temperature_c = 75", conductor=written(tmp_path / "c.toml", RTE), at=15.0
    )
    p = by_engine(spans, heights, 2000.0, 40.0, new_temperature=75.0)
    for one, span, theirs in zip(found.wires, spans, p, strict=True):
        sag, expected = one.sag.value, theirs * (math.cosh(span / (2 * theirs)) - 1)
        assert abs(sag - expected) < 0.01 + 0.004 * expected, (span, sag, expected)


def _with_p(wire: Wire, p: float) -> Wire:
    theta = wire.theta.copy()
    theta[4] = wire.base.length_m**2 / (8 * p)
    return replace(wire, theta=theta)


def by_hand(span: float, H: float, w: float, ea: float, strain: float) -> float:
    """Horizontal tension in a level span by the parabola's change of state, bisected:

    H2^2 (H2 - H1 + EA w^2 a^2 / 24 H1^2 + EA alpha dt) = EA w^2 a^2 / 24
    """
    k = ea * w**2 * span**2 / 24
    low, high = 0.01 * H, 10 * H
    for _ in range(100):
        middle = (low + high) / 2
        low, high = (
            (middle, high) if middle**2 * (middle - H + k / H**2 + ea * strain) < k else (low, middle)
        )
    return low


def test_a_level_span_agrees_with_the_equation_by_hand(tmp_path: Path) -> None:
    of = load_conductor(ALST)
    line = line_of((0.0, 20.0), (200.0, 20.0), sags=[4.0])
    hot, cold = computed(line, tmp_path, "temperature_c = 75", "temperature_c = -20")
    p = line.spans[0].wires[0].plane[2]
    for found, dt in ((hot, 55.0), (cold, -40.0)):
        H = by_hand(200.0, p * of.weight_n_m, of.weight_n_m, of.ea_n, of.expansion_per_k * dt)
        assert abs(found.wires[0].sag.value - of.weight_n_m * 200.0**2 / (8 * H)) < 0.01
        assert found.wires[0].horizontal_n.value == pytest.approx(H, rel=2e-3)


def test_three_spans_change_as_their_ruling_span(tmp_path: Path) -> None:
    """Their tensions change by one ratio, which is that of a span of sqrt(sum L^3 / sum L)."""
    line = line_of((0, 20.0), (150, 20.0), (400, 20.0), (600, 20.0), sags=[1.5, 4.17, 2.67])
    (found,) = computed(line, tmp_path, "temperature_c = 75")
    ruling = math.sqrt((150**3 + 250**3 + 200**3) / 600)
    assert all(one.ruling_span_m == pytest.approx(ruling) for one in found.wires)
    tension = [wire.plane[2] * load_conductor(ALST).weight_n_m for wire in line.wires]
    ratios = [one.horizontal_n.value / H for one, H in zip(found.wires, tension, strict=True)]
    np.testing.assert_allclose(ratios, ratios[0], rtol=1e-9)
    one_span = line_of((0, 20.0), (ruling, 20.0), sags=[ruling**2 / (8 * 1875)])
    (alone,) = computed(one_span, tmp_path, "temperature_c = 75")
    H = one_span.spans[0].wires[0].plane[2] * load_conductor(ALST).weight_n_m
    assert ratios[0] == pytest.approx(alone.wires[0].horizontal_n.value / H, rel=2e-3)
    apart = computed(replace(line, structures=_strain(line)), tmp_path, "temperature_c = 75")[0]
    assert len({round(one.ruling_span_m) for one in apart.wires}) == 3  # each span for itself
    assert abs(apart.wires[0].sag.value - found.wires[0].sag.value) > 0.05


def _strain(line: Line) -> tuple[Structure, ...]:
    return tuple(replace(one, kind="strain") for one in line.structures)


@cache
def truths(D: float, h: float, sag: float, load: Load) -> tuple[float, np.ndarray]:
    """Sag in a state and its curve by the cable's equations, of a span with `sag` at 20 degrees."""
    of = load_conductor(ALST)
    cable = Cable(D, h, of.weight_n_m, of.ea_n, of.expansion_per_k)
    diameter, ice = of.diameter_mm / 1e3, load.ice_mm / 1e3
    forces = (
        load.wind_pa * (diameter + 2 * ice), load.ice_kg_m3 * 9.80665 * math.pi * ice * (ice + diameter)
    )  # fmt: skip
    curve = cable.hang(cable.length_of_sag(sag, 20.0), load.temperature_c, forces)
    return cable.sag(curve), curve


@pytest.mark.parametrize(
    ("D", "h", "sag"), [(40.0, 1.0, 1.4), (300.0, 0.0, 8.0), (400.0, 60.0, 14.0)]
)  # fmt: skip
def test_states_agree_with_the_cables_equations(tmp_path: Path, D: float, h: float, sag: float) -> None:
    """Level and steep spans, hot, and in wind with ice: whole curves to 1 cm, and 3 cm over 60 m of rise."""
    line = line_of((0.0, 20.0), (D, 20.0 + h), sags=[sag])
    hot, blown = computed(
        line, tmp_path, "temperature_c = 75",
        "temperature_c = -5\nice_mm = 8\nwind_pa = 300\nwind_to = 'left'",
    )  # fmt: skip
    for found in (hot, blown):
        expected, (x, y, z) = truths(D, h, sag, found.load)
        curve = found.wires[0].of(line.spans[0].wires[0]).points(x)
        assert abs(found.wires[0].sag.value - expected) < (0.01 if h < 50 else 0.03)
        off = np.hypot(curve[:, 1] - y, curve[:, 2] - 20.0 - z)
        assert off.max() < (0.01 if h < 50 else 0.05), off.max()
    assert blown.wires[0].of(line.spans[0].wires[0]).at(np.array([D / 2]))[0, 0] > 0.1  # to the left


def test_a_state_as_surveyed_changes_nothing_and_is_as_certain(tmp_path: Path) -> None:
    """Both what is unknown of the conductor and the temperature drop out."""
    line = line_of((0.0, 20.0), (300.0, 25.0), sags=[8.0])
    wire = replace(line.spans[0].wires[0], covariance=np.diag([0.02, 0.03, 0.01, 0.02, 0.03, 0.0]) ** 2)
    line = replace(line, spans=(replace(line.spans[0], wires=(wire,)),))
    (found,) = computed(line, tmp_path, "temperature_c = 20")
    one = found.wires[0]
    np.testing.assert_allclose(one.theta, wire.theta, atol=1e-7)
    np.testing.assert_allclose(one.covariance, wire.covariance, atol=1e-7)
    assert wire.sag is not None and one.sag.sigma == pytest.approx(wire.sag.sigma, rel=1e-3)
    assert abs(one.sag_change.value) < 1e-7 and one.sag_change.sigma < 1e-4


def test_intervals_hold_over_surveys_with_errors(tmp_path: Path) -> None:
    """400 surveys of one span whose curve, ends, temperature and conductor are off as is stated of them."""
    from plnerf.mechanics.change_of_state import SectionModel

    rng = np.random.default_rng(7)
    of = load_conductor(ALST)
    true = line_of((0.0, 20.0), (300.0, 25.0), sags=[8.0]).spans[0].wires[0]
    spread = np.diag([0.02, 0.03, 0.03, 0.02, 0.05, 0.0]) ** 2
    ends_m, degrees = 0.08, 3.0
    model = SectionModel((true.base,), Load("hot", 75.0), of.diameter_mm, (True,))
    m = np.array([20.0, of.weight_n_m, of.ea_n, of.expansion_per_k])

    def hot_sag(theta: np.ndarray, ends: np.ndarray, m: np.ndarray) -> float:
        spans = model.spans(theta[None], ends)
        return float(model.outputs(spans, m, model.solve(spans, m))[0, 6])

    off, truth = [], hot_sag(true.theta, np.zeros((1, 2)), m)
    relative = np.array([of.weight_sigma, of.modulus_sigma, of.expansion_sigma])
    line = line_of((0.0, 20.0), (300.0, 25.0), sags=[8.0])
    stated = _surveyed(line, spread, ends_m)
    (state,) = _states(stated, degrees).states[1:2]
    for _ in range(400):
        theta = rng.multivariate_normal(true.theta, spread)
        ends = rng.normal(0, ends_m, (1, 2))
        guessed = m * np.array([1.0, *(1 + rng.normal(0, relative))]) + [rng.normal(0, degrees), 0, 0, 0]
        off.append(hot_sag(theta, ends, guessed) - truth)
    assert state.load.temperature_c == 75.0
    assert np.std(off) == pytest.approx(state.wires[0].sag.sigma, rel=0.15)
    assert np.mean(np.abs(off) < state.wires[0].sag.half_95) > 0.92


def _surveyed(line: Line, covariance: np.ndarray, ends_m: float) -> Line:
    wire = line.spans[0].wires[0]
    ends = tuple(replace(end, sigma_m=ends_m) for end in wire.ends if isinstance(end, Attached))
    wire = replace(wire, covariance=covariance, ends=(ends[0], ends[1]))
    return replace(line, spans=(replace(line.spans[0], wires=(wire,)),))


def _states(line: Line, degrees: float) -> States:
    found, _ = compute_states([line], 20.0, MechanicsConfig(ALST, temperature_sigma_c=degrees))
    assert found is not None
    return found


def test_the_bundled_spans_true_sag_at_75_degrees_is_within_its_interval() -> None:
    """Of every phase, surveyed as well as the demo does: the truth is by the cable's own equations."""
    truth_of = read_truth(bundled_span() / "truth.json")
    rng, of = np.random.default_rng(3), load_conductor(ALST)
    for number, row in enumerate(one for one in truth_of.wires if one.kind == "phase"):
        D, h = row.base.length_m, float(row.theta[3] - row.theta[2])
        assert row.sag is not None
        cable = Cable(D, h, of.weight_n_m, of.ea_n, of.expansion_per_k)
        truth = cable.sag(cable.hang(cable.length_of_sag(row.sag.value, 20.0), 75.0))
        spread = np.diag([0.005, 0.005, 0.004, 0.004, 0.004, 0.0]) ** 2
        seen = replace(row, theta=rng.multivariate_normal(row.theta, spread))
        (a, b) = seen.points(np.array([0.0, D]))
        structures = (Structure(1, a * [1, 1, 0], 10.0, 0.1, "", "terminal"),
                      Structure(2, b * [1, 1, 0], 10.0, 0.1, "", "terminal"))  # fmt: skip
        line = _surveyed(Line(1, structures, (Span(1, (1, 2), (seen,)),)), spread, 0.15)
        one = _states(line, 3.0).states[1].wires[0]
        assert abs(one.sag.value - truth) < one.sag.half_95, (number, one.sag, truth)
        assert one.sag.half_95 < 0.2 and one.sag.value > row.sag.value + 0.2


def test_what_is_missing_is_said(monkeypatch: pytest.MonkeyPatch) -> None:
    line = line_of((0.0, 20.0), (200.0, 20.0), sags=[4.0])

    def without(temperature_c: float | None, config: MechanicsConfig) -> str:
        found, findings = compute_states([line], temperature_c, config)
        assert found is None and len(findings) == 1
        return findings[0].text

    assert "no conductor is given. Give --conductor" in without(20.0, MechanicsConfig())
    no_temperature = without(None, MechanicsConfig(ALST))
    assert "temperature at the survey is not known. Give --temperature-c" in no_temperature
    monkeypatch.setattr(states_module, "find_spec", lambda name: None)
    assert 'mechaphlowers is not installed. Install it: pip install "plnerf[mechanics]"' in without(
        20.0, MechanicsConfig(ALST)
    )


def test_wires_without_a_state_are_named_with_the_reason() -> None:
    line = line_of((0.0, 20.0), (200.0, 20.0), (400.0, 20.0), sags=[4.0, 4.0])
    first, second = line.spans
    held = second.wires[0].ends[0]
    cut = replace(second.wires[0], ends=(held, Open("not filmed")))
    shield = replace(first.wires[0], id=9, kind="shield")
    line = replace(line, spans=(replace(first, wires=(*first.wires, shield)), replace(second, wires=(cut,))))
    found, findings = compute_states([line], 20.0, MechanicsConfig(ALST))
    assert found is not None and [one.wire for one in found.states[0].wires] == [1]
    texts = " ".join(one.text for one in findings)
    assert "Of wire 9 no other state is known: no conductor is given for shield wires." in texts
    assert "Of wire 2 no other state is known: the last end is open (not filmed)." in texts
    assert "beyond structure 2 (suspension)" in texts


def test_where_no_wire_has_a_state_the_findings_are_the_reasons() -> None:
    line = line_of((0.0, 20.0), (200.0, 20.0), sags=[4.0])
    wire = line.spans[0].wires[0]
    cut = replace(wire, ends=(wire.ends[0], Open("not filmed")))
    line = replace(line, spans=(replace(line.spans[0], wires=(cut,)),))
    found, findings = compute_states([line], 20.0, MechanicsConfig(ALST))
    assert found is not None and not any(one.wires for one in found.states)
    texts = [one.text for one in findings]
    assert texts == ["Of wire 1 no other state is known: the last end is open (not filmed)."]


def test_a_state_that_no_tension_answers_is_a_finding(monkeypatch: pytest.MonkeyPatch) -> None:
    """Where tensions may not change by more than 0.1 %: those of a span with next to no sag do not."""
    from plnerf.mechanics import change_of_state

    monkeypatch.setattr(change_of_state, "MOST_RATIO", 1.001)
    line = line_of((0, 20.0), (150, 20.0), (400, 20.0), sags=[1.5, 4.17], kind="strain")
    first, second = line.spans
    taut = replace(line, spans=(replace(first, wires=(_with_p(first.wires[0], 1e9),)), second))
    found, findings = compute_states([taut], 20.0, MechanicsConfig(ALST))
    assert found is not None
    assert [[one.wire for one in state.wires] for state in found.states] == [[1], [1], [1]]
    texts = [one.text for one in findings if "No tension answers the state" in one.text]
    assert len(texts) == 3 and texts[0].startswith("Wire 2: No tension answers the state '50 °C' (50 °C)")


def test_structures_named_strain_end_a_section(tmp_path: Path) -> None:
    line = line_of((0, 20.0), (150, 20.0), (400, 20.0), sags=[1.5, 4.17])
    path = tmp_path / "s.toml"
    path.write_text("strain = [2, 9]\n[[state]]\nname = 'hot'\ntemperature_c = 75\n")
    found, findings = compute_states([line], 20.0, MechanicsConfig(ALST, states=path))
    assert found is not None
    assert any("strain = [9] of the file of the states names structures" in one.text for one in findings)
    assert [round(one.ruling_span_m) for one in found.states[0].wires] == [150, 250]


def test_what_is_taken_of_structures_and_shield_wires_is_said() -> None:
    """A structure of unknown kind counts as a suspension, a shield wire as warm as the phases."""
    line = line_of((0, 20.0), (150, 20.0), (400, 20.0), sags=[1.5, 4.17], kind="unknown")
    found, findings = compute_states([line], 20.0, MechanicsConfig(ALST, Path("steel-3-8-ehs")))
    assert found is not None and len({round(one.ruling_span_m) for one in found.states[0].wires}) == 1
    texts = " ".join(one.text for one in findings)
    assert "The kind of structure 2 is not known" in texts and "as warm as the phases" in texts
    known = line_of((0, 20.0), (150, 20.0), (400, 20.0), sags=[1.5, 4.17])
    _, findings = compute_states([known], 20.0, MechanicsConfig(ALST))
    assert not any("is not known" in one.text or "as warm" in one.text for one in findings)


def test_wind_comes_from_the_lines_left_whichever_way_a_wire_runs(tmp_path: Path) -> None:
    line = line_of((0, 20.0), (200, 20.0), (400, 20.0), sags=[4.0, 4.0])
    second = line.spans[1].wires[0]
    a, b = second.points(np.array([0.0, 200.0]))
    turned = hang(b, a, 4.0, id=2, ends=(second.ends[1], second.ends[0]))
    line = replace(line, spans=(line.spans[0], replace(line.spans[1], wires=(turned,))))
    left, right = computed(line, tmp_path, "temperature_c = 10\nwind_pa = 300")
    assert (left.load.name, right.load.name) == ("state 0, to the left", "state 0, to the right")
    for found, side in ((left, 1.0), (right, -1.0)):
        for wire, one in zip(line.wires, found.wires, strict=True):
            assert side * float(one.of(wire).points(np.array([100.0]))[0, 1]) > 1.0  # +y is left of the line


def test_ieee_738s_example_has_its_temperature() -> None:
    """Drake, 40 degrees, 0.61 m/s across, 1025 A, 22.4 W/m of sun: 100 degrees (IEEE 738-2012, annex A)."""
    pytest.importorskip("linerate", reason="plnerf[mechanics] is not installed")
    from plnerf.mechanics.loads import Weather
    from plnerf.mechanics.temperature import conductor_temperature

    sun = 22.4 / (0.8 * 0.02814)
    weather = Weather(1025.0, 40.0, 0.61, 90.0, sun, 0.0, 4.0)
    drake = load_conductor(Path("acsr-drake"))
    assert conductor_temperature(drake, weather) == pytest.approx(100.0, abs=1.0)
    along = conductor_temperature(drake, replace(weather, wind_angle_deg=0.0))
    assert along > conductor_temperature(drake, weather) + 10  # wind along the line cools less
