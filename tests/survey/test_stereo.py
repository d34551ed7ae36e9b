"""Stereo: depth maps of a textured floor with a box on it are right, and as exact as their deviations say."""

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch
from tests.support.drawn import BOX as SCENE_BOX
from tests.support.drawn import HALF, hanging, pinhole_cameras, scene_of

from plnerf.errors import ConfigError
from plnerf.line import catenary
from plnerf.line.hang import hang
from plnerf.line.wire import Wire
from plnerf.scene.cameras import Cameras
from plnerf.survey.config_ground import OnWiresConfig
from plnerf.survey.on_wires import NONE, on_wires
from plnerf.survey.posed_photos import Photos, photos_of
from plnerf.survey.stereo.config import (
    CoarseConfig,
    ConsistencyConfig,
    MatchConfig,
    StereoConfig,
    StereoPairConfig,
)
from plnerf.survey.stereo.depth import DepthMap, agreed
from plnerf.survey.stereo.distances import distances_by_matching, distances_of_points, tried_distances
from plnerf.survey.stereo.pair import match_pair
from plnerf.survey.stereo.partners import partners
from plnerf.survey.stereo.stereo_surface import inflate_sigma, stereo_surface
from plnerf.survey.stereo.stereo_views import Picture, View, picture, shows_wires, view_of
from plnerf.survey.stereo.witnesses import Sight
from plnerf.survey.surface import Surface, joined

FLOOR = -0.5
BOX = np.array([[-0.3, 0.3, FLOOR], [0.2, 0.7, -0.1]])
RANDOM = np.random.default_rng(0)
WAVES, PHASES = RANDOM.normal(size=(60, 3)) * 45, RANDOM.uniform(0, 2 * np.pi, 60)
DISTANCE = 1.5
CONFIG = StereoConfig()


def depth_map(one: Picture, others: Sequence[Picture], near: float, config: MatchConfig) -> DepthMap:
    """Of the first picture, by its pairs with the others."""
    return agreed([match_pair(one, other, near, config)[0] for other in others], config)


def cast(view: View) -> tuple[np.ndarray, np.ndarray]:
    """Distance along each pixel's ray to the floor or the box (infinite in the sky), and its grey value."""
    rays, centre = view.rays(), view.centre
    with np.errstate(divide="ignore", invalid="ignore"):
        t = np.where(rays[..., 2] < -0.05, (FLOOR - centre[2]) / rays[..., 2], np.inf)
        sides = np.sort((BOX[:, None, None] - centre) / rays, axis=0)
    enter, leave = sides[0].max(-1), sides[1].min(-1)
    t = np.where((enter > 0) & (enter < leave), np.minimum(t, enter), t)
    at = centre + np.where(np.isfinite(t), t, 1.0)[..., None] * rays
    grey = 128 + 14 * np.sin(at @ WAVES.T + PHASES).sum(-1)
    return t, np.where(np.isfinite(t), grey, 200).clip(0, 255).astype(np.uint8)


def row_of_cameras(offsets: tuple[float, ...] = (0.0, 0.15, -0.2)) -> Cameras:
    """Beside one another, looking along y and a little down."""
    x = np.array(offsets)
    centres = np.stack([x, 0 * x - 1.0, 0 * x + 0.2], 1)
    return pinhole_cameras(centres, centres + np.array([0.0, 1.0, -0.35]))


def views_of(cameras: Cameras) -> list[View]:
    return [
        View(*(getattr(cameras, name)[i].double().numpy() for name in NAMES), *map(int, cameras.size_px[i]))
        for i in range(len(cameras))
    ]


NAMES = ("R_scene_camera", "centre", "focal_px", "principal_px", "distortion")


def taken(view: View) -> Picture:
    return Picture(view, cast(view)[1], np.ones((view.height, view.width), bool))


def mapped(views: list[View]) -> DepthMap:
    return depth_map(taken(views[0]), [taken(view) for view in views[1:]], DISTANCE, CONFIG.match)


