"""The truth brought into a survey's frame by the cameras of both: for poses from structure from motion.

    y = R x + t      x in the truth's world, y in the survey's; metres in both, so that no scale is fitted

A wrong scale of the survey thus stays an error of its wires, and is reported.  Only where the truth itself
is unscaled, as of wires hung in photos that nothing georeferences, the scale is fitted too.  Each camera
counts with its centre and with points as far away as the wires are: on a straight flight the viewing
directions fix the rotation about it.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from jaxtyping import Float
from scipy.spatial import cKDTree

from plnerf.capture.similarity import Similarity, fit_similarity
from plnerf.errors import SurveyError
from plnerf.scene.formats import read_listing
from plnerf.scene.json_fields import numbers_of
from plnerf.scene.transforms import flip_camera_axes
from plnerf.score.truth import Truth
from plnerf.score.truth_fields import load_truth

LEAST_CAMERAS = 3
"""Fewer do not fix a similarity."""
Cameras = Mapping[str, Float[np.ndarray, "4 4"]]
"""Camera to world (OpenCV axes) by the stem of the image's name."""


@dataclass(frozen=True)
class Alignment:
    """How well the cameras of both agree once the truth is moved."""

    cameras: int
    off_m: float
    """Root mean square of how far they are apart."""
    scale: float
    """How many times as far apart the survey's cameras are as the true ones."""
    scaled: bool = False
    """Whether the truth was scaled by that; lengths are then in the unit of the survey's world."""

    @property
    def words(self) -> str:
        """As a sentence."""
        if self.scaled:
            return (
                f"The truth, which is unscaled, was turned, shifted and scaled by {self.cameras} cameras, "
                f"which are {self.off_m:.4f} units off after that (root mean square)."
            )
        return (
            f"The truth was turned and shifted by {self.cameras} cameras, which are {self.off_m:.3f} m off "
            f"after that (root mean square); in the survey they are {self.scale:.5f} times as far apart."
        )


def align(truth: Truth, true: Cameras, survey: Cameras, *, scaled: bool = False) -> tuple[Truth, Alignment]:
    """The truth in the survey's frame.  scaled: whether the scale is fitted too.

    Raises SurveyError for fewer than `LEAST_CAMERAS` common images.
    """
    names = sorted(true.keys() & survey.keys())
    if len(names) < LEAST_CAMERAS:
        raise SurveyError(
            f"{len(names)} images of the survey's scene ({len(survey)}) are also in the truth's "
            f"({len(true)}), by their names without suffix, but {LEAST_CAMERAS} or more are needed to align "
            "by. Give the truth of the scene whose images were used, and keep their names."
        )
    x, y = (np.stack([cameras[name] for name in names]) for cameras in (true, survey))
    wires = cKDTree(np.concatenate([wire.polyline() for wire in truth.wires]))
    away = float(np.median(wires.query(x[:, :3, 3])[0]))
    spread = [np.sqrt(((T[:, :3, 3] - T[:, :3, 3].mean(0)) ** 2).sum()) for T in (x, y)]
    apart = float(spread[1] / spread[0])
    scale = apart if scaled else 1.0
    here, there = _points(x, away), _points(y, scale * away)
    R = fit_similarity(here, there).R
    motion = Similarity(scale, R, there.mean(0) - scale * R @ here.mean(0))
    off = motion(x[:, :3, 3]) - y[:, :3, 3]
    how = Alignment(len(names), float(np.sqrt((off**2).sum(1).mean())), apart, scaled)
    return truth.moved(motion), how


def _points(T_world_camera: Float[np.ndarray, "n 4 4"], away_m: float) -> Float[np.ndarray, "m 3"]:
    """Each camera's place, and the points so far away from it along either direction of its axes."""
    place = T_world_camera[:, :3, 3]
    axes = np.moveaxis(T_world_camera[:, :3, :3], 2, 0).reshape(-1, 3) * away_m
    around = np.tile(place, (3, 1))
    return np.concatenate([place, around + axes, around - axes])


def cameras_of(scene: Path) -> Cameras:
    """Those of a scene.  Raises SceneError where it cannot be read."""
    return {Path(shot.name).stem: shot.T_world_camera for shot in read_listing(scene).shots}


def is_unscaled(truth_at: Path) -> bool:
    """Whether a truth.json says that nothing gives its lengths a scale."""
    return bool(load_truth(truth_at).get("unit") == "unscaled")


def true_cameras(truth_at: Path) -> Cameras:
    """Those of a truth.json if it lists them, else of the scene folder that it lies in."""
    listed = load_truth(truth_at).get("poses")
    if not listed:
        return cameras_of(truth_at.parent)
    try:
        return {
            Path(entry["name"]).stem: flip_camera_axes(numbers_of(entry["T_world_camera"]).reshape(4, 4))
            for entry in listed
        }
    except (KeyError, TypeError, ValueError) as error:
        raise SurveyError(f"{truth_at} has poses that are none ({error!r}). Make the truth again.") from error
