"""Bundle adjustment of given poses: they move until tie points agree, within the accuracy that they have.

Gauss-Newton over n poses and p points, the points eliminated (Schur complement; Triggs et al. 2000, section
6).  All six numbers of every pose have a prior at what was given, of a standard deviation that is learnt, so
that the poses together neither drift nor turn and world coordinates keep their meaning: tie points alone
leave a similarity of all poses and points free.  Lenses stay as they are.  Scene units, float64.
"""

from typing import NamedTuple

import numpy as np
from jaxtyping import Float
from scipy.sparse import bsr_matrix, csr_matrix
from scipy.spatial.transform import Rotation

from plnerf.capture.poses_config import AdjustmentConfig
from plnerf.capture.tie_points import TiePoints

LEAST_ANGLE_RAD = 0.05
"""Angle between the rays of a point below which its depth is not known well enough to start from."""


class Adjusted(NamedTuple):
    """Poses after an adjustment."""

    R_scene_camera: Float[np.ndarray, "n 3 3"]
    centre: Float[np.ndarray, "n 3"]
    sigma: Float[np.ndarray, "2"]
    """Standard deviations of the given positions (scene units) and rotations (radians) along each axis."""
    before_px: float
    """Median reprojection error at the given poses, with the points where they fit best; NaN without
    points."""
    after_px: float
    points: int
    """Points that took part."""
    covariance: Float[np.ndarray, "v v"]
    """Of all centres and rotations (scene axes, radians), a pose's six numbers after another's."""


def adjust(
    R_scene_camera: Float[np.ndarray, "n 3 3"],
    centre: Float[np.ndarray, "n 3"],
    ties: TiePoints,
    config: AdjustmentConfig,
) -> Adjusted:
    """Poses that agree with tie points; those that see none, and all of them without points, stay."""
    ties, points = _triangulated(R_scene_camera, centre, ties)
    R0, c0 = R_scene_camera, centre
    if not len(points):
        return Adjusted(R0, c0, np.zeros(2), float("nan"), float("nan"), 0, np.zeros((6 * len(c0),) * 2))
    problem = _Problem(ties, len(points), config)
    points = problem.points_alone(R0, c0, points)
    before = problem.median_px(R0, c0, points)
    depth = ((points[ties.point] - c0[ties.image]) * R0[ties.image, :, 2]).sum(1)
    sigma = config.pose_px / np.median(ties.focal_px) * np.array([np.median(depth), 1.0])
    R, c = R0, c0
    seen, covariance = np.unique(ties.image), np.zeros(0)
    for _ in range(config.steps):
        moved = np.concatenate([c - c0, Rotation.from_matrix(R @ R0.transpose(0, 2, 1)).as_rotvec()], 1)
        weight = np.repeat(sigma**-2, 3)
        step, points, covariance = problem.step(R, c, points, moved * weight, weight)
        c, R = c + step[:, :3], Rotation.from_rotvec(step[:, 3:]).as_matrix() @ R
        # Expectation maximisation: the mean square of how far poses moved and of what is still unknown.
        squares = ((moved + step) ** 2 + covariance.diagonal().reshape(-1, 6))[seen]
        sigma = np.sqrt(squares.reshape(-1, 2, 3).mean((0, 2)))
    return Adjusted(R, c, sigma, before, problem.median_px(R, c, points), len(points), covariance)


def _triangulated(
    R: Float[np.ndarray, "n 3 3"], centre: Float[np.ndarray, "n 3"], ties: TiePoints
) -> tuple[TiePoints, Float[np.ndarray, "p 3"]]:
    """The point nearest to the rays of each tie point, without those whose depth is not known."""
    ray = np.concatenate([ties.plane, np.ones((len(ties.plane), 1))], 1)
    ray = (R[ties.image] @ ray[:, :, None])[:, :, 0]
    ray /= np.linalg.norm(ray, axis=1, keepdims=True)
    starts = np.flatnonzero(np.diff(ties.point, prepend=-1))
    if not len(starts):
        return ties, np.zeros((0, 3))
    across = np.eye(3) - ray[:, :, None] * ray[:, None]
    normal = np.add.reduceat(across, starts)
    right = np.add.reduceat((across @ centre[ties.image][:, :, None])[:, :, 0], starts)
    counts = np.diff(starts, append=len(ray))
    # The least eigenvalue is a sum of squared sines of the rays' angles to their mean direction.
    known = np.linalg.eigvalsh(normal)[:, 0] > counts * (LEAST_ANGLE_RAD / 2) ** 2
    points = np.zeros((len(starts), 3))
    points[known] = np.linalg.solve(normal[known], right[known][:, :, None])[:, :, 0]
    depth = ((np.repeat(points, counts, 0) - centre[ties.image]) * R[ties.image, :, 2]).sum(1)
    known &= np.minimum.reduceat(depth, starts) > 0
    kept = np.repeat(known, counts)
    number = np.cumsum(known) - 1
    left = ties._replace(
        image=ties.image[kept], point=np.repeat(number, counts)[kept], plane=ties.plane[kept]
    )
    return left, points[known]


