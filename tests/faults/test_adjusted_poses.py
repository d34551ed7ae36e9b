"""A scene whose poses are adjusted before its training: killed, the same command ends with the same poses."""

import json
from pathlib import Path

import pytest
from tests.faults.conftest import Undisturbed
from tests.faults.results import result
from tests.faults.small_reconstruct import log_of, run, stages_of
from tests.faults.test_kills import moments
from tests.support.flown_plane import write_flight

pytestmark = pytest.mark.faults

KILLS = 4
"""In each stage."""


@pytest.fixture(scope="module")
def flown(tmp_path_factory: pytest.TempPathFactory) -> Undisturbed:
    """A flight whose poses are off by 5 cm and 0.15 degrees."""
    folder = tmp_path_factory.mktemp("flown")
    write_flight(folder / "flown", off_m=0.05, off_deg=0.15)
    assert run(folder / "flown", folder / "out") == 0, log_of(folder / "out").read_text()
    assert json.loads((folder / "out" / "run" / "scene.json").read_text())["stated_centre"] is not None
    return Undisturbed(folder / "flown", stages_of(folder / "out"), result(folder / "out"))


@pytest.mark.parametrize("stage", ["first", "train"])
def test_a_killed_command_adjusts_them_alike(stage: str, flown: Undisturbed, out: Path) -> None:
    begun = flown.until(stage, out)
    for fault in moments(flown, stage, "kill", KILLS):
        status, printed = flown.disturbed(out, fault, begun=begun)
        assert status and stage in stages_of(out), (fault, printed)
        flown.check_again(out)