def check(depths: DepthMap, true: np.ndarray, least_share: float = 0.6) -> None:
    """Dense, right, and no less exact than its deviation says: images without noise match to a third of it.
    In the sky, and where one pair alone has a match, some depths are wrong until the consistency filter has
    dropped them."""
    there, known = np.isfinite(true), np.isfinite(depths.t)
    assert known[there].mean() >= least_share and known[~there].mean() < 0.04
    error = np.abs(depths.t - true)[there & known]
    assert np.median(error) < 0.012 and np.quantile(error, 0.9) < 0.09
    score = error / depths.sigma[there & known]
    assert 0.15 < np.quantile(score, 0.683) < 1.0 and np.quantile(score, 0.954) < 2.0


def test_depth_is_right_and_as_exact_as_its_deviation_says() -> None:
    views = views_of(row_of_cameras())
    check(mapped(views), cast(views[0])[0])


@pytest.mark.parametrize("turn_deg", [35.0, 90.0, 180.0])
def test_turned_cameras_and_baselines_change_nothing(turn_deg: float) -> None:
    """Baselines upright or askew, and a partner that stands on its head."""
    c, s = np.cos(np.radians(turn_deg)), np.sin(np.radians(turn_deg))
    turn = np.array([[c, -s, 0], [s, c, 0], [0, 0, 1.0]])
    first, *others = views_of(row_of_cameras())
    check(mapped([replace(first, R_line_camera=first.R_line_camera @ turn), *others]), cast(
        replace(first, R_line_camera=first.R_line_camera @ turn))[0], 0.5)  # fmt: skip
    up = [replace(one, centre=first.centre + np.array([0, 0, one.centre[0]])) for one in others]
    check(mapped([first, *up]), cast(first)[0], 0.5)


def test_lens_size_and_focal_length_may_differ() -> None:
    first, second, third = views_of(row_of_cameras())
    bent = np.array([-0.12, 0.05, 0.001, -0.002, 0.0])
    first = replace(first, distortion=bent)
    wide = replace(second, width=280, principal_px=second.principal_px + np.array([20.0, 0]))
    zoomed = replace(third, focal_px=third.focal_px * 1.2)
    check(mapped([first, wide, zoomed]), cast(first)[0], 0.4)


def test_masks_hide_in_both_images() -> None:
    first, *others = views_of(row_of_cameras())
    hidden = np.ones((first.height, first.width), bool)
    hidden[100:] = False
    one, there = taken(first), [taken(view) for view in others]
    mine = depth_map(replace(one, valid=hidden), there, DISTANCE, CONFIG.match)
    assert np.isnan(mine.t[100:]).all() and np.isfinite(mine.t[60:95]).mean() > 0.5
    masked = [replace(picture, valid=hidden) for picture in there]
    theirs = depth_map(one, masked, DISTANCE, CONFIG.match)
    assert np.isnan(theirs.t[105:]).all() and np.isfinite(theirs.t[60:95]).mean() > 0.5


def test_one_partner_is_not_enough_but_where_the_other_shows_nothing() -> None:
    first, second, third = views_of(row_of_cameras())
    assert np.isnan(mapped([first, second]).t).all()
    one, blind = taken(first), taken(third)
    blind = replace(blind, valid=np.zeros_like(blind.valid))
    check(depth_map(one, [taken(second), blind], DISTANCE, CONFIG.match), cast(first)[0], 0.5)
    # A partner that shows something else contradicts.
    other = replace(taken(third), grey=np.roll(taken(third).grey, 9, axis=1))
    assert np.isfinite(depth_map(one, [taken(second), other], DISTANCE, CONFIG.match).t).mean() < 0.2


