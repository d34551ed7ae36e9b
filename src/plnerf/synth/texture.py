"""Procedural textures: grass, soil, the dirt track, and the strands of a conductor.

All values are linear reflectance in [0, 1].  Ground colour is a function of the world's x, y (metres) and of
the seed alone, so that patches of different resolution meet without a seam.
"""

import cv2
import numpy as np
from jaxtyping import Float

from plnerf.synth.terrain import ROAD_HALF_M, Ground

TABLE = 256  # lattice values per side; the noise repeats after TABLE wavelengths


def noise(
    x_m: Float[np.ndarray, "h w"], y_m: Float[np.ndarray, "h w"], wavelength_m: float, seed: int
) -> Float[np.ndarray, "h w"]:
    """Smooth value noise of one wavelength with mean 0 and deviation about 1, the same at the same place."""
    table = np.random.default_rng([seed, 3]).uniform(-2.4, 2.4, (TABLE, TABLE)).astype(np.float32)
    padded = np.pad(table, 2, mode="wrap")
    # Turned by an angle that depends on the seed, so that octaves do not share an axis.
    c, s = np.cos(0.7 * seed + 0.3), np.sin(0.7 * seed + 0.3)
    u = ((c * x_m + s * y_m) / wavelength_m) % TABLE + 2
    v = ((c * y_m - s * x_m) / wavelength_m) % TABLE + 2
    return cv2.remap(padded, u.astype(np.float32), v.astype(np.float32), cv2.INTER_CUBIC)


def ground_texture(
    ground: Ground, x_m: tuple[float, float], y_m: tuple[float, float], texel_m: float, seed: int
) -> Float[np.ndarray, "h w 3"]:
    """Ground colour over a rectangle, row 0 at the highest y (as an image), detail down to the texel."""
    nx, ny = round((x_m[1] - x_m[0]) / texel_m), round((y_m[1] - y_m[0]) / texel_m)
    x1 = x_m[0] + (np.arange(nx, dtype=np.float32) + 0.5) * texel_m
    y1 = y_m[1] - (np.arange(ny, dtype=np.float32) + 0.5) * texel_m
    x, y = np.meshgrid(x1, y1)

    def octaves(longest_m: float, count: int, falloff: float, first_seed: int) -> np.ndarray:
        total = np.zeros_like(x)
        for i in range(count):
            wavelength = longest_m / 2**i
            if wavelength >= 2.0 * texel_m:
                total += falloff**i * noise(x, y, wavelength, seed + 31 * first_seed + i)
        return total

    meadow = np.clip(ground.terrain.lush + 0.32 * octaves(37.0, 4, 0.6, 1), 0, 1)[..., None]  # lush to dry
    soil = np.clip(ground.terrain.bare + 0.75 * octaves(6.0, 6, 0.7, 2), 0, 1)[..., None]
    blades = octaves(1.3, 6, 0.93, 3)[..., None]  # tufts: 1.3 m down to 4 cm
    lush, dry = np.array([0.085, 0.135, 0.035]), np.array([0.245, 0.215, 0.095])
    earth = np.array([0.235, 0.165, 0.105])
    colour = (1 - meadow) * lush + meadow * dry
    colour = colour * np.clip(1 + 0.21 * blades, 0.25, 2.2)
    gravel = np.clip(1 + 0.17 * octaves(0.35, 4, 0.95, 4)[..., None], 0.3, 2)
    colour = (1 - soil) * colour + soil * earth * gravel
    if ground.terrain.track == "road":
        colour = _with_road(colour, ground, x, y, gravel)
    elif ground.terrain.track == "dirt":
        colour = _with_ruts(colour, ground, x, y, gravel, octaves(0.9, 3, 0.7, 5))
    return np.clip(colour * np.array(ground.terrain.tint), 0.01, 0.85).astype(np.float32)


def _with_ruts(
    colour: np.ndarray, ground: Ground, x: np.ndarray, y: np.ndarray, gravel: np.ndarray, lumps: np.ndarray
) -> np.ndarray:
    """Two bare ruts of a dirt track."""
    away = np.abs(ground.track_offset(x, y))
    rough = np.clip(1 + 0.25 * lumps, 0.3, 2)
    rut = np.exp(-(((away - 0.8) / 0.42) ** 2) * rough)[..., None]
    rut = np.clip(1.25 * rut, 0, 1)
    return (1 - rut) * colour + rut * np.array([0.36, 0.295, 0.215]) * gravel


def _with_road(
    colour: np.ndarray, ground: Ground, x: np.ndarray, y: np.ndarray, gravel: np.ndarray
) -> np.ndarray:
    """Asphalt with edge lines and a dashed line in the middle, along the wires."""
    away = np.abs(ground.track_offset(x, y))
    along = ground.along[0] * x + ground.along[1] * y
    shoulder = np.clip((ROAD_HALF_M + 0.5 - away) / 0.3, 0, 1)[..., None]
    colour = (1 - shoulder) * colour + shoulder * np.array([0.27, 0.235, 0.19]) * gravel
    asphalt = np.clip((ROAD_HALF_M - away) / 0.05, 0, 1)[..., None]
    worn = 0.115 * (1 + 0.12 * np.cos(np.pi * away / 0.85))[..., None] * np.clip(0.6 + 0.4 * gravel, 0.7, 1.4)
    colour = (1 - asphalt) * colour + asphalt * worn * np.array([1.0, 0.99, 0.96])
    dashed = (away < 0.06) & (along % 9.0 < 3.0)
    edges = np.abs(away - ROAD_HALF_M + 0.2) < 0.05
    paint = (dashed | edges)[..., None] * 0.85
    return (1 - paint) * colour + paint * np.array([0.55, 0.55, 0.53])


def strand_texture(
    length_m: float, seed: int, colour: tuple[float, float, float] = (1.0, 1.0, 1.01)
) -> Float[np.ndarray, "h w 3"]:
    """Twisted strands, by default of weathered aluminium; columns around the wire, rows along `length_m`."""
    rows, columns, strands, lay_m = max(64, round(length_m / 0.005)), 64, 16, 0.33
    along = (np.arange(rows)[:, None] + 0.5) * length_m / rows
    around = (np.arange(columns)[None] + 0.5) / columns
    groove = np.abs(np.sin(np.pi * (strands * around + strands * along / lay_m / 4)))
    rng = np.random.default_rng([seed, 4])
    weather = np.zeros((rows, 1))
    for wavelength in (3.0, 1.1, 0.4, 0.15):
        knots = np.arange(0, length_m + 2 * wavelength, wavelength)
        weather += np.interp(along, knots, rng.normal(size=len(knots)))
    value = 0.30 * (0.62 + 0.38 * groove) * np.clip(1 + 0.13 * weather, 0.5, 1.5)
    return np.clip(value[..., None] * np.array(colour), 0.02, 0.9).astype(np.float32)
