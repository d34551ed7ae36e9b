"""What holds wires, drawn before textured ground as photos of a flight towards it show it: it is found where
it stands, and what is fixed to the wires alone holds none."""

from collections.abc import Sequence

import cv2
import numpy as np
import pytest
from tests.support.drawn import InMemory, pinhole_cameras

from plnerf.errors import ConfigError
from plnerf.line.ends import TWO_SIDED_95
from plnerf.line.frame import LineFrame
from plnerf.line.hang import hang
from plnerf.line.wire import Wire
from plnerf.survey.chains import find_chains, junctions
from plnerf.survey.config_end_sweep import EndSweepConfig
from plnerf.survey.config_spans import ChainConfig
from plnerf.survey.config_wires import SupportConfig
from plnerf.survey.end_sweep import held_across
from plnerf.survey.held_places import Stands, held_places
from plnerf.survey.kinks import Held
from plnerf.survey.posed_photos import Photos
from plnerf.survey.span_wires import Junction
from plnerf.survey.stereo.stereo_views import View, view_of
from plnerf.survey.supports import find_supports, scenery_of
from plnerf.survey.surface import Surface

CONFIG = EndSweepConfig()
RANDOM = np.random.default_rng(2)
WAVES, PHASES = RANDOM.normal(size=(12, 2)) * 4.0, RANDOM.uniform(0, 2 * np.pi, 12)
END_M, HEIGHT_M = 40.0, 10.0
"""Where photos cease to show the wires, and at which height these are."""
Quad = tuple[np.ndarray, float]
"""Corners in space, and a grey value."""


def wires(apart_m: float = 2.4, count: int = 3) -> list[Wire]:
    """Side by side, along x."""
    y = (np.arange(count) - (count - 1) / 2) * apart_m
    return [hang((0.0, k, HEIGHT_M), (END_M, k, HEIGHT_M), 0.8) for k in y]


def upright(t: float, y: tuple[float, float], z: tuple[float, float], grey: float) -> Quad:
    """A rectangle across the line, z above the wires' ends."""
    x, low, high = END_M + t, HEIGHT_M + z[0], HEIGHT_M + z[1]
    return np.array([[x, y[0], low], [x, y[1], low], [x, y[1], high], [x, y[0], high]]), grey


def arm(t: float) -> list[Quad]:
    """A crossarm a metre above three wires, with what hangs from it, and a pole."""
    strings = [upright(t, (y - 0.08, y + 0.08), (0.0, 1.0), 60.0) for y in (-2.4, 0.0, 2.4)]
    return [
        upright(t, (-2.8, 2.8), (1.0, 1.25), 50.0),
        upright(t, (-0.2, 0.2), (-HEIGHT_M, 1.5), 80.0),
        *strings,
    ]


def pins(t: float) -> list[Quad]:
    """A crossarm below three wires, and pins that they stand on."""
    stands = [upright(t, (y - 0.06, y + 0.06), (-0.3, 0.0), 60.0) for y in (-2.4, 0.0, 2.4)]
    return [upright(t, (-2.8, 2.8), (-0.5, -0.3), 60.0), *stands]


def taken(
    view: View, things: Sequence[Quad], lines: Sequence[Wire], random: np.random.Generator
) -> np.ndarray:
    """The ground with its texture, the sky, the things and the wires, which go on."""
    rays = view.rays()
    with np.errstate(divide="ignore"):
        t = -view.centre[2] / rays[..., 2]
    at = (view.centre + t[..., None] * rays)[..., :2]
    ground = 120 + 11 * np.sin(at @ WAVES.T + PHASES).sum(-1)
    picture = np.where(rays[..., 2] < -0.02, ground, 200.0).astype(np.float32)
    for corners, grey in things:
        pixels, _ = view.project(corners)
        cv2.fillPoly(picture, [np.round(pixels * 16).astype(np.int32)], grey, cv2.LINE_AA, 4)
    for wire in lines:
        pixels, inside = view.project(wire.points(np.linspace(0.0, END_M + 15, 200)))
        cv2.polylines(
            picture, [np.round(pixels[inside] * 16).astype(np.int32)], False, 70.0, 1, cv2.LINE_AA, 4
        )
    noisy = np.clip(picture + random.normal(0, 2, picture.shape), 0, 255).astype(np.uint8)
    return np.repeat(noisy[..., None], 3, -1)


