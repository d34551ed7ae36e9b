"""Fixtures that several test files share: a tiny scene on disk, the shared real data, error-text
snapshots."""

import json
import os
import shutil
import sys
from collections.abc import Callable, Iterator
from pathlib import Path

os.environ.setdefault("OMP_WAIT_POLICY", "PASSIVE")  # as the command line does; before torch is imported
# Threads of linear algebra wait for each other in a busy loop: where two workers' four share two cores, an
# inverse of 131 unknowns takes 70 ms in place of 1.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

if os.environ.pop("PYTHONDONTWRITEBYTECODE", ""):
    # Without compiled files every worker, and every process that a test starts, would compile a thousand
    # sources again: half a minute each.  They lie beside the sources, where kernels lie too.
    sys.dont_write_bytecode = False

import numba
import numpy as np
import pytest
import torch
from PIL import Image
from tests.support import sampled_checks

if not torch.cuda.is_available():
    os.environ.setdefault("TRITON_INTERPRET", "1")  # read when Triton is imported

sampled_checks.install()

ROOT = Path(__file__).resolve().parent.parent
SHARED_DATA = ROOT.parent / "shared" / "data"
SNAPSHOTS = Path(__file__).parent / "snapshots"

TINY_COUNT, TINY_WIDTH, TINY_HEIGHT, TINY_FOCAL = 12, 48, 32, 40.0


def pytest_addoption(parser: pytest.Parser) -> None:
    parser.addoption("--update-snapshots", action="store_true", help="write the stored texts anew")


@pytest.fixture(scope="session", autouse=True)
def _threads_of_a_worker() -> None:
    """Where several processes test side by side, each kernel has one thread unless a test gives it more."""
    if "PYTEST_XDIST_WORKER" in os.environ:
        numba.set_num_threads(1)
        torch.set_num_threads(1)


@pytest.fixture(autouse=True)
def _same_draws_whatever_ran_before() -> None:
    """Otherwise a test that draws without a seed has other numbers for every order of the tests."""
    torch.manual_seed(0)


@pytest.fixture(autouse=True)
def _check_first_calls_again() -> None:
    sampled_checks.calls.clear()


@pytest.fixture(scope="session")
def shared_data() -> Path:
    """The folder of real data beside the checkout (mark such tests with ``data``)."""
    if not SHARED_DATA.is_dir():
        pytest.skip(f"the shared real data is not at {SHARED_DATA}")
    return SHARED_DATA


@pytest.fixture
def snapshot(request: pytest.FixtureRequest) -> Callable[[str, str], None]:
    """``snapshot(name, text)`` compares with ``tests/snapshots/<name>.txt``; --update-snapshots writes it."""

    def check(name: str, text: str) -> None:
        path = SNAPSHOTS / f"{name}.txt"
        if request.config.getoption("--update-snapshots"):
            path.parent.mkdir(exist_ok=True)
            path.write_text(text + "\n", encoding="utf-8")
        assert path.is_file(), f"{path.name} is not stored yet: run pytest --update-snapshots and read it"
        assert text + "\n" == path.read_text(encoding="utf-8")

    return check


@pytest.fixture(scope="session")
def built_tiny_scene(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The tiny scene, made once; tests that change files use ``tiny_scene``."""
    folder = tmp_path_factory.mktemp("built") / "tiny"
    write_tiny_scene(folder)
    return folder


@pytest.fixture
def tiny_scene(built_tiny_scene: Path, tmp_path: Path) -> Iterator[Path]:
    """A scene folder of the test's own: 12 images of 48x32, a ball on a chequered floor, metric, z up.

    World truth: the ball has its centre at (0, 0, 0.5) and radius 0.5; the floor is z = 0, its squares 0.5
    wide.
    """
    folder = tmp_path / "tiny"
    shutil.copytree(built_tiny_scene, folder)
    yield folder


def write_tiny_scene(folder: Path) -> None:
    """Twelve cameras on an arc around a ball on a floor, with exact pixels (one ray per pixel centre)."""
    (folder / "images").mkdir(parents=True)
    frames = []
    for i in range(TINY_COUNT):
        angle = 2.0 * np.pi * i / 16
        centre = np.array([3.0 * np.cos(angle), 3.0 * np.sin(angle), 1.5 + 0.1 * (i % 3)])
        T_world_camera = look_at(centre, np.array([0.0, 0.0, 0.4]))
        name = f"images/{i:04d}.png"
        Image.fromarray(ball_on_floor(T_world_camera)).save(folder / name)
        opengl = T_world_camera @ np.diag([1.0, -1.0, -1.0, 1.0])
        frames.append({"file_path": name, "transform_matrix": opengl.tolist()})
    data = {
        "w": TINY_WIDTH,
        "h": TINY_HEIGHT,
        "fl_x": TINY_FOCAL,
        "fl_y": TINY_FOCAL,
        "cx": TINY_WIDTH / 2,
        "cy": TINY_HEIGHT / 2,
        "plnerf": {"format_version": 1, "unit": "m", "crs": None, "up": [0, 0, 1]},
        "frames": frames,
    }
    (folder / "transforms.json").write_text(json.dumps(data, indent=1))


def look_at(centre: np.ndarray, target: np.ndarray) -> np.ndarray:
    """Camera to world, OpenCV axes, level (x axis horizontal)."""
    z = (target - centre) / np.linalg.norm(target - centre)
    x = np.cross(z, [0.0, 0.0, 1.0])
    x /= np.linalg.norm(x)
    pose = np.eye(4)
    pose[:3] = np.stack([x, np.cross(z, x), z, centre], axis=1)
    return pose


def ball_on_floor(T_world_camera: np.ndarray) -> np.ndarray:
    """What one camera of the tiny scene sees, uint8 (32, 48, 3)."""
    ys, xs = np.mgrid[0:TINY_HEIGHT, 0:TINY_WIDTH] + 0.5
    in_camera = np.stack(
        [(xs - TINY_WIDTH / 2) / TINY_FOCAL, (ys - TINY_HEIGHT / 2) / TINY_FOCAL, np.ones_like(xs)], axis=-1
    )
    d = in_camera @ T_world_camera[:3, :3].T
    d /= np.linalg.norm(d, axis=-1, keepdims=True)
    o = T_world_camera[:3, 3]
    to_ball = o - np.array([0.0, 0.0, 0.5])
    b = d @ to_ball
    root = b * b - (to_ball @ to_ball - 0.25)
    t_ball = np.where(root > 0, -b - np.sqrt(np.maximum(root, 0)), np.inf)
    t_floor = np.where(d[..., 2] < 0, -o[2] / np.minimum(d[..., 2], -1e-9), np.inf)
    floor = o + np.where(np.isfinite(t_floor), t_floor, 0.0)[..., None] * d
    dark = (np.floor(floor[..., :2] / 0.5).sum(-1) % 2)[..., None]
    colour = np.where(np.isfinite(t_floor)[..., None], 60.0 + 120.0 * dark * np.array([1.0, 0.8, 0.6]), 200.0)
    normal = (o + np.where(root > 0, t_ball, 0.0)[..., None] * d - np.array([0.0, 0.0, 0.5])) / 0.5
    shade = 0.5 + 0.5 * np.clip(normal @ np.array([0.3, 0.2, 0.93]), -1, 1)
    colour = np.where((t_ball < t_floor)[..., None], shade[..., None] * np.array([230.0, 60.0, 40.0]), colour)
    return np.round(colour).astype(np.uint8)
