"""The points that a line scanner measures of a site.

A strip's scanner flies along the line at height H above the origin, `across_m` beside it, and sends its beams
square to its track.  A beam is named by where it meets the plane z = 0: u along the line and v across it; at
height z it is at u and y0 + (v - y0) (H - z) / H.  Whatever lies within the beam's footprint there may return
its light, and is placed on the beam's axis at its own height.
"""

import numpy as np
from jaxtyping import Float, Int
from scipy.spatial import cKDTree

from plnerf.synth.lidar_bodies import KINDS, RETURNS, SOLID, Targets, hung
from plnerf.synth.lidar_config import LidarScene, ScanConfig
from plnerf.synth.site import Site

HITS = 3
"""Beams at most that return light from one target: the nearest."""
APART_M = 0.4
"""Targets of one beam that are nearer to each other than this return one pulse."""
GROUND_ROUNDS = 6
THROUGH_LEAF = 0.6
"""Share of beams that still reach the ground below each leaf that they met."""


def scan(
    site: Site, scene: LidarScene, still: Targets, rng: np.random.Generator
) -> tuple[Float[np.ndarray, "n 3"], Int[np.ndarray, " n"]]:
    """Points of all strips in the world, and the number of each one's strip."""
    count = len(scene.scan.across_m)
    shift = scene.scan.strip_sd_m * rng.normal(size=(count, 3))
    shift -= shift.mean(0)  # nothing in a cloud shows by how much all of it is off
    points = [_strip(site, scene, still, k, rng) + shift[k] for k in range(count)]
    return np.concatenate(points), np.repeat(np.arange(len(points)), [len(some) for some in points])


def _strip(
    site: Site, scene: LidarScene, still: Targets, strip: int, rng: np.random.Generator
) -> Float[np.ndarray, "n 3"]:
    scan, y0 = scene.scan, scene.scan.across_m[strip]
    wires = np.concatenate([hung(wire, scene, strip) for wire in site.wires])
    at = np.concatenate([still.at, wires])
    kind = np.concatenate([still.kind, np.full(len(wires), KINDS.index("wire"))])
    u, v = _beams(scene, rng)
    beam, z, hit = _returns(_on_plane(site, at, y0, scan), at[:, 2], kind, np.stack([u, v], 1), scan, rng)
    ground = _ground(site, u, v, y0, scan)
    beam, z, hit = (
        np.concatenate(both)
        for both in ((beam, np.arange(len(u))), (z, ground), (hit, np.zeros(len(u), np.int64)))
    )
    use = _kept(beam, z, hit, ground, rng)
    beam, z = beam[use], z[use] + scan.range_sd_m * rng.normal(size=use.sum())
    y = y0 + (v[beam] - y0) * (scan.height_m - z) / scan.height_m
    local = np.stack([u[beam], y], 1) + scan.pointing_sd_m * rng.normal(size=(len(beam), 2))
    return np.column_stack([_to_world(site, local), z])


def _beams(
    scene: LidarScene, rng: np.random.Generator
) -> tuple[Float[np.ndarray, " k"], Float[np.ndarray, " k"]]:
    """Where the beams of a strip meet z = 0: in rows across the line, as a turning mirror sends them."""
    scan, half = scene.scan, scene.span.span_length_m / 2 + scene.scan.beyond_m
    step = scan.pulses_per_m2**-0.5
    u, v = np.meshgrid(np.arange(-half, half, step), np.arange(-scan.corridor_m, scan.corridor_m, step))
    v = v + step * rng.random(u.shape[1])  # pulses and mirror do not keep step: rows begin anywhere
    u = u + step * (v / (2 * scan.corridor_m) + rng.random())  # the aircraft flies on during a row
    jitter = step * rng.uniform(-0.3, 0.3, (2, u.size))
    return u.ravel() + jitter[0], v.ravel() + jitter[1]


