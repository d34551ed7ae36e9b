"""Tops of crowns that are single leaves, drawn before a ground that is known: they are found, and nothing
else is."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pytest
from tests.support.drawn import InMemory, pinhole_cameras

from plnerf.errors import ConfigError
from plnerf.line.cloud import GROUND, HIGH_VEGETATION, NO_WIRE, NOT_JUDGED, Cloud
from plnerf.line.frame import LineFrame
from plnerf.line.hang import hang
from plnerf.line.wire import Wire
from plnerf.survey.config import SurveyConfig
from plnerf.survey.config_crown_tops import CrownTopConfig
from plnerf.survey.crown_tops import _last, with_crown_tops
from plnerf.survey.posed_photos import Photos
from plnerf.survey.stereo.config import BackdropConfig
from plnerf.survey.stereo.depth import DepthMap
from plnerf.survey.stereo.stereo_views import View, view_of
from plnerf.survey.stereo.witnesses import Sight

CONFIG = SurveyConfig()
RANDOM = np.random.default_rng(2)
WAVES, PHASES = RANDOM.normal(size=(3, 30, 2)) * 2.0, RANDOM.uniform(0, 2 * np.pi, (3, 30))
FOUND_M, TIP_M, WIRE_M = 3.0, 6.0, 9.0
"""Heights: of the crown's points, of its leaves, of the wire."""


def leaves(top_m: float, x: float = 0.0, y: float = 0.0, count: int = 150) -> np.ndarray:
    """Places of leaves within 0.4 m of an upright axis, from the crown's points on."""
    random = np.random.default_rng(5)
    z = random.uniform(FOUND_M - 1, top_m, count)
    return np.stack([x + random.uniform(-0.4, 0.4, count), y + random.uniform(-0.4, 0.4, count), z], 1)


def distances(view: View, half_m: float = 0.0) -> np.ndarray:
    """Along every pixel's ray to the flat ground at 0, or to a crown so wide that stereo knows; NaN in the
    sky."""
    rays = view.rays()
    with np.errstate(divide="ignore"):
        t, to_crown = ((z - view.centre[2]) / rays[..., 2] for z in (0.0, FOUND_M))
    on_crown = (np.abs((view.centre + to_crown[..., None] * rays)[..., :2]) < half_m).all(-1)
    return np.where(rays[..., 2] < -0.05, np.where(on_crown, to_crown, t), np.nan)


def taken(
    view: View, t: np.ndarray, places: np.ndarray, random: np.random.Generator, specks: int
) -> np.ndarray:
    """The ground, and leaves of two pixels, light or dark, before it; and specks anywhere in the photo."""
    at = (view.centre + np.nan_to_num(t)[..., None] * view.rays())[..., :2]
    colours = [np.sin(at @ waves.T + phases).sum(-1) for waves, phases in zip(WAVES, PHASES, strict=True)]
    picture = np.where(np.isnan(t)[..., None], 120.0, 120 + 8 * np.stack(colours, -1))
    pixels, inside = view.project(places)
    tones = np.random.default_rng(7).choice([40.0, 210.0], len(places))
    for (column, row), tone in zip(pixels[inside].astype(int), tones[inside], strict=True):
        picture[row : row + 2, column : column + 2] = tone
    for column, row in random.integers(0, (view.width, view.height), (specks, 2)):
        picture[row : row + 2, column : column + 2] = 210.0
    return np.clip(picture + random.normal(0, 2, picture.shape), 0, 255).astype(np.uint8)


def filmed(
    places: np.ndarray, count: int = 10, specks: int = 0, above_m: float = 12.0, beside_m: float = 9.0,
    half_m: float = 0.0,
) -> tuple[Photos, list[Sight]]:  # fmt: skip
    """From around the crown, so far above the ground; stereo knows the ground, and a crown `half_m` wide."""
    turn = np.arange(count) * 2 * np.pi / max(count, 10)
    centres = np.stack([beside_m * np.cos(turn), beside_m * np.sin(turn), np.full(count, above_m)], 1)
    frame = LineFrame(np.eye(3), 1.0, np.zeros(3), "m", None, scene_per_unit=1.0)
    cameras = frame.cameras(pinhole_cameras(centres, np.tile([0.0, 0.0, 4.0], (count, 1))))
    every, random = tuple(range(count)), np.random.default_rng(3)
    box = np.array([[-15.0, -15.0, 0.0], [15.0, 15.0, 15.0]])
    names, sizes = tuple(map(str, every)), cameras.size_px.numpy()
    bare = Photos(frame, cameras, InMemory([]), InMemory([]), sizes, names, every, box)
    views = [view_of(bare, i, CONFIG.crown_tops.longest_px) for i in every]
    depths = [distances(view, half_m) for view in views]
    images = InMemory([taken(view, t, places, random, specks) for view, t in zip(views, depths, strict=True)])
    sights = [
        Sight.of(view, DepthMap(t, np.full(t.shape, 0.05)), i)
        for i, (view, t) in enumerate(zip(views, depths, strict=True))
    ]
    return replace(bare, images=images, full=images), sights