def test_partners_stand_beside_and_look_the_same_way() -> None:
    """A row of cameras, then one too near, one too far, one before, one that looks away, one that zooms."""
    row = views_of(row_of_cameras((0.0, 0.15, -0.2, 0.05, 0.8)))
    first = row[0]
    ahead = replace(first, centre=first.centre + 0.2 * first.axis + [0.09, 0, 0])
    c, s = np.cos(0.5), np.sin(0.5)
    turn = np.array([[c, -s, 0], [s, c, 0], [0, 0, 1]])
    away = replace(row[1], R_line_camera=turn @ row[1].R_line_camera)
    zoomed = replace(row[1], focal_px=row[1].focal_px * 2)
    smaller = replace(row[1], width=200, centre=row[1].centre + np.array([0.04, 0, 0]))
    views = [*row, ahead, away, zoomed, smaller]
    chosen = partners(views, np.full(len(views), DISTANCE), CONFIG.pairs)
    assert set(chosen[0]) == {1, 2, 8}
    assert partners(views, np.full(len(views), np.nan), CONFIG.pairs)[0] == ()
    near, far = (abs(row[k].centre[0]) / DISTANCE for k in (3, 4))
    assert near < CONFIG.pairs.min_baseline and far > CONFIG.pairs.max_baseline


def photos_with(folder: Path, cameras: Cameras, box: np.ndarray = SCENE_BOX) -> Photos:
    pictures = [np.repeat(cast(view)[1][..., None], 3, -1) for view in views_of(cameras)]
    return photos_of(scene_of(folder, cameras, pictures, box))


def by_x(one: Wire, x: np.ndarray) -> np.ndarray:
    return one.points(x - one.base.a[0])


def points(n: int, low: list[float], high: list[float], sigma: float = 0.1) -> Surface:
    xyz = np.random.default_rng(3).uniform(low, high, (n, 3))
    return Surface(xyz, np.zeros((n, 3), np.uint8), np.full(n, sigma), np.tile([0.0, 1.0, 0.0], (n, 1)))


def check_things(xyz: np.ndarray) -> None:
    """Points on the floor and the box, and on nothing else."""
    on_box = np.abs(np.maximum(BOX[0] - xyz, xyz - BOX[1]).max(1)) < 0.05
    assert len(xyz) > 5000 and (on_box | (np.abs(xyz[:, 2] - FLOOR) < 0.05)).mean() > 0.97


def test_of_the_field_only_wires_are_left(tmp_path: Path) -> None:
    """Floaters before the cameras and beneath the ground go; what lies on a wire, between its ends, stays."""
    photos = photos_with(tmp_path, row_of_cameras((0.0, 0.15, -0.2, 0.3)))
    hung, config = hanging(0.5, 0.3), replace(CONFIG, points=20_000)
    on = points(40, [-0.5, 0, 0], [0.5, 0, 0])
    on = replace(on, xyz=by_x(hung, on.xyz[:, 0]))
    beyond = replace(on, xyz=by_x(hung, on.xyz[:, 0] + 2 * HALF))
    field = joined([
        points(600, [-1, 0, FLOOR], [1, 1, FLOOR + 0.01]), points(80, [-0.3, -0.8, 0], [0.3, -0.7, 0.1]),
        points(80, [-1, 0, -1.2], [1, 1, -1]), beyond, on,
    ])  # fmt: skip
    found, findings = stereo_surface(photos, [hung], field, config)
    assert not findings and (found.xyz[-40:] == on.xyz).all()
    check_things(found.xyz[:-40])
    assert np.abs(np.linalg.norm(found.sight, axis=1) - 1).max() < 1e-6
    again, _ = stereo_surface(photos, [hung], field, config)
    assert (again.xyz == found.xyz).all()
    unknown = replace(hung, evidence=replace(hung.evidence, reach_m=None))
    assert len(stereo_surface(photos, [unknown], field, config)[0].xyz) == len(found.xyz) - 40


def test_without_pairs_the_field_is_all_there_is(tmp_path: Path) -> None:
    photos = photos_with(tmp_path, row_of_cameras((0.0, 1.5)))
    field = points(500, [-1, 0, FLOOR], [1, 1, FLOOR])
    found, (finding,) = stereo_surface(photos, [], field, CONFIG)
    assert found is field and (finding.kind, finding.degree) == ("stereo", "harms")
    assert finding.what == (
        "The images make no stereo (0 of 2 have two partners that look the same way from beside them): "
        "ground and plants are the field's alone, which may be metres off."
    )


