"""Trees and bushes down to the leaf.  Metres, world frame; colours are linear reflectance per vertex."""

import numpy as np
from jaxtyping import Float

from plnerf.synth.meshes import Mesh, join, tube, up
from plnerf.synth.site import Plant


def plant_meshes(plant: Plant) -> tuple[Mesh | None, Mesh]:
    """The wood (a bush has none to show) and the leaves; both inside the plant's cylinder."""
    rng = np.random.default_rng(plant.seed)
    foot = np.array(plant.foot)
    if plant.kind == "conifer":
        return _conifer(plant, rng)
    tree = plant.kind != "bush"
    base = 0.2 * plant.height_m if tree else 0.0  # where the crown begins
    half_height = (plant.height_m - base) / 2
    centre = foot + up(base + half_height)
    size = {"tree": 0.095, "bush": 0.055, "background tree": 0.26}[plant.kind]
    count = {"tree": 26000, "bush": 7000, "background tree": 4200}[plant.kind]
    reach = np.array([plant.radius_m, plant.radius_m, half_height]) - size

    lumps = int(rng.integers(18, 28)) if tree else 7
    directions = rng.normal(size=(lumps, 3))
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    twigs = centre + directions * reach * rng.uniform(0.35, 0.76, (lumps, 1))
    which = rng.integers(lumps, size=count)
    spread = rng.normal(size=(count, 3))
    spread /= np.linalg.norm(spread, axis=1, keepdims=True)
    lump_size = rng.uniform(0.24, 0.44, lumps)[which, None]
    at = twigs[which] + spread * reach * lump_size * rng.uniform(0.3, 1.0, (count, 1)) ** 0.5
    relative = (at - centre) / reach
    norm = np.linalg.norm(relative, axis=1, keepdims=True)
    at = centre + relative / np.maximum(norm, 1.0) * reach
    tint = rng.uniform(0.75, 1.25, lumps)[which] * rng.uniform(0.7, 1.3, count)
    depth = np.clip(norm[:, 0], 0.0, 1.0)
    green = np.array([0.15, 0.23, 0.05]) * rng.uniform([0.7, 0.8, 0.6], [1.35, 1.15, 1.3])
    colour = green * (tint * (0.55 + 0.45 * depth))[:, None]
    leaves = _leaves(at, size * rng.uniform(0.6, 1.2, count), colour, rng)
    if not tree:
        return None, leaves

    lean = rng.normal(0, 0.08, 2) * plant.radius_m
    heights = np.linspace(-0.3, base + 1.3 * half_height, 8)
    axis = np.stack([np.full(8, foot[0]), np.full(8, foot[1]), foot[2] + heights], axis=1)
    axis[:, :2] += (np.clip(heights, 0, None) / plant.height_m)[:, None] ** 2 * lean
    thickness = 0.018 * plant.height_m
    wood = [tube(axis, thickness * np.linspace(1.15, 0.25, 8), 9)]
    for tip in twigs:
        start = axis[int(rng.integers(3, 7))]
        middle = (start + tip) / 2 + up(-0.06 * plant.radius_m)
        wood.append(tube(np.stack([start, middle, tip]), thickness * np.array([0.35, 0.22, 0.08]), 6))
    return join(wood), leaves


def _conifer(plant: Plant, rng: np.random.Generator) -> tuple[Mesh, Mesh]:
    """A spruce: whorls of drooping branches, shorter towards the tip, hung with short needled twigs."""
    foot, count, size = np.array(plant.foot), 20000, 0.13
    whorls = max(9, round(plant.height_m / 0.42))
    branches = whorls * 7
    up_share = np.sort(rng.uniform(0.09, 0.985, branches))  # of the height
    azimuth = rng.uniform(0, 2 * np.pi, branches)
    reach = (plant.radius_m - size) * (1 - up_share) ** 0.8 * rng.uniform(0.75, 1.0, branches)
    which = rng.choice(branches, size=count, p=reach / reach.sum())
    out = rng.uniform(0.05, 1.0, count) ** 0.75
    r = reach[which] * out
    sideways = rng.normal(0, 0.10, count) * (0.35 + reach[which]) * (1.15 - out)
    droop = 0.24 * reach[which] * out**1.4 + np.abs(rng.normal(0, 0.07, count))
    c, s = np.cos(azimuth[which]), np.sin(azimuth[which])
    z = np.clip(up_share[which] * plant.height_m - droop, 0.15, plant.height_m - size)
    at = np.stack([r * c - sideways * s, r * s + sideways * c, z], axis=1)
    away = np.linalg.norm(at[:, :2], axis=1, keepdims=True)
    at[:, :2] *= np.minimum(1.0, (plant.radius_m - size) / np.maximum(away, 1e-9))
    green = np.array([0.055, 0.105, 0.045]) * rng.uniform([0.8, 0.85, 0.8], [1.25, 1.15, 1.25])
    colour = green * (rng.uniform(0.7, 1.3, count) * (0.55 + 0.55 * out))[:, None]
    leaves = _leaves(at + foot, size * rng.uniform(0.7, 1.4, count), colour, rng)
    axis = foot + np.array([0.0, 0.0, 1.0]) * np.linspace(-0.3, 0.97 * plant.height_m, 8)[:, None]
    return tube(axis, 0.014 * plant.height_m * np.linspace(1.1, 0.08, 8), 9), leaves


def _leaves(
    at: Float[np.ndarray, "n 3"],
    size_m: Float[np.ndarray, "n"],
    colour: Float[np.ndarray, "n 3"],
    rng: np.random.Generator,
) -> Mesh:
    """One rhombus per leaf, turned at random but rather facing the sky."""
    n = len(at)
    normal = rng.normal(size=(n, 3)) + up(0.6)
    normal /= np.linalg.norm(normal, axis=1, keepdims=True)
    long = np.cross(normal, rng.normal(size=(n, 3)))
    long /= np.linalg.norm(long, axis=1, keepdims=True)
    wide = np.cross(normal, long)
    half = size_m[:, None] / 2
    tip, edge = long * half, 0.5 * wide * half
    corners = np.stack([at - tip, at - edge, at + tip, at + edge], axis=1)
    first = 4 * np.arange(n)[:, None]
    faces = np.concatenate([first + np.array([0, 1, 2]), first + np.array([0, 2, 3])])
    return Mesh(corners.reshape(-1, 3), faces, colour=np.repeat(colour, 4, axis=0))
