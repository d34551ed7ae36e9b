"""What tie points leave unknown of poses, as pixels of a wire's picture, and what is each image's own."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch
from scipy.spatial.transform import Rotation
from tests.support.drawn import scene_of, two_passes
from tests.survey.test_refine import BASE, CONFIG, MOVED, PIXEL, STILL, WIRES, lit, off

from plnerf.scene.cameras import Cameras
from plnerf.survey.posed_photos import photos_of
from plnerf.survey.refine.pose_prior import PosePrior, prior_of
from plnerf.survey.refine.projection import MOVES, places_along, project_wire
from plnerf.survey.refine.refine import refine_wires

USUAL = 0.45


def changed(cameras: Cameras, by: np.ndarray) -> Cameras:
    """Cameras whose centres are moved and whose axes are turned by the six numbers of each."""
    turn = torch.from_numpy(Rotation.from_rotvec(by[:, 3:]).as_matrix()).to(cameras.R_scene_camera)
    centre = cameras.centre + torch.from_numpy(by[:, :3]).to(cameras.centre)
    return replace(cameras, centre=centre, R_scene_camera=turn @ cameras.R_scene_camera)


def test_a_change_of_poses_is_what_its_covariance_says_in_the_pictures(tmp_path: Path) -> None:
    """That of one certain change has one residual for each image: the one by which its wire moves."""
    cameras, random = two_passes(4), np.random.default_rng(2)
    scene = scene_of(tmp_path, cameras, lit(cameras, WIRES[0]))
    by = 1e-4 * random.normal(size=(len(cameras), 6))
    photos = photos_of(scene, np.outer(by.ravel(), by.ravel()))
    shared = prior_of(photos, USUAL, 0.1).shared
    assert shared is not None
    value, axes = np.linalg.eigh(shared)
    residuals = (np.sqrt(value[-1]) * axes[:, -1]).reshape(-1, MOVES)
    assert value[-2] < 1e-9 * value[-1]
    there = changed(photos.cameras, by)
    places = places_along(BASE, WIRES[0].theta, np.linspace(0.2, 1.2, 21))
    told, seen = [], []
    for n in range(len(cameras)):
        here = project_wire(photos.cameras[[n]], places, STILL, USUAL, CONFIG.profile.end_on)
        middle = here.good & (np.abs(here.pixel - photos.cameras.size_px[n].numpy() / 2) < 40).all(1)
        moved = project_wire(there[[n]], places, STILL, USUAL, CONFIG.profile.end_on)
        seen.append((moved.pixel - here.pixel)[middle])
        of = project_wire(photos.cameras[[n]], places, residuals[n], USUAL, CONFIG.profile.end_on)
        told.append((of.pixel - here.pixel)[middle])
    both = [np.concatenate(part) for part in (told, seen)]
    sign = np.sign((both[0] * both[1]).sum())  # the eigenvector's is arbitrary
    assert len(both[0]) > 20
    assert np.linalg.norm(sign * both[0] - both[1]) < 0.05 * np.linalg.norm(both[1])


def test_what_is_each_images_own_is_told_from_what_is_shared() -> None:
    random, n = np.random.default_rng(5), 60
    root = np.kron(np.ones((n, 1)), np.diag([1.0, 1.0, 0.5, 2.0, 2.0, 1.0]))  # all images off alike
    own = np.tile([0.3, 0.3, 0.3, 0.1, 0.1, 0.1], n)
    residuals = root @ random.normal(size=MOVES) + own * random.normal(size=MOVES * n)
    exact = np.zeros((MOVES * n, MOVES * n))
    prior = PosePrior(np.full(MOVES, 1.0), root @ root.T)
    for _ in range(60):
        prior = prior.learnt(residuals.reshape(n, MOVES), exact, 0.01)
    assert prior.sd_px == pytest.approx([0.3, 0.3, 0.3, 0.1, 0.1, 0.1], rel=0.2)
    alone = PosePrior(np.full(MOVES, 1.0)).learnt(residuals.reshape(n, MOVES), exact, 0.01)
    assert alone.sd_px[0] > 0.5  # without knowing what is shared, all of it


def test_without_measurements_nothing_is_learnt() -> None:
    root = np.random.default_rng(6).normal(size=(3 * MOVES, 4))
    for shared in (None, root @ root.T):
        prior = PosePrior(np.repeat([0.4, 0.2], 3), shared)
        unknown = np.linalg.inv(prior.precision(3))
        after = prior.learnt(np.zeros((3, MOVES)), unknown, 0.01)
        np.testing.assert_allclose(after.sd_px, prior.sd_px, rtol=1e-9)


def test_wires_are_as_uncertain_as_the_images_together(tmp_path: Path) -> None:
    """All cameras are off alike by what the covariance says: so are the wires, and they say so."""
    cameras, by = two_passes(8), np.array([0.0, 1.5 * PIXEL, 2 * PIXEL, 0.0, 0.0, 0.0])
    alike = np.tile(by, len(cameras))
    scene = scene_of(tmp_path, changed(cameras, -alike.reshape(-1, 6)), lit(cameras, *WIRES))
    each = np.diag([1e-9, *(by[1:3] ** 2), 1e-12, 1e-12, 1e-12])
    covariance = np.kron(np.ones((len(cameras),) * 2), each)
    known = refine_wires(photos_of(scene, covariance), MOVED, CONFIG)
    unknown = refine_wires(photos_of(scene), MOVED, CONFIG)
    s = np.linspace(0.1, 0.9, 9) * BASE.length_m
    for one, other, wire in zip(known.wires, unknown.wires, WIRES, strict=True):
        told, untold = (np.abs(off(of, wire)).mean(0) * PIXEL for of in (one, other))
        assert (untold > 4 * other.sigma_at(s).mean(0)).any()
        assert (told < 2 * one.sigma_at(s).mean(0)).all()
