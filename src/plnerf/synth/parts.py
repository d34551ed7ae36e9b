"""A span as named bodies with surfaces: what the renderer is given.  Metres, world frame."""

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Literal

import numpy as np
from jaxtyping import Float

from plnerf.synth.foliage import plant_meshes
from plnerf.synth.meshes import Mesh, grid, join, tube, without
from plnerf.synth.span import Span, ground_height
from plnerf.synth.texture import ground_texture, strand_texture
from plnerf.synth.tower import footings, insulators, steel

GROUND_PATCHES = (  # half lengths in x and y, vertex spacing and texel, in metres: fine near the line
    (44.0, 24.0, 0.5, 0.025),
    (140.0, 140.0, 2.0, 0.14),
    (1000.0, 1000.0, 12.5, 1.0),
)


@dataclass(frozen=True)
class Surface:
    """How a body looks.  `colour`: linear reflectance, an image of it, or None for the mesh's own colours."""

    kind: Literal["matt", "metal", "glazed", "leaf"]
    colour: tuple[float, float, float] | Float[np.ndarray, "h w 3"] | None
    roughness: float = 0.5


@dataclass(frozen=True)
class Part:
    """One body of one surface; `wire` marks the bodies that wire masks show."""

    name: str
    mesh: Mesh
    surface: Surface
    wire: bool = False


def span_parts(span: Span) -> Iterator[Part]:
    """Every body of the span."""
    yield from _ground(span)
    for conductor in span.conductors:
        # 10 cm steps leave the chord 1e-5 m from the curve
        mesh = tube(conductor.curve.polyline(0.1), conductor.diameter_m / 2, 16)
        if mesh.uv is None:
            raise AssertionError("tubes carry uv")
        length = float(mesh.uv[:, 1].max())
        mesh = Mesh(mesh.vertices, mesh.faces, mesh.uv / np.array([1.0, length]), smooth=True)
        texture = strand_texture(length, span.config.seed + len(conductor.name))
        yield Part(conductor.name, mesh, Surface("metal", texture, 0.55), wire=True)
    zinc = Surface("metal", (0.36, 0.37, 0.38), 0.55)
    yield Part("steel", join([steel(span, tower) for tower in span.towers]), zinc)
    concrete = Surface("matt", (0.42, 0.40, 0.37))
    yield Part("footings", join([footings(span, tower) for tower in span.towers]), concrete)
    strings = [insulators(span, tower) for tower in span.towers]
    yield Part("discs", join([discs for discs, _ in strings]), Surface("glazed", (0.16, 0.055, 0.03), 0.12))
    yield Part("fittings", join([metal for _, metal in strings]), Surface("metal", (0.30, 0.30, 0.31), 0.5))
    plants = [plant_meshes(plant) for plant in span.plants]
    if plants:
        yield Part("leaves", join([leaves for _, leaves in plants]), Surface("leaf", None))
    woods = [wood for wood, _ in plants if wood is not None]
    if woods:
        yield Part("wood", join(woods), Surface("matt", (0.13, 0.095, 0.065)))


def _ground(span: Span) -> Iterator[Part]:
    """Nested patches; each coarser one has a hole where the finer one lies."""
    hole: tuple[float, float] | None = None
    for level, (half_x, half_y, step, texel) in enumerate(GROUND_PATCHES):
        x = np.linspace(-half_x, half_x, round(2 * half_x / step) + 1)
        y = np.linspace(-half_y, half_y, round(2 * half_y / step) + 1)
        mesh = grid(x, y, ground_height(*np.meshgrid(x, y)))
        if hole is not None:
            mesh = without(mesh, (-hole[0], hole[0]), (-hole[1], hole[1]))
        texture = ground_texture((-half_x, half_x), (-half_y, half_y), texel, span.config.seed)
        yield Part(f"ground {level}", mesh, Surface("matt", texture))
        hole = (half_x, half_y)