class _Problem:
    """Observations and their weights; poses and points are given to each step."""

    def __init__(self, ties: TiePoints, points: int, config: AdjustmentConfig) -> None:
        self.ties, self.config, self.focal = ties, config, ties.focal_px[ties.image]
        self.views, self.points = len(ties.focal_px), points
        self.starts = np.flatnonzero(np.diff(ties.point, prepend=-1))
        self.by_view = np.argsort(ties.image, kind="stable")
        ordered = ties.image[self.by_view]
        self.view_starts = np.flatnonzero(np.diff(ordered, prepend=-1))
        self.seen_views = ordered[self.view_starts]

    def median_px(
        self, R: Float[np.ndarray, "n 3 3"], c: Float[np.ndarray, "n 3"], points: Float[np.ndarray, "p 3"]
    ) -> float:
        """Median reprojection error."""
        r, _, _ = self._residuals(R, c, points)
        return float(np.median(np.linalg.norm(r, axis=1) * self.focal))

    def points_alone(
        self, R: Float[np.ndarray, "n 3 3"], c: Float[np.ndarray, "n 3"], points: Float[np.ndarray, "p 3"]
    ) -> Float[np.ndarray, "p 3"]:
        """The points that fit best while the poses stay."""
        for _ in range(3):
            r, J, _ = self._residuals(R, c, points)
            V, h = self._point_equations(J, self._weights(r), r)
            points = points + np.linalg.solve(V, h[:, :, None])[:, :, 0]
        return points

    def step(
        self,
        R: Float[np.ndarray, "n 3 3"],
        c: Float[np.ndarray, "n 3"],
        points: Float[np.ndarray, "p 3"],
        prior: Float[np.ndarray, "n 6"],
        prior_weight: Float[np.ndarray, "6"],
    ) -> tuple[Float[np.ndarray, "n 6"], Float[np.ndarray, "p 3"], Float[np.ndarray, "v v"]]:
        """One Gauss-Newton step: how positions and rotations move (in scene axes), the points afterwards, and
        the covariance of the poses.

        prior: gradient of the prior; prior_weight: its inverse variances.
        """
        r, by_point, P = self._residuals(R, c, points)
        w = self._weights(r)
        turn = np.zeros((len(r), 3, 3))  # R <- exp(turn) R, and P = R^T (X - c) in the camera
        scene = (R[self.ties.image] @ P[:, :, None])[:, :, 0]
        turn[:, 0, 1], turn[:, 0, 2], turn[:, 1, 2] = -scene[:, 2], scene[:, 1], -scene[:, 0]
        turn -= turn.transpose(0, 2, 1)
        by_pose = np.concatenate([-by_point, by_point @ turn], 2)
        A, g = np.zeros((self.views, 6, 6)), np.zeros((self.views, 6))
        weighted = by_pose * w[:, None, None]
        blocks = weighted.transpose(0, 2, 1) @ by_pose
        right = -(weighted * r[:, :, None]).sum(1)
        A[self.seen_views] = np.add.reduceat(blocks[self.by_view], self.view_starts)
        g[self.seen_views] = np.add.reduceat(right[self.by_view], self.view_starts)
        A[:, range(6), range(6)] += prior_weight
        V, h = self._point_equations(by_point, w, r)
        inverse = np.linalg.inv(V)
        mixed = weighted.transpose(0, 2, 1) @ by_point
        W, WV = self._matrix(mixed), self._matrix(mixed @ inverse[self.ties.point])
        n = self.views
        H = -(WV @ W.T).toarray()
        H.reshape(n, 6, n, 6)[range(n), :, range(n)] += A
        covariance = np.linalg.inv(H)
        moved = covariance @ ((g - prior).ravel() - WV @ h.ravel())
        follow = (inverse @ (h.ravel() - W.T @ moved).reshape(-1, 3, 1))[:, :, 0]
        return moved.reshape(-1, 6), points + follow, covariance

    def _residuals(
        self, R: Float[np.ndarray, "n 3 3"], c: Float[np.ndarray, "n 3"], points: Float[np.ndarray, "p 3"]
    ) -> tuple[Float[np.ndarray, "m 2"], Float[np.ndarray, "m 2 3"], Float[np.ndarray, "m 3"]]:
        """Residuals in the plane at depth 1, their derivatives by the point, and the point in camera axes."""
        axes = R[self.ties.image].transpose(0, 2, 1)
        P = (axes @ (points[self.ties.point] - c[self.ties.image])[:, :, None])[:, :, 0]
        z = P[:, 2]
        J = np.zeros((len(P), 2, 3))
        J[:, 0, 0] = J[:, 1, 1] = 1 / z
        J[:, :, 2] = -P[:, :2] / z[:, None] ** 2
        return P[:, :2] / z[:, None] - self.ties.plane, J @ axes, P

    def _weights(self, r: Float[np.ndarray, "m 2"]) -> Float[np.ndarray, " m"]:
        px = np.linalg.norm(r, axis=1) * self.focal
        robust = 1 / (1 + (px / self.config.outlier_px) ** 2) ** 2
        weights: Float[np.ndarray, " m"] = (self.focal / self.config.feature_px) ** 2 * robust
        return weights

    def _point_equations(
        self, J: Float[np.ndarray, "m 2 3"], w: Float[np.ndarray, " m"], r: Float[np.ndarray, "m 2"]
    ) -> tuple[Float[np.ndarray, "p 3 3"], Float[np.ndarray, "p 3"]]:
        """The normal equations of each point alone, lightly damped."""
        weighted = J * w[:, None, None]
        V = np.add.reduceat(weighted.transpose(0, 2, 1) @ J, self.starts)
        h = np.add.reduceat(-(weighted * r[:, :, None]).sum(1), self.starts)
        # Of a point whose observations all lost their weight nothing is left: it must still be invertible.
        damping = 1e-6 * np.trace(V, axis1=1, axis2=2) + np.finfo(np.float32).tiny
        return V + damping[:, None, None] * np.eye(3), h

    def _matrix(self, blocks: Float[np.ndarray, "m 6 3"]) -> csr_matrix:
        """Poses by points, a block for each observation."""
        counts = np.bincount(self.ties.image, minlength=self.views)
        indptr = np.concatenate([[0], np.cumsum(counts)])
        shape = (6 * self.views, 3 * self.points)
        return bsr_matrix((blocks[self.by_view], self.ties.point[self.by_view], indptr), shape).tocsr()