def _on_plane(
    site: Site, at: Float[np.ndarray, "t 3"], y0: float, scan: ScanConfig
) -> Float[np.ndarray, "t 2"]:
    """u and v of the beams through targets."""
    ux, uy = site.along
    along, across = at[:, 0] * ux + at[:, 1] * uy, at[:, 1] * ux - at[:, 0] * uy
    return np.stack([along, y0 + (across - y0) * scan.height_m / (scan.height_m - at[:, 2])], 1)


def _to_world(site: Site, local: Float[np.ndarray, "n 2"]) -> Float[np.ndarray, "n 2"]:
    ux, uy = site.along
    return np.stack([local[:, 0] * ux - local[:, 1] * uy, local[:, 0] * uy + local[:, 1] * ux], 1)


def _ground(
    site: Site, u: Float[np.ndarray, " k"], v: Float[np.ndarray, " k"], y0: float, scan: ScanConfig
) -> Float[np.ndarray, " k"]:
    """Height at which each beam meets the ground."""
    z = np.zeros(len(u))
    for _ in range(GROUND_ROUNDS):
        y = y0 + (v - y0) * (scan.height_m - z) / scan.height_m
        z = site.ground.heights(*_to_world(site, np.stack([u, y], 1)).T)
    return z


def _returns(
    plane: Float[np.ndarray, "t 2"], z: Float[np.ndarray, " t"], kind: Int[np.ndarray, " t"],
    beams: Float[np.ndarray, "k 2"], scan: ScanConfig, rng: np.random.Generator,
) -> tuple[Int[np.ndarray, " h"], Float[np.ndarray, " h"], Int[np.ndarray, " h"]]:  # fmt: skip
    """Beam, height and kind of what returns light."""
    distance, beam = cKDTree(beams).query(plane, HITS, distance_upper_bound=scan.footprint_m, workers=-1)
    target, nth = np.nonzero(np.isfinite(distance))
    beam = beam[target, nth]
    # Of a wire the place nearest to the beam's axis: the highest within the footprint would be uphill of it.
    wire = np.where(kind[target] == KINDS.index("wire"), np.floor(z[target]).astype(np.int64), -1 - target)
    order = np.lexsort((distance[target, nth], wire, beam))
    first = np.unique(np.stack([beam, wire])[:, order], axis=1, return_index=True)[1]
    target, beam = target[order[first]], beam[order[first]]
    # A beam meets several targets of one body: each pair of body and beam is asked once, by a common draw.
    draw = rng.random((len(beams), len(KINDS)))
    good = draw[beam, kind[target]] < np.array(RETURNS)[kind[target]]
    return beam[good], z[target[good]], kind[target[good]]


def _kept(
    beam: Int[np.ndarray, " h"], z: Float[np.ndarray, " h"], kind: Int[np.ndarray, " h"],
    ground: Float[np.ndarray, " k"], rng: np.random.Generator,
) -> np.ndarray:  # fmt: skip
    """Which of all returns are measured: from above, apart from each other, none below what is solid."""
    order = np.lexsort((-z, beam))
    use, last, low, blocked, leaves = np.zeros(len(beam), np.bool_), -1, np.inf, False, 0
    solid, leaf, draw = np.array(SOLID)[kind], kind == KINDS.index("leaf"), rng.random(len(beam))
    single = np.bincount(beam, minlength=len(ground)) == 1
    use[single[beam]] = draw[single[beam]] < RETURNS[0]
    for i in order[~single[beam[order]]].tolist():
        if beam[i] != last:
            last, low, blocked, leaves = beam[i], np.inf, False, 0
        if blocked or z[i] < ground[last] - 1e-9 or low - z[i] < APART_M:
            continue
        if kind[i] == 0 and draw[i] > RETURNS[0] * THROUGH_LEAF**leaves:
            continue
        use[i], low, blocked = True, z[i], bool(solid[i])
        leaves += int(leaf[i])
    return use
