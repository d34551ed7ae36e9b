"""Which plants are said to be shown by images, against depths made by hand."""

from dataclasses import replace

import numpy as np
import pytest

from plnerf.synth.capture import View, look
from plnerf.synth.flight_config import CaptureConfig
from plnerf.synth.near_plants import NearLeaf, filmed_plants

CAPTURE = CaptureConfig(width_px=120, height_px=80, focal_px=100.0)
VIEWS = [View(f"{i:04d}", "right", look(np.pi / 2, 0.0, 0.0), np.array([x, -20.0, 5.0]))
         for i, x in enumerate((-3.0, -2.0, -1.0, 1.0, 2.0, 3.0))]  # fmt: skip
"""Along x, looking along y at what stands 20 m away; from end to end 17 degrees."""
TREE = NearLeaf(2.0, "phase A", np.array([0.0, 0.0, 5.0]))


def wall(at_m: float, hidden_px: tuple[int, int] = (0, 120), views: int = 6):
    """Depth 30 m, and nearer in a band of columns of the first views."""

    def depth_of(view: View) -> np.ndarray:
        depth = np.full((80, 120), 30.0)
        if int(view.name) < views:
            depth[:, slice(*hidden_px)] = at_m
        return depth

    return depth_of


def shown(depth_of, views=VIEWS, leaf: NearLeaf = TREE) -> bool | None:
    ((found,),) = filmed_plants([(leaf,)], views, depth_of, CAPTURE)
    return found.observable


def test_what_six_views_show_from_different_sides_is_observable() -> None:
    assert shown(wall(30.0)) is True
    assert shown(wall(0.0)) is True  # before the sky
    assert shown(wall(30.0), VIEWS[:5]) is False
    near = [replace(view, centre=view.centre * [0.5, 1, 1]) for view in VIEWS]  # 8.6 degrees
    assert shown(wall(30.0), near) is False


def test_what_stands_before_it_hides_it() -> None:
    assert shown(wall(19.4)) is False
    assert shown(wall(19.6)) is True  # its own crown
    assert shown(wall(10.0, views=1)) is False  # five views are left
    assert shown(wall(10.0, views=1), [*VIEWS, VIEWS[1]]) is True


@pytest.mark.parametrize("width_px", [1, 2])
def test_a_twig_of_a_pixel_or_two_hides_nothing(width_px: int) -> None:
    """The leaf is at column 60 + 5 x of each view, by whose sides the ground shows."""
    for x in (-15, -10, -5, 5, 10, 15):
        assert shown(wall(10.0, (60 - x, 60 - x + width_px))) is True
    assert shown(wall(10.0, (40, 80))) is False


def test_what_is_out_of_the_frames_is_not_shown() -> None:
    aside = replace(TREE, leaf=np.array([0.0, -30.0, 5.0]))  # behind them
    assert shown(wall(30.0), leaf=aside) is False


def test_every_leaf_is_judged_in_its_place() -> None:
    aside = replace(TREE, leaf=np.array([0.0, -30.0, 5.0]))
    first, second, third = filmed_plants([(), (TREE, aside), ()], VIEWS, wall(30.0), CAPTURE)
    assert first == third == ()
    assert [one.observable for one in second] == [True, False]
    assert filmed_plants([()], VIEWS, wall(30.0), CAPTURE) == [()]
