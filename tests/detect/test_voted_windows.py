"""Along a further direction those windows are searched whose views vote for it."""

import numpy as np
from tests.support.drawn import pinhole_cameras

from plnerf.detect.config import DEFAULT
from plnerf.detect.directions import Direction, Votes, bins, no_votes
from plnerf.detect.views import Views, views_of
from plnerf.detect.voted_windows import voted_windows
from plnerf.detect.windows import windows_along

CONFIG = DEFAULT.directions
BEND = Direction(np.radians(8.5), 0.0, 10.0, 1.0)


def long_flight() -> Views:
    """Past 400 m, 1 m above each other two rows of views."""
    x = 2.0 * np.arange(200)
    centres = np.stack([x, np.full(200, -5.0), np.full(200, 10.0)], 1)
    return views_of(pinhole_cameras(centres, centres + np.array([0.0, 5.0, 0.0])))


def votes_at(views: Views, *rows: tuple[slice, float, float]) -> Votes:
    """Of some views for azimuths in degrees, so many pixels each."""
    votes = no_votes(views, CONFIG)
    azimuths = np.degrees(bins(CONFIG)[0])
    for some, azimuth, pixels in rows:
        votes.of_views[some, np.abs(azimuths - azimuth).argmin()] += pixels
    return votes


def test_windows_whose_views_vote_for_another_direction_are_left_out() -> None:
    views = long_flight()
    votes = votes_at(views, (slice(0, 100), 0.5, 500.0), (slice(100, 200), 8.5, 500.0))
    windows = voted_windows(BEND, views, votes, DEFAULT)
    every = list(windows_along(BEND, views, DEFAULT.windows))
    assert 0 < len(windows) < 0.7 * len(every)
    most = [(window.views >= 100).mean() for window in windows]
    assert min(most) > 0.3 and max(most) == 1.0
    left = {window.origin[0] for window in every} - {window.origin[0] for window in windows}
    assert max(left) < min(window.origin[0] for window in windows)


def test_a_direction_far_aside_takes_no_window_away() -> None:
    views = long_flight()
    crossing = (slice(0, 200), 60.5, 2000.0)
    votes = votes_at(views, (slice(0, 200), 8.5, 500.0), crossing)
    assert len(voted_windows(BEND, views, votes, DEFAULT)) == len(
        list(windows_along(BEND, views, DEFAULT.windows))
    )


def test_windows_without_votes_are_left_out_where_others_have_some() -> None:
    views = long_flight()
    votes = votes_at(views, (slice(0, 40), 8.5, 500.0))
    assert 0 < len(voted_windows(BEND, views, votes, DEFAULT)) < 8
    assert len(voted_windows(BEND, views, no_votes(views, CONFIG), DEFAULT)) > 8