def filmed(
    things: Sequence[Quad], lines: Sequence[Wire], along: tuple[float, float] = (18.0, 33.0), count: int = 12
) -> Photos:
    """On a flight along the line, to and fro on both sides of it, a little above."""
    x = np.linspace(*along, count)
    centres = np.stack([x, np.where(np.arange(count) % 2, 5.0, -5.0), np.full(count, HEIGHT_M + 3)], 1)
    frame = LineFrame(np.eye(3), 1.0, np.zeros(3), "m", None, scene_per_unit=1.0)
    small = pinhole_cameras(centres, np.tile([END_M, 0.0, HEIGHT_M], (count, 1)))
    cameras = frame.cameras(small.at_size(2 * small.size_px))
    every, random = tuple(range(count)), np.random.default_rng(3)
    box = np.array([[0.0, -15.0, 0.0], [60.0, 15.0, 20.0]])
    names, sizes = tuple(map(str, every)), cameras.size_px.numpy()
    bare = Photos(frame, cameras, InMemory([]), InMemory([]), sizes, names, every, box)
    images = InMemory([taken(view_of(bare, i, 4000), things, lines, random) for i in every])
    return Photos(frame, cameras, images, images, sizes, names, every, box)


def last_junction(lines: Sequence[Wire]) -> Junction:
    (chain,) = find_chains(lines, ChainConfig())
    return junctions(chain, ChainConfig())[-1]


def found(photos: Photos, lines: Sequence[Wire]) -> tuple[float, int]:
    """Where most wires are held, and how many; of a single one something may be seen by chance."""
    return held_across(last_junction(lines), photos, -6.0, 6.0, CONFIG) or (np.nan, 0)


@pytest.mark.parametrize("t", [-1.25, 0.4, 2.9])
def test_what_holds_wires_is_found_where_it_stands(t: float) -> None:
    lines = wires()
    for things in (arm(t), pins(t)):
        place, count = found(filmed(things, lines), lines)
        assert place == pytest.approx(t, abs=0.1) and count >= 2


@pytest.mark.slow
def test_wires_that_go_on_are_held_nowhere() -> None:
    lines = wires()
    assert found(filmed([], lines), lines)[1] < 2
    bundle = wires(apart_m=0.4)
    assert found(filmed([], bundle), bundle)[1] < 2


@pytest.mark.slow
def test_what_is_fixed_to_wires_holds_none() -> None:
    """Spacers, dampers, and a ball."""
    lines = wires()
    dampers = [upright(1.0, (y - 0.1, y + 0.1), (-0.15, 0.0), 30.0) for y in (-2.4, 0.0, 2.4)]
    assert found(filmed(dampers, lines), lines)[1] < 2
    assert found(filmed([upright(1.0, (-0.3, 0.3), (-0.3, 0.3), 30.0)], lines), lines)[1] < 2
    bundle = wires(apart_m=0.4)
    spacers = [upright(1.0, (-0.4, 0.4), (-0.05, 0.05), 30.0)]
    assert found(filmed(spacers, bundle), bundle)[1] < 2


def test_few_photos_and_photos_from_aside_show_nothing() -> None:
    lines = wires()
    assert found(filmed(arm(0.4), lines, count=3), lines)[1] < 2
    assert found(filmed(arm(0.4), lines, along=(38.0, 42.0)), lines)[1] < 2


