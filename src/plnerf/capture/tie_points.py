"""Tie points: points that several posed photos show, found by SIFT features that agree with the poses.

Features of two photos match where each is the other's nearest neighbour, by Lowe's ratio test, and near its
epipolar line.  The poses give that line, so that few false matches pass and no pair needs a verification of
its own.
"""

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from itertools import combinations
from typing import NamedTuple, TypeVar

import cv2
import numpy as np
from jaxtyping import Float, Float32, Int
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components

from plnerf.capture.pairs import Pair
from plnerf.capture.poses_config import TieConfig
from plnerf.ops.cpu_arrays import usable_cores
from plnerf.scene.cameras import Cameras
from plnerf.scene.photos import Pictures

T = TypeVar("T")
S = TypeVar("S")
Progress = Callable[[int, int], None]
"""Called with what is done, and of how much."""


def silent(done: int, of: int) -> None:
    """A `Progress` that reports nothing."""


class Features(NamedTuple):
    """SIFT features of one photo."""

    plane: Float[np.ndarray, "f 2"]
    """Positions without the lens's distortion, in the plane at depth 1."""
    descriptors: Float32[np.ndarray, "f 128"]
    """Unit vectors (RootSIFT; Arandjelovic and Zisserman 2012)."""


class TiePoints(NamedTuple):
    """m observations of p points in n photos, sorted by point."""

    image: Int[np.ndarray, " m"]
    point: Int[np.ndarray, " m"]
    plane: Float[np.ndarray, "m 2"]
    """Observed positions in the plane at depth 1, without distortion."""
    focal_px: Float[np.ndarray, " n"]
    """Focal length of every photo at the size at which its features were found: their accuracy is that of
    these pixels."""


def neighbour_pairs(cameras: Cameras, partners: int) -> list[Pair]:
    """Pairs (i, j), i < j, of photos taken from near by in nearly the same direction."""
    centre, axis = cameras.centre.double().numpy(), cameras.R_scene_camera[:, :, 2].double().numpy()
    extent = max(float(np.ptp(centre, axis=0).max()), 1e-9)
    pairs = set[Pair]()
    for i in range(len(centre)):
        apart = np.linalg.norm(centre - centre[i], axis=1) / extent + 2 * (1 - axis @ axis[i])
        apart[i] = np.inf
        nearest = np.argsort(apart, kind="stable")[: min(partners, len(centre) - 1)]
        pairs |= {(min(i, int(j)), max(i, int(j))) for j in nearest}
    return sorted(pairs)


def sampled_pairs(cameras: Cameras, groups: int, size: int) -> list[Pair]:
    """All pairs within some groups of neighbouring photos, evenly chosen along the capture."""
    pairs = set[Pair]()
    linked = neighbour_pairs(cameras, size - 1)
    for first in np.unique(np.linspace(0, len(cameras) - 1, groups).astype(int)).tolist():
        group = {first} | {i for pair in linked if first in pair for i in pair}
        pairs |= set(combinations(sorted(group)[:size], 2))
    return sorted(pairs)


def features_of(
    pictures: Pictures,
    cameras: Cameras,
    images: Sequence[int],
    config: TieConfig,
    progress: Progress = silent,
) -> dict[int, Features]:
    """Features of some photos.  cameras: of all photos at their full size.

    Memory: 1.1 MB a photo at most.
    """
    found = dict[int, Features]()
    for image, features in _in_threads(lambda image: _features(pictures, cameras, image, config), images):
        found[image] = features
        progress(len(found), len(images))
    return found


def images_of(pairs: Iterable[Pair]) -> list[int]:
    """The photos of some pairs, in order."""
    return sorted({image for pair in pairs for image in pair})


def tie_points(
    found: Mapping[int, Features],
    cameras: Cameras,
    pairs: Sequence[Pair],
    config: TieConfig,
    progress: Progress = silent,
) -> TiePoints:
    """Points that the photos of some pairs show in common.  cameras: of all photos at their full size.

    Memory: for each core a matrix of features by features.
    """
    none = Features(np.zeros((0, 2)), np.zeros((0, 128), np.float32))
    features = [found.get(image, none) for image in range(len(cameras))]
    links = list[tuple[Pair, Int[np.ndarray, "_ 2"]]]()
    for link in _in_threads(lambda pair: _matches(features, cameras, pair, config), pairs):
        links.append(link)
        progress(len(links), len(pairs))
    sizes = cameras.size_px.numpy()
    shrunk = np.minimum(1.0, config.max_image_px / sizes.max(1))
    return _joined(features, links, config.min_images, cameras.focal_px.double().numpy().mean(1) * shrunk)


def _in_threads(work: Callable[[T], S], items: Sequence[T]) -> Iterator[tuple[T, S]]:
    """Each item with what becomes of it, in order: OpenCV and NumPy work beside each other."""
    with ThreadPoolExecutor(usable_cores()) as pool:
        yield from zip(items, pool.map(work, items), strict=True)


