"""Wire masks keep thin wires at any reduction; depth is compared pixel by pixel at full size."""

from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from plnerf.errors import SceneError
from plnerf.train.true_pictures import (
    CLOSE_M,
    at_full_size,
    depth_error,
    read_depth_mm,
    read_wire_mask,
    reduced_wire_mask,
)


def line(kind: str, size: int = 64) -> np.ndarray:
    mask = np.zeros((size, size), np.bool_)
    if kind == "row":
        mask[29] = True
    if kind == "column":
        mask[:, 30] = True
    if kind == "diagonal":
        np.fill_diagonal(mask, True)
    return mask


@pytest.mark.parametrize("kind", ["row", "column", "diagonal"])
@pytest.mark.parametrize("factor", [1, 2, 4, 8])
def test_a_line_one_pixel_wide_stays_whole_and_thin(kind: str, factor: int) -> None:
    small = reduced_wire_mask(line(kind), (64 // factor, 64 // factor))
    assert small.sum() == 64 // factor
    expected = line(kind).reshape(64 // factor, factor, 64 // factor, factor).any((1, 3))
    assert (small == expected).all()


def test_a_line_across_the_reduced_pixels_keeps_those_that_it_half_crosses() -> None:
    """Reduced by 4, a diagonal 2 px off crosses two pixels in turn, half of each; 3 px off, 1/4 and 3/4."""
    small = reduced_wire_mask(np.eye(64, k=2) > 0, (16, 16))
    assert (small == (np.eye(16) + np.eye(16, k=1) > 0)).all()
    assert (reduced_wire_mask(np.eye(64, k=3) > 0, (16, 16)) == (np.eye(16, k=1) > 0)).all()


def test_at_full_size_the_mask_is_itself_and_nothing_stays_nothing() -> None:
    mask = np.random.default_rng(0).random((20, 30)) < 0.1
    assert (reduced_wire_mask(mask, (30, 20)) == mask).all()
    assert not reduced_wire_mask(np.zeros((20, 30), np.bool_), (15, 10)).any()


@pytest.mark.parametrize("k", [1, 3])
def test_growing_covers_what_is_near(k: int) -> None:
    mask = np.zeros((21, 31), np.bool_)
    mask[4, 5], mask[15, 20] = True, True
    grown = reduced_wire_mask(mask, (31, 21), dilate_px=k)
    rows, columns = np.mgrid[:21, :31]
    distance = np.minimum(np.hypot(rows - 4, columns - 5), np.hypot(rows - 15, columns - 20))
    assert grown[distance <= k - 0.5].all() and not grown[distance > k + 0.5].any() and grown[4, 5 + k]


def test_each_pixel_takes_the_value_of_the_one_that_covers_it() -> None:
    small = np.arange(6.0).reshape(2, 3)
    assert (at_full_size(small, (4, 9)) == small.repeat(2, 0).repeat(3, 1)).all()
    uneven = at_full_size(small, (5, 7))
    for r in range(5):
        for c in range(7):
            assert uneven[r, c] == small[int((r + 0.5) / 5 * 2), int((c + 0.5) / 7 * 3)]


def test_depth_errors_are_those_of_the_pixels_in_use() -> None:
    truth_mm = np.full((4, 6), 5000, np.uint16)
    truth_mm[0, ::2], truth_mm[0, 1::2] = 0, 65535  # no surface, or farther than can be written: not compared
    rendered = np.array([[5.1, 5.1, 0.0], [5.1, 7.0, 0.0]])  # the last column has no surface
    error = depth_error(rendered, truth_mm, np.ones((4, 6), np.bool_))
    assert error is not None and error.pixels == 18
    assert error.median_m == pytest.approx(0.1)
    assert error.close_share == pytest.approx(8 / 18) and error.no_surface_share == pytest.approx(6 / 18)
    right = np.zeros((4, 6), np.bool_)
    right[:, 4:] = True
    nothing = depth_error(rendered, truth_mm, right)
    assert nothing is not None and nothing.median_m is None and nothing.no_surface_share == 1
    assert nothing.close_share == 0
    assert depth_error(rendered, truth_mm, np.zeros((4, 6), np.bool_)) is None
    assert depth_error(rendered, np.zeros((4, 6), np.uint16), np.ones((4, 6), np.bool_)) is None


def test_close_means_up_to_the_stated_distance() -> None:
    truth_mm = np.full((1, 3), 5000, np.uint16)
    rendered = np.array([[5.0 + CLOSE_M - 1e-3, 5.0 - CLOSE_M + 1e-3, 5.0 + CLOSE_M + 1e-3]])
    error = depth_error(rendered, truth_mm, np.ones((1, 3), np.bool_))
    assert error is not None and error.close_share == pytest.approx(2 / 3)


def test_truth_files_read_back(tmp_path: Path) -> None:
    depth = np.random.default_rng(0).integers(0, 65536, (7, 9), dtype=np.uint16)
    Image.fromarray(depth).save(tmp_path / "d.png")
    assert (read_depth_mm(tmp_path / "d.png") == depth).all()
    mask = np.random.default_rng(0).integers(0, 2, (7, 9), dtype=np.uint8) * 255
    Image.fromarray(mask).save(tmp_path / "m.png")
    assert (read_wire_mask(tmp_path / "m.png") == (mask == 255)).all()


def test_truth_files_that_are_something_else_say_so(tmp_path: Path) -> None:
    Image.new("RGB", (4, 3)).save(tmp_path / "rgb.png")
    Image.new("L", (4, 3)).save(tmp_path / "grey.png")
    (tmp_path / "text.png").write_text("no picture")
    values = (np.arange(64 * 48).reshape(48, 64) * 7).astype(np.uint16)
    Image.fromarray(values).save(tmp_path / "short.png")
    whole = (tmp_path / "short.png").read_bytes()
    at = whole.index(b"IDAT")
    fewer = int.from_bytes(whole[at - 4 : at], "big") - 9  # Pillow raises SyntaxError of the next chunk
    (tmp_path / "short.png").write_bytes(whole[: at - 4] + fewer.to_bytes(4, "big") + whole[at:])
    with pytest.raises(SceneError, match="8-bit grey"):
        read_wire_mask(tmp_path / "rgb.png")
    with pytest.raises(SceneError, match="16-bit grey"):
        read_depth_mm(tmp_path / "grey.png")
    for read in (read_wire_mask, read_depth_mm):
        for damaged in ("text.png", "short.png"):
            with pytest.raises(SceneError, match="cannot be read"):
                read(tmp_path / damaged)
        with pytest.raises(SceneError, match="cannot be read"):
            read(tmp_path / "absent.png")