def test_without_a_field_images_alone_show_the_same_things(tmp_path: Path) -> None:
    photos = photos_with(tmp_path, row_of_cameras((0.0, 0.15, -0.2, 0.3, -0.35, 0.45)))
    seen: list[tuple[int, int]] = []
    config = replace(CONFIG, points=30_000)
    found, findings = stereo_surface(photos, [], None, config, lambda *at: seen.append(at))
    assert not findings and seen == [(k + 1, 12) for k in range(12)]
    check_things(found.xyz)
    again, _ = stereo_surface(photos, [], None, config)
    assert (again.xyz == found.xyz).all()


def test_a_field_that_shows_nothing_leaves_the_distances_to_the_images(tmp_path: Path) -> None:
    photos = photos_with(tmp_path, row_of_cameras((0.0, 0.15, -0.2, 0.3, -0.35, 0.45)))
    config = replace(CONFIG, points=30_000)
    alone, _ = stereo_surface(photos, [], None, config)
    found, findings = stereo_surface(photos, [], Surface.empty(), config)
    assert not findings and (found.xyz == alone.xyz).all() and len(found.xyz)


def test_images_that_are_all_far_apart_are_matched_all_the_same(tmp_path: Path) -> None:
    photos = photos_with(tmp_path, row_of_cameras((0.0, 0.4, -0.4, 0.8, -0.8, 1.2)))
    config = replace(CONFIG, points=30_000)
    found, (finding,) = stereo_surface(photos, [], None, config)
    assert (finding.kind, finding.degree) == ("stereo", "harms") and "farther apart than 25%" in finding.what
    assert len(found.xyz) > 2000
    on_floor = np.abs(found.xyz[:, 2] - FLOOR) < 0.03
    assert (on_floor | (found.xyz[:, 2] > FLOOR)).mean() > 0.99 and on_floor.mean() > 0.5
    near = replace(config, pairs=replace(config.pairs, wide_baseline=config.pairs.max_baseline))
    assert not len(stereo_surface(photos, [], None, near)[0].xyz)


def test_of_many_images_each_gives_as_many_pixels_as_of_some(tmp_path: Path) -> None:
    photos = photos_with(tmp_path, row_of_cameras((0.0, 0.15, -0.2, 0.3, -0.35, 0.45)))
    few, _ = stereo_surface(photos, [], None, replace(CONFIG, points=6_000))
    more, _ = stereo_surface(photos, [], None, replace(CONFIG, points=6_000, most_sharing=2))
    assert 2.5 * len(few.xyz) < len(more.xyz) <= 18_000


def test_wires_far_below_the_cameras_are_no_background(tmp_path: Path) -> None:
    """Cameras that fly high along a short way: what the box around them holds is not what they show."""
    photos = photos_with(tmp_path, row_of_cameras((0.0, 0.15, -0.2, 0.3, -0.35, 0.45)))
    photos = replace(photos, box=np.array([[-0.1, -1.1, 0.1], [0.1, -0.9, 0.3]]))
    config, floor = replace(CONFIG, points=30_000), hang((-0.5, 0.5, -0.2), (0.5, 0.5, -0.2), 0.1)
    assert not len(stereo_surface(photos, [], None, config)[0].xyz)
    check_things(stereo_surface(photos, [floor], None, config)[0].xyz)


def test_without_a_field_and_pairs_there_is_nothing(tmp_path: Path) -> None:
    for count, offsets in ((2, (0.0, 1.5)), (1, (0.0,))):
        photos = photos_with(tmp_path / str(count), row_of_cameras(offsets))
        found, (finding,) = stereo_surface(photos, [hanging(0.5, 0.3)], None, CONFIG)
        assert len(found.xyz) == 0 and finding.degree == "harms" and finding.do
        assert finding.what == (
            f"The images make no stereo (0 of {count} have two partners that look the same way from beside "
            "them): neither ground nor plants are measured."
        )


