"""Which stretches of a wire are said to be seen, against masks drawn by hand."""

from dataclasses import replace

import numpy as np
import pytest

from plnerf.line.hang import hang
from plnerf.synth.capture import View, look
from plnerf.synth.flight_config import CaptureConfig
from plnerf.synth.seen import MIN_IMAGES, STEP_M, observable_stretches, seen_stretches, shown, stretches
from plnerf.synth.tiles import strips, tiles_of

CAPTURE = CaptureConfig(width_px=120, height_px=80, focal_px=100.0)
WIRE = hang((-20.0, 0.0, 10.0), (20.0, 1.0, 11.0), 1.0, diameter_m=0.03)
VIEWS = [View(f"{i:04d}", "right", look(np.pi / 2, 0.0, 0.0), np.array([x, -34.0, 10.0]))
         for i, x in enumerate((-0.5, 0.0, 0.5, 1.0))]  # fmt: skip


def pixels(view: View, points: np.ndarray) -> np.ndarray:
    local = (points - view.centre) @ view.R_world_camera
    return local[:, :2] / local[:, 2:] * CAPTURE.focal_px + [60, 40]


def drawn(view: View, points: np.ndarray) -> np.ndarray:
    """The pixels that hold the projections of the points."""
    mask = np.zeros((80, 120), dtype=np.bool_)
    column, row = np.floor(pixels(view, points)).astype(int).T
    mask[row, column] = True
    return mask


WHOLE = [drawn(view, WIRE.polyline(0.02)) for view in VIEWS]
NONE = np.zeros((80, 120), dtype=np.bool_)


def test_a_wire_that_all_masks_show_is_seen_whole() -> None:
    assert seen_stretches([WIRE], VIEWS, WHOLE, CAPTURE) == [[(0.0, round(WIRE.base.length_m, 3))]]


def test_a_wire_that_no_mask_shows_is_not_seen() -> None:
    below = hang((-20.0, 0.0, 5.0), (20.0, 0.0, 5.0), 1.0, diameter_m=0.03)
    behind = hang((-20.0, -90.0, 10.0), (20.0, -90.0, 10.0), 1.0, diameter_m=0.03)
    assert seen_stretches([below, behind], VIEWS, WHOLE, CAPTURE) == [[], []]
    assert seen_stretches([WIRE], VIEWS, [NONE] * 4, CAPTURE) == [[]]


def test_it_takes_three_images() -> None:
    few = [*WHOLE[: MIN_IMAGES - 1], NONE, NONE]
    assert seen_stretches([WIRE], VIEWS, few, CAPTURE) == [[]]
    assert seen_stretches([WIRE], VIEWS, [*WHOLE[:MIN_IMAGES], NONE], CAPTURE) == [[(0.0, 40.012)]]


def test_what_shows_beyond_the_filmed_stretch_is_left_out() -> None:
    """s runs from x = -20 m on, along (1, 0.025): a filmed stretch of -5 to 8 m is s from 15 to 28 m."""
    filmed = replace(CAPTURE, filmed_m=(-5.0, 8.0))
    (((low, high),),) = seen_stretches([WIRE], VIEWS, WHOLE, filmed)
    assert 15 <= low <= 15 + 2 * STEP_M and 28 - STEP_M <= high <= 28 + STEP_M


def test_what_is_hidden_is_left_out_to_within_the_tolerance() -> None:
    """A pole hides s from 12 to 17 m in all images; a pixel is 0.35 m here, and 1.5 px count as seen."""
    s = np.arange(0, WIRE.base.length_m, 0.02)
    masks = [drawn(view, WIRE.points(s[(s < 12) | (s > 17)])) for view in VIEWS]
    ((first, low), (high, last)) = seen_stretches([WIRE], VIEWS, masks, CAPTURE)[0]
    assert (first, last) == (0.0, 40.012)
    assert 12 <= low <= 12 + 2.6 * 0.36 and 17 - 2.6 * 0.36 <= high <= 17


THICK = replace(WIRE, diameter_m=0.6)
"""1.7 px wide at 34 m."""
BELOW = [View(f"{i:04d}", "right", look(np.pi / 2, pitch, 0.0), np.array([x, -34.0, 10.0 - rise]))
         for i, (x, rise, pitch) in enumerate((x, rise, np.arctan(rise / 34.0))
                                              for x in (0.0, 0.5, 1.0) for rise in (0.0, 8.0))]  # fmt: skip


def observed(views: list[View], wire=THICK) -> list[tuple[float, float]]:
    masks = [drawn(view, points[(np.abs(pixels(view, points) - [60, 40]) < [60, 40]).all(1)])
             for view in views for points in [wire.polyline(0.02)]]  # fmt: skip
    (found,) = observable_stretches([wire], views, masks, CAPTURE)
    return found


def test_what_six_wide_images_from_two_heights_show_is_observable() -> None:
    """Planes through the wire differ by atan(8 / 34) = 13 degrees."""
    ((low, high),) = observed(BELOW)
    assert low < 1.5 and high > 38.0
    assert observed(BELOW[:5]) == []  # five images
    assert observed([replace(view, centre=BELOW[0].centre) for view in BELOW[::2]] * 2) == []  # one height
    assert observed(BELOW, replace(WIRE, diameter_m=0.4)) == []  # 1.2 px


def test_shown_agrees_with_brute_force() -> None:
    points = WIRE.polyline(0.1) + np.random.default_rng(0).normal(0, 0.5, (len(WIRE.polyline(0.1)), 3))
    for view, mask in zip(VIEWS, WHOLE, strict=True):
        centres = np.stack(np.nonzero(mask)[::-1], axis=1) + 0.5
        gap = np.linalg.norm(pixels(view, points)[:, None] - centres[None], axis=2).min(axis=1)
        np.testing.assert_array_equal(shown(points, view, mask, CAPTURE), gap <= 1.5)


def test_stretches_are_the_runs() -> None:
    s = np.arange(8) * STEP_M
    seen = np.array([1, 1, 0, 1, 0, 1, 1, 1], dtype=np.bool_)
    assert stretches(s, seen) == [(0.0, 0.05), (0.25, 0.35)]
    assert stretches(s, ~seen) == []


@pytest.mark.parametrize("size", [(120, 80), (117, 77)])
def test_strips_hold_every_pixel_of_the_wires_and_little_else(size: tuple[int, int]) -> None:
    """Triangles around the wire, of which many points are projected; also beside and behind the camera."""
    rng = np.random.default_rng(3)
    capture = CaptureConfig(width_px=size[0], height_px=size[1], focal_px=100.0)
    line = np.concatenate([WIRE.polyline(0.1), WIRE.polyline(0.1) + np.array([0, -34, 0.7])])
    faces = line[:, None] + rng.normal(0, 0.03, (len(line), 3, 3))
    for view in VIEWS:
        covered = np.zeros(size[::-1], dtype=np.int64)
        for x, y, width, height in strips(tiles_of(faces, view, capture), capture):
            covered[y : y + height, x : x + width] += 1
        assert covered.max() <= 1
        weights = rng.dirichlet(np.ones(3), (len(faces), 40))
        points = np.einsum("fwk,fkd->fwd", weights, faces).reshape(-1, 3)
        local = (points - view.centre) @ view.R_world_camera
        local = local[local[:, 2] > 0.05]
        pixel = local[:, :2] / local[:, 2:] * 100.0 + np.array(size) / 2
        pixel = pixel[((pixel >= 0) & (pixel < size)).all(axis=1)].astype(int)
        assert len(pixel) > 1000
        assert covered[pixel[:, 1], pixel[:, 0]].all()
        assert covered.mean() < 0.5