def crown_and_ground() -> Cloud:
    """A crown whose points end at FOUND_M, on ground with a point each half metre."""
    flat = np.stack(np.meshgrid(np.arange(-12, 12, 0.5), np.arange(-12, 12, 0.5)), -1).reshape(-1, 2)
    random = np.random.default_rng(4)
    crown = random.uniform([-0.8, -0.8, 1.0], [0.8, 0.8, FOUND_M], (400, 3))
    crown[0] = [0.0, 0.0, FOUND_M]
    xyz = np.concatenate([np.column_stack([flat, np.zeros(len(flat))]), crown])
    of_crown = np.arange(len(xyz)) >= len(flat)
    return Cloud(
        xyz, np.where(of_crown, HIGH_VEGETATION, GROUND).astype(np.uint8), np.full(len(xyz), NO_WIRE),
        np.full((len(xyz), 3), 90, np.uint8), np.full(len(xyz), 0.1),
        seen=np.where(of_crown, 9, NOT_JUDGED), past=np.where(of_crown, 0, NOT_JUDGED),
    )  # fmt: skip


def above_it(y: float = 2.0, height_m: float = WIRE_M) -> list[Wire]:
    return [replace(hang((-20.0, y, height_m), (20.0, y, height_m), 0.3), id=1)]


def added(places: np.ndarray, wires: Sequence[Wire] | None = None, count: int = 10, **flight: float) -> Cloud:
    """The points that are added to the cloud."""
    cloud, (photos, sights) = crown_and_ground(), filmed(places, count, **flight)  # type: ignore[arg-type]
    found, findings = with_crown_tops(cloud, photos, sights, above_it() if wires is None else wires, CONFIG)
    n = len(cloud.xyz)
    np.testing.assert_array_equal(found.xyz[:n], cloud.xyz)
    assert len(findings) == (len(found.xyz) > n)
    assert found.seen is not None and found.past is not None and found.sigma_m is not None
    return Cloud(
        found.xyz[n:], found.label[n:], found.wire[n:], None, found.sigma_m[n:], None, found.seen[n:],
        found.past[n:],
    )  # fmt: skip


def test_a_crown_goes_on_as_far_as_its_leaves_do() -> None:
    found = added(leaves(TIP_M))
    assert found.xyz[-1, 2] == pytest.approx(TIP_M, abs=0.4)
    assert np.abs(found.xyz[:, :2]).max() < 0.45 and (np.diff(found.xyz[:, 2]) >= 0).all()
    assert (found.label == HIGH_VEGETATION).all() and (found.wire == NO_WIRE).all()
    assert found.sigma_m == pytest.approx(CONFIG.crown_tops.sigma_m)
    assert found.seen is not None and found.past is not None
    assert (found.seen >= found.past).all() and (found.seen + found.past <= 10).all()


@pytest.mark.slow
def test_tops_before_the_sky_are_found_too() -> None:
    """From below the top, above which the photos are silent."""
    assert added(leaves(TIP_M), count=20, above_m=3.5).xyz[-1, 2] == pytest.approx(TIP_M, abs=0.4)
    assert len(added(np.zeros((0, 3)), count=20, above_m=3.5).xyz) == 0


def test_a_crown_seen_from_above_is_not_higher_for_it() -> None:
    """Half a metre above its top a camera 11 m above it sees what is hardly farther away."""
    assert len(added(np.zeros((0, 3)), above_m=14.0, beside_m=3.0, half_m=0.6).xyz) == 0


@pytest.mark.parametrize("bare", [np.zeros((0, 3)), leaves(TIP_M, x=3.0, y=-2.0)], ids=["none", "aside"])
def test_without_leaves_above_it_nothing_is_added(bare: np.ndarray) -> None:
    """The photos are as noisy; leaves 3.6 m aside are before and behind the axis in a few photos only."""
    assert len(added(bare).xyz) == 0


@pytest.mark.slow
def test_what_is_everywhere_adds_nothing() -> None:
    """Of five windows the one on the axis has most specks in every fifth photo."""
    assert len(added(np.zeros((0, 3)), specks=1500).xyz) == 0
    assert added(leaves(TIP_M, count=300), specks=300).xyz[-1, 2] == pytest.approx(TIP_M, abs=0.6)


@pytest.mark.slow
def test_nothing_is_looked_for_at_a_wire_nor_far_from_all() -> None:
    low = added(leaves(TIP_M), above_it(0.0, 5.5))
    assert low.xyz[-1, 2] <= 5.5 - 0.2 - CONFIG.crown_tops.below_wire_m
    assert len(added(leaves(TIP_M), above_it(30.0)).xyz) == 0 == len(added(leaves(TIP_M), []).xyz)


@pytest.mark.parametrize("count", [1, 2])
def test_two_photos_are_too_few(count: int) -> None:
    assert len(added(leaves(TIP_M), count=count).xyz) == 0


@pytest.mark.parametrize(("shown", "last"), [("", 0), ("-xx-x--x", 5), ("--x", 0), ("xxxx", 4), ("-x-", 2)])
def test_a_crown_ends_at_a_gap(shown: str, last: int) -> None:
    assert _last(np.array([one == "x" for one in shown], np.bool_), 2) == last


@pytest.mark.parametrize("wrong", [{"chance": 0.0}, {"step_m": 0.0}, {"least_share": 1.5}, {"longest_px": 8}])
def test_wrong_settings_are_refused(wrong: dict[str, float]) -> None:
    with pytest.raises(ConfigError, match="Tops of crowns need"):
        CrownTopConfig(**wrong)  # type: ignore[arg-type]
    with pytest.raises(ConfigError, match="Backdrops need"):
        BackdropConfig(samples=1)