def _features(pictures: Pictures, cameras: Cameras, image: int, config: TieConfig) -> Features:
    grey = cv2.cvtColor(pictures.image(image), cv2.COLOR_RGB2GRAY)
    full = np.array(grey.shape[::-1])
    if full.max() > config.max_image_px:
        width, height = np.maximum(1, np.rint(full * config.max_image_px / full.max())).astype(int).tolist()
        grey = cv2.resize(grey, (width, height), interpolation=cv2.INTER_AREA)
    valid = None
    if pictures.has_masks:
        mask = pictures.valid(image).astype(np.uint8)
        valid = cv2.resize(mask, (grey.shape[1], grey.shape[0]), interpolation=cv2.INTER_NEAREST)
    # Without precise upscaling every feature lies a quarter of a pixel right of and below where it is.
    sift = cv2.SIFT.create(
        config.features, contrastThreshold=config.contrast, enable_precise_upscale=True
    )
    found, descriptors = sift.detectAndCompute(grey, valid)
    if not found:
        return Features(np.zeros((0, 2)), np.zeros((0, 128), np.float32))
    # OpenCV counts from the middle of the first pixel, and its coordinates are those of the smaller photo.
    pixels = (np.array([one.pt for one in found]) + 0.5) * full / grey.shape[::-1]
    K = np.diag([*cameras.focal_px[image].tolist(), 1.0])
    K[:2, 2] = cameras.principal_px[image].tolist()
    lens = cameras.distortion[image].double().numpy()
    plane = cv2.undistortPoints(pixels[:, None], K, lens)[:, 0].astype(np.float64)
    root = np.sqrt(descriptors / np.maximum(descriptors.sum(1, keepdims=True), 1e-9))
    return Features(plane, root.astype(np.float32))


def _matches(
    features: Sequence[Features], cameras: Cameras, pair: Pair, config: TieConfig
) -> Int[np.ndarray, "k 2"]:
    """Indices of features of both photos that match."""
    (plane_i, own), (plane_j, other) = (features[image] for image in pair)
    if min(len(own), len(other)) < 2:
        return np.zeros((0, 2), np.int64)
    alike = own @ other.T
    rows, first = np.arange(len(own)), alike.argmax(1)
    best = alike[rows, first]
    mutual = best >= alike.max(0)[first]  # argmax(0) takes over 20 times as long
    alike[rows, first] = -1
    # Distances of unit vectors: d^2 = 2 - 2 cos.
    distance, following = (np.sqrt(np.maximum(2 - 2 * one, 0)) for one in (best, alike.max(1)))
    kept = np.flatnonzero(mutual & (distance < config.ratio * following))
    found = np.stack([kept, first[kept]], 1)
    apart = _epipolar_px(plane_i[found[:, 0]], plane_j[found[:, 1]], cameras, pair)
    return found[apart <= config.epipolar_px]


def _epipolar_px(
    plane_i: Float[np.ndarray, "k 2"], plane_j: Float[np.ndarray, "k 2"], cameras: Cameras, pair: Pair
) -> Float[np.ndarray, " k"]:
    """Distance of each place in the second photo from the epipolar line of that in the first."""
    R_i, R_j = (cameras.R_scene_camera[image].double().numpy() for image in pair)
    c_i, c_j = (cameras.centre[image].double().numpy() for image in pair)
    t = R_j.T @ (c_i - c_j)
    cross = np.array([[0, -t[2], t[1]], [t[2], 0, -t[0]], [-t[1], t[0], 0]])
    E = cross @ R_j.T @ R_i  # essential matrix: x_j^T E x_i = 0
    lines = plane_i @ E[:, :2].T + E[:, 2]
    apart = np.abs((lines[:, :2] * plane_j).sum(1) + lines[:, 2])
    focal = float(cameras.focal_px[pair[1]].mean())
    return focal * apart / np.maximum(np.hypot(*lines[:, :2].T), 1e-30)


def _joined(
    features: Sequence[Features],
    links: Sequence[tuple[Pair, Int[np.ndarray, "_ 2"]]],
    min_images: int,
    focal_px: Float[np.ndarray, " n"],
) -> TiePoints:
    """Matches that share features, as points.  Points that one photo would show twice are left out."""
    counts = [len(one.plane) for one in features]
    first = np.concatenate([[0], np.cumsum(counts)])
    ends = [first[list(pair)] + rows for pair, rows in links]
    a, b = np.concatenate([np.zeros((0, 2), np.int64), *ends]).T
    graph = coo_matrix((np.ones(len(a), bool), (a, b)), (first[-1], first[-1]))
    _, group = connected_components(graph, directed=False)
    image = np.repeat(np.arange(len(features)), counts)
    sizes = np.bincount(group, minlength=1)
    both, times = np.unique(np.stack([group, image]), axis=1, return_counts=True)
    whole = (sizes >= min_images)[group] & ~np.isin(group, both[0, times > 1])
    kept = np.flatnonzero(whole)
    kept = kept[np.argsort(group[kept], kind="stable")]
    plane = np.concatenate([one.plane for one in features])[kept]
    return TiePoints(image[kept], np.unique(group[kept], return_inverse=True)[1], plane, focal_px)
