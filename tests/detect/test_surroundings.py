"""What is seen beside a line tells whether it lies on something: painted ground, a line on it or above."""

from pathlib import Path

import cv2
import numpy as np
import pytest
from tests.support.drawn import HEIGHT, WIDTH, at_x, hanging, scene_of, two_passes

from plnerf.detect.candidate import Candidate
from plnerf.detect.config import CertaintyConfig, SelectConfig
from plnerf.detect.config_lines import SurroundingsConfig
from plnerf.detect.surroundings import Surroundings
from plnerf.detect.views import views_of
from plnerf.scene.cameras import Cameras

CONFIG, SELECT = SurroundingsConfig(), SelectConfig()
X = np.linspace(-0.6, 0.6, 40)
MOST_PX, PLAIN = 2048, 128


def ground(
    cameras: Cameras,
    height: float,
    seed: int = 0,
    contrast: float = 40.0,
    axis: int = 2,
    until: float = np.inf,
) -> list[np.ndarray]:
    """Soft spots on level ground, or on a wall across another axis, as cameras see them; none beyond an x."""
    spots = cv2.GaussianBlur(np.random.default_rng(seed).normal(size=(1200, 1200)), (0, 0), 2.0)
    painted = (128 + contrast * spots / spots.std()).clip(0, 255).astype(np.float32)
    pictures = []
    for n in range(len(cameras)):
        u, v = np.meshgrid(np.arange(WIDTH) + 0.5, np.arange(HEIGHT) + 0.5)
        focal, middle = cameras.focal_px[n].numpy(), cameras.principal_px[n].numpy()
        rays = np.stack([(u - middle[0]) / focal[0], (v - middle[1]) / focal[1], np.ones_like(u)], -1)
        rays = rays @ cameras.R_scene_camera[n].double().numpy().T
        centre = cameras.centre[n].double().numpy()
        towards = rays[..., axis] * np.sign(height - centre[axis])
        reach = np.where(towards > 1e-3, abs(height - centre[axis]) / np.maximum(towards, 1e-3), 50.0)
        at = np.delete(centre + reach[..., None] * rays, axis, axis=-1)
        column, row = ((400 * at[..., k] + 600).astype(np.float32) for k in (0, 1))
        grey = cv2.remap(painted, column, row, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REFLECT)
        grey[(column - 600) / 400 > until] = PLAIN
        pictures.append(np.repeat(np.rint(grey).astype(np.uint8)[..., None], 3, -1))
    return pictures


def likeness(folder: Path, pictures: list[np.ndarray], cameras: Cameras, z: float = 0.0) -> float:
    """Beside a straight level line at y = 0 and a height."""
    scene = scene_of(folder, cameras, pictures)
    first, _, last = at_x(hanging(0.0, z, 0.0), np.array([X[0], 0.0, X[-1]]))
    theta = np.array([first[1], last[1], first[2], last[2], 0.0, 0.0])
    line = Candidate(theta, np.eye(6) * 1e-8, 0.3, 12, 900.0, (0, len(X) - 1))
    surroundings = Surroundings(scene.photos, scene.train, MOST_PX, CONFIG)
    numbers = np.arange(len(cameras))
    return surroundings.likeness(line, views_of(cameras), numbers, X, CertaintyConfig())


@pytest.mark.parametrize("seed", [1, 2])
def test_beside_a_line_on_the_ground_views_agree_and_beside_one_in_the_air_they_do_not(
    tmp_path: Path, seed: int
) -> None:
    cameras = two_passes(12)
    for height, lies in ((0.0, True), (-0.25, False), (-0.6, False)):
        found = likeness(tmp_path / str(height), ground(cameras, height, seed), cameras)
        assert found > 1.5 * SELECT.lies if lies else found < 0.75 * SELECT.free


def test_a_line_on_a_wall_lies_on_it(tmp_path: Path) -> None:
    cameras = two_passes(12)
    assert likeness(tmp_path / "on", ground(cameras, 0.0, axis=1), cameras) > 1.5 * SELECT.lies


def test_what_stands_at_the_end_of_a_line_says_nothing_of_it(tmp_path: Path) -> None:
    cameras = two_passes(40)
    body = ground(cameras, 0.0, until=X[0] + 0.12 * (X[-1] - X[0]))
    assert not likeness(tmp_path / "alone", body, cameras) > SELECT.free  # not of NaN
    below = [np.where(b == PLAIN, g, b) for b, g in zip(body, ground(cameras, -0.6, 1), strict=True)]
    assert likeness(tmp_path / "below", below, cameras) <= SELECT.free


def test_without_texture_nothing_is_said(tmp_path: Path) -> None:
    cameras = two_passes(12)
    assert np.isnan(likeness(tmp_path / "flat", ground(cameras, 0.0, contrast=1.0), cameras))
    one_side = cameras[[0]]
    assert np.isnan(likeness(tmp_path / "one", ground(one_side, 0.0), one_side))


def test_only_the_photos_asked_for_are_kept(tmp_path: Path) -> None:
    cameras = two_passes(6)
    scene = scene_of(tmp_path, cameras, ground(cameras, 0.0))
    surroundings = Surroundings(scene.photos, scene.train, MOST_PX, CONFIG)
    assert len(surroundings._grey(np.array([0, 3, 5]))) == 3
    again = surroundings._grey(np.array([3, 4]))
    assert sorted(surroundings._kept) == [3, 4]
    assert np.array_equal(again[0], cv2.cvtColor(scene.images.image(3), cv2.COLOR_RGB2GRAY))
