"""Surveys with other states, made up without a library: for tests of reports and exports."""

from dataclasses import replace

import numpy as np

from plnerf.line.ends import Quantity
from plnerf.line.states import Load, State, States, WireState
from plnerf.line.survey import Survey
from plnerf.line.wire import Wire

HOT = Load("75 °C", 75.0)
STORM = Load("storm <b>, to the left", 5.0, 400.0, 10.0, 600.0)


def with_states(survey: Survey) -> Survey:
    """Its phases hang 1.25 times as deep when hot, and swing by 0.5 to the left in a storm."""
    phases = [wire for wire in survey.wires if wire.kind == "phase" and wire.sag is not None]
    states = tuple(
        State(load, tuple(_state(wire, factor, swing) for wire in phases))
        for load, factor, swing in ((HOT, 1.25, 0.0), (STORM, 1.0, 0.5))
    )
    made_of = (("phase", "a conductor (a sheet)"),)
    return replace(survey, states=States(states, Quantity(31.0, 3.0), "given", made_of))


def _state(wire: Wire, factor: float, swing: float) -> WireState:
    theta = wire.theta * [1, 1, 1, 1, factor, 1] + [0, 0, 0, 0, 0, swing]
    hangs = replace(wire, theta=np.array(theta)).sag
    assert hangs is not None and wire.sag is not None
    return WireState(
        wire.id, theta, wire.covariance, Quantity(hangs.value, 0.04),
        Quantity(hangs.value - wire.sag.value, 0.03), Quantity(12345.0, 250.0), Quantity(13579.0, 260.0),
        0.157, 40.0,
    )  # fmt: skip