def true_distances(views: Sequence[View], photos: Photos) -> np.ndarray:
    found = []
    for view in views:
        t = cast(view)[0]
        there = np.isfinite(t)
        there[there] = photos.within(view.centre + t[there][:, None] * view.rays()[there], CONFIG.farthest)
        found.append(np.quantile(t[there], CONFIG.coarse.quantiles))
    return np.array(found)


@pytest.mark.parametrize(("size", "ahead"), [(0.5, 0.0), (1.0, 0.0), (4.0, 0.0), (1.0, 3.0)])
def test_distances_by_matching_are_those_of_the_things(tmp_path: Path, size: float, ahead: float) -> None:
    """Whatever the box is: it only decides what is background."""
    photos = photos_with(tmp_path, row_of_cameras((0.0, 0.15, -0.2, 0.3, -0.35)))
    box = 1.5 * size * np.array([[-1.0] * 3, [1.0] * 3]) + [0.0, ahead, 0.0]
    photos = replace(photos, box=box)
    found = distances_by_matching(photos, [], CONFIG)
    true = true_distances([view_of(photos, i, CONFIG.coarse.longest_px) for i in photos.train], photos)
    assert np.abs(np.log(found / true)).max() < 0.15
    tried = tried_distances(photos, CONFIG)
    assert tried[0] == pytest.approx(CONFIG.farthest * 1.5 * size)
    assert np.array(tried[:-1]) / tried[1:] == pytest.approx(CONFIG.coarse.distance_step)


def test_views_without_depths_take_their_neighbours_distances(tmp_path: Path) -> None:
    """The last camera looks at the sky from beside the first."""
    cameras = row_of_cameras((0.0, 0.15, -0.2, 0.3, -0.02))
    cameras.R_scene_camera[4] = cameras.R_scene_camera[4] @ torch.tensor([[1.0, 0, 0], [0, 0, -1], [0, 1, 0]])
    found = distances_by_matching(photos_with(tmp_path, cameras), [], CONFIG)
    assert np.isfinite(found).all() and (found[4] == found[0]).all() and (found[1] != found[0]).all()


def test_views_that_show_too_little_have_no_distances(tmp_path: Path) -> None:
    """Nothing within the box, or too few pixels with a depth."""
    photos = photos_with(tmp_path, row_of_cameras())
    empty = replace(photos, box=np.array([[-0.1] * 3, [0.1] * 3]))
    assert np.isnan(distances_by_matching(empty, [], CONFIG)).all()
    assert np.isnan(distances_by_matching(photos, [], replace(CONFIG, min_share=0.99))).all()
    assert np.isfinite(distances_by_matching(photos, [], CONFIG)).all()


def test_settings_that_cannot_work_are_refused() -> None:
    with pytest.raises(ConfigError, match="wide_baseline >= max_baseline"):
        StereoPairConfig(wide_baseline=0.2)
    for make in (
        lambda: MatchConfig(block_px=4), lambda: MatchConfig(sigma_px=0.0),
        lambda: MatchConfig(max_parallax=0.0),
        lambda: StereoPairConfig(min_baseline=0.2), lambda: StereoPairConfig(partners=1),
        lambda: ConsistencyConfig(min_support=30), lambda: CoarseConfig(distance_step=1.0),
        lambda: StereoConfig(points=0), lambda: StereoConfig(most_sharing=0),
        lambda: StereoConfig(quantiles=(0.1, 0.5)),
        lambda: StereoConfig(quantiles=()), lambda: CoarseConfig(quantiles=(0.5, 0.0)),
    ):  # fmt: skip
        with pytest.raises(ConfigError, match="need"):
            make()