def test_a_structure_that_stereo_misses_is_seen_in_single_photos() -> None:
    lines = wires()
    random = np.random.default_rng(0)
    ground = np.column_stack([random.uniform(-10, 60, 4000), random.uniform(-20, 20, 4000), np.zeros(4000)])
    shown = Surface(
        ground, np.zeros((4000, 3), np.uint8), np.full(4000, 0.05), np.tile([0.0, 0.0, 1.0], (4000, 1))
    )
    photos, chains, config = filmed(arm(0.4), lines), find_chains(lines, ChainConfig()), SupportConfig()
    ((first, last),) = find_supports(
        scenery_of(shown, None, chains, config, photos), chains, config, ChainConfig()
    ).chains
    assert first.structure is None and last.structure is not None
    assert last.structure.foot == pytest.approx([END_M + 0.4, 0.0, 0.0], abs=0.1)
    # It may be the end of a tension string: such are shorter than phases are apart.  Or it is on the arm of
    # one of the outer wires, which may be turned where the next span is not seen.
    turned = 2.4 * np.tan(np.radians(CONFIG.half_turn_deg))
    doubts = [config.by_sweep_m, 0.8 * 2.4 / TWO_SIDED_95, turned]
    assert last.structure.sigma_m == pytest.approx(np.linalg.norm(doubts), rel=0.01)
    assert "single photos" in last.structure.evidence
    ((first, last),) = find_supports(
        scenery_of(shown, None, chains, config), chains, config, ChainConfig()
    ).chains
    assert last.structure is None


def test_a_wire_alone_is_not_held_by_what_single_photos_show() -> None:
    """Of an upper line's one wire that was found they agreed on a place 28 m from any structure."""
    lines, config = wires(count=1), SupportConfig()
    ground = Surface(np.zeros((1, 3)), np.zeros((1, 3), np.uint8), np.full(1, 0.05), np.array([[0.0, 0, 1]]))
    photos, chains = filmed(arm(0.4), lines), find_chains(lines, ChainConfig())
    assert found(photos, lines)[1] == 1
    ((_, last),) = find_supports(
        scenery_of(ground, None, chains, config, photos), chains, config, ChainConfig()
    ).chains
    assert last.structure is None


def test_wires_stand_on_pins_before_the_pole() -> None:
    """The middle one, before the pole itself, where those beside it on the arm do."""
    lines, config = wires(), SupportConfig()
    pole = upright(0.4, (-0.2, 0.2), (-HEIGHT_M, 0.2), 80.0)
    photos, junction = filmed([pole, *pins(0.15)], lines), last_junction(lines)
    before, after = held_places(junction, Stands(0.4, 0.05, 0.0), None, photos, config)
    assert not len(after) and before[:, 0] == pytest.approx(np.full(3, 0.15), abs=0.1)
    assert before[:, 1] == pytest.approx(np.hypot(0.05, config.by_pin_m))
    hung = Stands(0.4, 0.05, 0.0, hung=(True, False, True))
    (first, middle, last), _ = held_places(junction, hung, None, photos, config)
    assert tuple(first) == tuple(last) == (0.4, 0.05)  # nothing is asked of what hangs
    assert tuple(middle) == pytest.approx((0.4, np.hypot(0.05, config.pin_m)))


def test_without_photos_wires_that_nothing_hangs_from_may_stand_on_pins() -> None:
    lines, config = wires(), SupportConfig()
    places, _ = held_places(last_junction(lines), Stands(0.4, 0.05, 0.0), None, None, config)
    assert places == pytest.approx(np.tile([0.4, np.hypot(0.05, config.pin_m)], (3, 1)))
    kinks = Held(0.4, 0.03, {}, 2)
    places, _ = held_places(last_junction(lines), Stands(0.4, 0.03, 0.0), kinks, None, config)
    assert places[:, 1] == pytest.approx(np.linalg.norm([0.03, config.kink.arms_m, config.pin_m]))


@pytest.mark.parametrize("wrong", [{"step_m": 0.0}, {"photos": 1}, {"height_m": (1.0, 0.0)}])
def test_settings_that_make_no_sense_are_refused(wrong: dict[str, object]) -> None:
    with pytest.raises(ConfigError, match="A sweep"):
        EndSweepConfig(**wrong)  # type: ignore[arg-type]  # of several types
