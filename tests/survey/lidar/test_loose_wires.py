"""Pieces of wires beyond a structure: conductors, wherever no span is made of them; and no curve of a few
metres says where a structure's wires are."""

import numpy as np
import pytest
from tests.support import lidar_clouds as made

from plnerf.line.cloud import CONDUCTOR, NO_WIRE, SHIELD, UNCLASSIFIED
from plnerf.survey.lidar.config import LidarConfig
from plnerf.survey.lidar.find import find_lines
from plnerf.survey.lidar.parabola import Parabola
from plnerf.survey.lidar.spans import TrackSpan


@pytest.mark.parametrize("seed", [4, 5, 10])
@pytest.mark.parametrize("beyond_m", [7.0, 12.0])
def test_what_goes_on_beyond_a_structure_is_no_obstacle(beyond_m: float, seed: int) -> None:
    """Too short for a track: such pieces were unclassified, and so things beside every wire."""
    line = made.line(np.array([[0.0, 0.0], [110.0, 20.0], [215.0, 70.0]]), seed=seed)
    u = (line.feet[1] - line.feet[0])[:2]
    along = (line.xyz[:, :2] - line.feet[1][:2]) @ (u / np.linalg.norm(u))
    cut, truth = line.xyz[along < beyond_m], line.truth[along < beyond_m]
    found = find_lines(cut, LidarConfig()).cloud
    beyond = (along[along < beyond_m] > 4.0) & np.isin(truth, [SHIELD, CONDUCTOR])
    assert beyond.sum() > 20 and (found.label[beyond] == UNCLASSIFIED).mean() < 0.05
    assert set(found.wire[beyond]) <= {NO_WIRE}


@pytest.mark.parametrize(("beyond_m", "held"), [(-6.0, False), (3.0, True), (8.0, True)])
def test_a_structure_at_the_edge_of_a_cloud_holds_the_span(beyond_m: float, held: bool) -> None:
    """Where a cloud ended a few metres behind a tower, the span had no sag: "the cloud ends there"."""
    line = made.line(np.array([[0.0, 0.0], [110.0, 20.0], [215.0, 70.0]]), seed=7)
    along = line.xyz[:, :2] @ (line.feet[1][:2] / np.linalg.norm(line.feet[1][:2]))
    kept = along < np.linalg.norm(line.feet[1][:2]) + beyond_m
    (found,) = find_lines(line.xyz[kept], LidarConfig()).lines
    assert len(found.structures) == 1 + held
    assert {wire.sag is not None for wire in found.wires} == {held}


def test_short_tracks_at_the_other_end_do_not_say_where_a_span_ends() -> None:
    def track(low: float, high: float, slope: float) -> Parabola:
        none, u = np.zeros(2), np.array([1.0, 0.0])
        flat, rises = np.zeros(3), np.array([20.0, slope, 0.0])
        return Parabola(none, u, flat, rises, (low, high), 40, np.array([0.3, 0.3]))

    ends, along = (0.0, 200.0), np.array([1.0, 0.0])
    span = TrackSpan((track(*ends, 0.0), track(190.0, 205.0, 0.3)), np.zeros(2), along, ends)
    assert span.end(last=False)[:, 2].tolist() == [20.0]
    assert span.end(last=True)[:, 2].tolist() == [20.0, 80.0]
    alone = TrackSpan((track(190.0, 205.0, 0.3),), np.zeros(2), along, ends)
    assert alone.end(last=False)[:, 2].tolist() == [20.0]