def test_large_images_are_reduced_as_their_cameras(tmp_path: Path) -> None:
    photos = photos_with(tmp_path, row_of_cameras())
    full, small = view_of(photos, 1, 1024), view_of(photos, 1, 100)
    one, rgb = picture(photos, 1, small, 100)
    assert rgb.shape == (60, 80, 3) and one.valid.shape == one.grey.shape == (60, 80) and one.valid.all()
    at = points(200, [-0.3, 0, FLOOR], [0.3, 1, 0]).xyz
    assert small.project(at)[0] * 3 == pytest.approx(full.project(at)[0], abs=1e-9)
    assert small.directions(small.project(at)[0]) * np.linalg.norm(at - full.centre, axis=1)[:, None] == (
        pytest.approx(at - full.centre, abs=1e-6)
    )


def test_distances_are_those_of_what_is_seen() -> None:
    views = views_of(row_of_cameras())
    seen = points(100, [-0.1, 0.5, FLOOR], [0.1, 0.5, FLOOR]).xyz
    apart = np.median(np.linalg.norm(seen - views[0].centre, axis=1))
    behind = seen * [1, -9, 1]
    ((typical, near),) = distances_of_points(views[:1], np.concatenate([seen, behind]), CONFIG)
    assert typical == pytest.approx(apart, abs=1e-3) and near < apart
    assert np.isnan(distances_of_points(views, behind, CONFIG)).all()


def test_points_smeared_along_their_sight_are_the_wires() -> None:
    """Seen along y, before a wire along x at y = 0: within three deviations they cannot be told from it."""
    sag = catenary.sag(40.0, 0.0, 150.0)
    wires = [hang((-20.0, y, 9.0), (20.0, y, 9.0), sag) for y in (0.0, 5.0)]
    low = wires[0].lowest[1]
    y = np.array([0.1, -0.2, -1.0, -1.0, -2.0, 5.1, 0.0])
    z = np.array([low, low, low, low + 0.5, low, low, low - 3])
    xyz = np.stack([0 * y, y, z], 1)
    n = len(y)
    surface = Surface(xyz, np.zeros((n, 3), np.uint8), np.full(n, 0.4), np.tile([0.0, 1.0, 0.0], (n, 1)))
    which, doubtful = on_wires(surface, wires, OnWiresConfig())
    assert which.tolist() == [0, 0, NONE, NONE, NONE, 1, NONE]
    assert doubtful.tolist() == [False, False, True, False, False, False, False]
    nowhere, none = on_wires(surface, [], OnWiresConfig())
    assert (nowhere == NONE).all() and not none.any()


def test_pixels_near_to_wires_are_marked() -> None:
    view, hung, px = views_of(row_of_cameras())[0], hanging(0.5, 0.0), CONFIG.wire_px
    near = shows_wires(view, [hung], CONFIG)
    pixel, inside = view.project(by_x(hung, np.linspace(-0.3, 0.3, 40)))
    column, row = pixel[inside].astype(int).T
    assert inside.all() and near[row, column].all() and near[row + px - 1, column].all()
    assert not near[row + px + 2, column].any() and not near[row - px - 2, column].any()
    assert not shows_wires(view, [], CONFIG).any()


def test_images_off_their_poses_make_points_less_certain() -> None:
    """0.3 px each, beside 0.4 px of the match."""
    surface = points(5, [0, 0, 0], [1, 1, 1], sigma=0.1)
    view = views_of(row_of_cameras())[0]
    sight = Sight.of(view, DepthMap(np.ones((8, 8)), np.full((8, 8), 0.1)))
    wider, (looser,) = inflate_sigma(surface, [sight], 0.3, CONFIG)
    np.testing.assert_allclose(wider.sigma_m, 0.1 * np.hypot(0.4, 0.3 * np.sqrt(2)) / 0.4)
    np.testing.assert_allclose(looser.sigma, wider.sigma_m[0], rtol=1e-6)
    same, _ = inflate_sigma(surface, [], 0.0, CONFIG)
    assert (same.sigma_m == surface.sigma_m).all()
