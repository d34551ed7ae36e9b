"""Other states of a line as plain JSON values and back: a part of survey.json (`files.py`)."""

from collections.abc import Mapping
from dataclasses import asdict
from typing import Any

import numpy as np

from plnerf.line.ends import Quantity
from plnerf.line.states import Load, State, States, WireState


def states_row(found: States) -> dict[str, Any]:
    """NumPy's arrays are left for the caller to make plain."""
    return {
        "temperature_c": asdict(found.temperature_c),
        "temperature_from": found.temperature_from,
        "conductors": [list(one) for one in found.conductors],
        "states": [
            {"load": asdict(one.load), "wires": [asdict(wire) for wire in one.wires]} for one in found.states
        ],
    }


def states_of(row: Mapping[str, Any]) -> States:
    """The inverse of `states_row`.  Raises LookupError, TypeError or ValueError for what is none."""
    return States(
        states=tuple(
            State(Load(**one["load"]), tuple(_wire_state(wire) for wire in one["wires"]))
            for one in row["states"]
        ),
        temperature_c=Quantity(**row["temperature_c"]),
        temperature_from=row["temperature_from"],
        conductors=tuple((kind, name) for kind, name in row["conductors"]),
    )


def _wire_state(row: Mapping[str, Any]) -> WireState:
    lengths = {name: Quantity(**row[name]) for name in ("sag", "sag_change", "horizontal_n", "greatest_n")}
    arrays = {
        "theta": np.array(row["theta"], np.float64).reshape(6),
        "covariance": np.array(row["covariance"], np.float64).reshape(6, 6),
    }
    if not all(np.isfinite(one).all() for one in arrays.values()):
        raise ValueError("a state's curve holds numbers that are not finite")
    return WireState(**(dict(row) | lengths | arrays))
