"""Catenaries found in images, refitted to them: to a tenth of a pixel rather than one.

Each round projects the wires into every training image, reads what the grey values across them say
(`profile.py`), and adjusts all wires, the images' motions and the light together (`adjust.py`).  How much the
images move is learnt on the way: of exact poses nothing, of poses by structure from motion tenths of a pixel.
"""

from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, fields, replace

import cv2
import numpy as np
from jaxtyping import Float

from plnerf.scene.cameras import Cameras
from plnerf.scene.scene import Scene
from plnerf.survey.fit import LEAST_BEND_M, Base
from plnerf.survey.refine.adjust import VIEWS, Prior, State, Step, adjust
from plnerf.survey.refine.profile import Sightings, sightings
from plnerf.survey.refine.projection import Track, track

SAMPLES = 240
"""Along a wire."""
FIRST_BLUR_PX, BLUR_PX = 1.2, 0.6
"""Of the profile that is looked for, in the first round, for wires a pixel or two off, and in all others."""
LEAST_ROUNDS, MOST_ROUNDS = 4, 16
SETTLED_PX = 0.02
"""Rounds end where no wire moves by more."""
MOTION_PX, LEAST_MOTION_PX = 0.1, 0.05
"""Standard deviation of the images' motions at first, and at least."""
SYSTEMATIC_PX = 0.2
"""What first order in the light leaves: a displacement the same all along a wire.  Measured on rendered wires
under a sun, 0.1 to 0.3 px."""
UNDESCRIBED = 0.3
"""Of an image's motion, the share that one motion for near and far wires does not describe."""
LEAST_VISIBLE = 0.03
"""Share of its sightings at which a wire must stand out; of noise, a hundredth does."""
LEAST_VIEWS = 3
NEAR_PX = 1.0
"""A wire is seen at a sighting that has it so near."""
LEAST_NEAR = 0.5
"""Share of the sightings that must have it so."""
NO_NEWS = 0.7
"""A wire's place is not fixed where its standard deviation stays above this share of what it was."""


@dataclass(frozen=True, eq=False)
class Refined:
    """One wire after refinement; as it was before where `refused` says why."""

    q: Float[np.ndarray, "5"]
    covariance: Float[np.ndarray, "5 5"]
    """In the scene's unit squared."""
    views: int
    """Images with sightings of it."""
    refused: str | None


@dataclass(frozen=True, eq=False)
class Refinement:
    """Of all wires."""

    wires: tuple[Refined, ...]
    motion_px: float
    """Standard deviation of what the images' poses are off by, as their wires show it."""


def refine(
    scene: Scene,
    base: Base,
    wires: Sequence[Float[np.ndarray, "5"]],
    trust: Sequence[float],
    diameter: float,
    tell: Callable[[int, int], object] = lambda done, of: None,
) -> Refinement:
    """Refits wires of the scene frame to its training images.

    base: along the wires, in the scene frame.  trust: standard deviation of where each wire is; one that
    moves more than twice as far is refused.  diameter: of the wires, about; from a third of the
    true one to half as much again, the result moves by 0.2 px at most.  Needs one wire or more.
    """
    views = list(scene.train)
    cameras = [double(scene.cameras[[i]]) for i in views]
    s = np.linspace(0, base.length_m, SAMPLES)
    before = np.array(wires, np.float64)
    N, W = len(views), len(wires)
    state = State(before, np.zeros((N, 3)), np.zeros((W, VIEWS)), np.zeros((W, 2)), np.zeros(2))
    prior = Prior(before, np.array(trust), diameter, MOTION_PX)
    found: list[list[Sightings]] = []
    for k in range(MOST_ROUNDS):
        blur = BLUR_PX if k else FIRST_BLUR_PX

        def look(n: int, state: State = state, blur: float = blur) -> list[Sightings]:
            tracks = [track(cameras[n], base, q, s, state.motion[n]) for q in state.q]
            return _of_image(scene, views[n], tracks, blur, diameter)

        with ThreadPoolExecutor() as pool:
            found = list(pool.map(look, range(N)))
        step = adjust(base, state, prior, found)
        last, state = state, replace(step.state, q=np.maximum(step.state.q, [*[-np.inf] * 4, LEAST_BEND_M]))
        prior = replace(prior, motion_px=max(step.motion_px(), LEAST_MOTION_PX))
        tell(k + 1, MOST_ROUNDS)
        moved = max(_between(base, *both, s) for both in zip(last.q, state.q, strict=True))
        if k + 1 >= LEAST_ROUNDS and moved * step.pixels_per_unit < SETTLED_PX:
            break
    tell(MOST_ROUNDS, MOST_ROUNDS)
    wires_now = tuple(_judged(base, prior, step, w, found, s) for w in range(W))
    return Refinement(wires_now, step.motion_px())


def _between(
    base: Base, q: Float[np.ndarray, "5"], other: Float[np.ndarray, "5"], s: Float[np.ndarray, " k"]
) -> float:
    """Greatest distance between two wires."""
    return float(np.linalg.norm(base.at(q, s) - base.at(other, s), axis=1).max())


def double(cameras: Cameras) -> Cameras:
    """In float64."""
    values = [getattr(cameras, one.name) for one in fields(cameras)]
    return Cameras(*(value.double() if value.is_floating_point() else value for value in values))


def _of_image(
    scene: Scene, i: int, tracks: list[Track], blur_px: float, diameter: float
) -> list[Sightings]:
    """The sightings of each wire in one image."""
    # Of bytes, interpolation gives bytes.
    grey = cv2.cvtColor(scene.images.image(i), cv2.COLOR_RGB2GRAY).astype(np.float32)
    valid = scene.images.valid(i) if scene.images.has_masks else None
    return [
        sightings(grey, valid, mine, tracks[:w] + tracks[w + 1 :], blur_px, diameter)
        for w, mine in enumerate(tracks)
    ]


def _judged(
    base: Base, prior: Prior, step: Step, w: int, found: Sequence[Sequence[Sightings]],
    s: Float[np.ndarray, " k"],
) -> Refined:  # fmt: skip
    """Whether a wire's refinement is to be believed."""
    rows = [row[w] for row in found]
    views, count = sum(len(row) > 0 for row in rows), sum(len(row) for row in rows)
    e, q = step.usable[w], step.state.q[w]
    near = np.abs(e) <= NEAR_PX
    moved = _between(base, prior.q[w], q, s)
    J = base.by_q(q, s)
    own = step.of_wire(w)
    sigma = float(np.sqrt(np.linalg.eigvalsh(J @ own @ J.transpose(0, 2, 1))[:, -1].min()))
    refused = None
    if views < LEAST_VIEWS or not len(e):
        refused = f"{views} images show it"
    elif sigma > NO_NEWS * prior.trust[w]:
        refused = "the views do not fix it better than it was"
    elif len(e) < LEAST_VISIBLE * count:
        refused = f"it stands out at {len(e) / count:.1%} of the places where it is looked for"
    elif near.mean() < LEAST_NEAR:
        refused = f"{near.mean():.0%} of what is seen there lies within a pixel of it"
    elif moved > 2 * prior.trust[w]:
        refused = f"it went {moved / prior.trust[w]:.1f} times as far as it may be off"
    if not len(e):
        return Refined(prior.q[w], own, views, refused)
    same = np.kron(np.eye(2), np.ones((2, 2)))  # y0 with y1, z0 with z1
    common = np.hypot(SYSTEMATIC_PX, UNDESCRIBED * step.motion_px()) / step.pixels_per_unit
    own = own + np.pad(same * common**2, (0, 1))
    return Refined(prior.q[w] if refused else q, own, views, refused)
