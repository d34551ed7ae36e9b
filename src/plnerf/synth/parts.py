"""A site as named bodies with surfaces: what the renderer is given.  Metres, world frame."""

import math
from collections.abc import Iterator
from dataclasses import dataclass
from itertools import pairwise
from typing import Literal

import numpy as np
from jaxtyping import Float

from plnerf.line.wire import Wire
from plnerf.synth.config import TerrainConfig
from plnerf.synth.foliage import plant_meshes
from plnerf.synth.houses import roof, walls, windows
from plnerf.synth.insulators import insulators, jumpers, spacers
from plnerf.synth.line_config import WireConfig
from plnerf.synth.meshes import Mesh, grid, join, tube, without
from plnerf.synth.pole import irons, wood
from plnerf.synth.site import Line, Site, radius_m
from plnerf.synth.texture import ground_texture, strand_texture
from plnerf.synth.tower import footings, steel

GROUND_PATCHES = (  # half lengths in x and y, vertex spacing and texel, in metres; before them the finest
    (140.0, 140.0, 2.0, 0.14),
    (1000.0, 1000.0, 12.5, 1.0),
)
LONGEST_PIECE_M = 42.0  # of a conductor, under one texture


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


def site_parts(site: Site) -> Iterator[Part]:
    """Every body of the site."""
    yield from _ground(site)
    for config, wires in site.grouped:
        for wire in wires:
            mesh, texture = _conductor(wire, config, site.config.seed)
            yield Part(wire.name or "", mesh, Surface("metal", texture, 0.55), wire=True)
    for line in site.lines:
        yield from _supports(site, line)
    yield from _houses(site)
    plants = [plant_meshes(plant) for plant in site.plants]
    if plants:
        yield Part("leaves", join([leaves for _, leaves in plants]), Surface("leaf", None))
    woods = [stem for stem, _ in plants if stem is not None]
    if woods:
        yield Part("wood", join(woods), Surface("matt", (0.13, 0.095, 0.065)))


def _supports(site: Site, line: Line) -> Iterator[Part]:
    """Towers or poles of a line, and what carries its wires."""
    zinc = Surface("metal", (0.36, 0.37, 0.38), 0.55)
    name = f"{line.config.name}: " if line.config.name else ""
    if line.config.support.kind == "lattice":
        yield Part(f"{name}steel", join([steel(tower) for tower in line.towers]), zinc)
        concrete = Surface("matt", (0.42, 0.40, 0.37))
        yield Part(f"{name}footings", join([footings(tower) for tower in line.towers]), concrete)
    else:
        yield Part(f"{name}poles", join([wood(site, tower) for tower in line.towers]), Surface("matt", None))
        braces = [mesh for tower in line.towers for mesh in irons(tower)]
        if braces:
            yield Part(f"{name}braces", join(braces), Surface("metal", (0.30, 0.30, 0.31), 0.5))
    carriers = [insulators(line, tower) for tower in line.towers]
    porcelain = [mesh for mesh, _ in carriers if mesh is not None]
    if porcelain:
        yield Part(f"{name}discs", join(porcelain), Surface("glazed", (0.16, 0.055, 0.03), 0.12))
    fittings = join([metal for _, metal in carriers])
    yield Part(f"{name}fittings", fittings, Surface("metal", (0.30, 0.30, 0.31), 0.5))
    between = spacers(line.spans)
    if between is not None:
        yield Part(f"{name}spacers", between, zinc)
    loops = [mesh for tower in line.towers if (mesh := jumpers(line, tower)) is not None]
    if loops:
        yield Part(f"{name}jumpers", join(loops), Surface("metal", (0.24, 0.24, 0.245), 0.55))


def _conductor(wire: Wire, config: WireConfig, seed: int) -> tuple[Mesh, Float[np.ndarray, "h w 3"]]:
    """A tube along the curve in pieces of about 40 m, each under the same strands."""
    # 10 cm steps leave the chord 1e-5 m from a curve of p = 143 m; flatter ones need fewer
    points = wire.polyline(max(0.1, wire.plane[2] / 5000))
    pieces = max(1, math.ceil(wire.length_m / LONGEST_PIECE_M))
    cuts = np.linspace(0, len(points) - 1, pieces + 1).round().astype(int)
    meshes = []
    for start, end in pairwise(cuts):
        mesh = tube(points[start : end + 1], radius_m(wire), 16)
        if mesh.uv is None:
            raise AssertionError("tubes carry uv")
        length = float(mesh.uv[:, 1].max())
        meshes.append(Mesh(mesh.vertices, mesh.faces, mesh.uv / np.array([1.0, length]), smooth=True))
    return join(meshes), strand_texture(length, seed + len(wire.name or ""), config.colour)


def _houses(site: Site) -> Iterator[Part]:
    if not site.houses:
        return
    yield Part("walls", join([walls(house) for house in site.houses]), Surface("matt", None))
    yield Part("roofs", join([roof(house) for house in site.houses]), Surface("matt", None))
    openings = [windows(house) for house in site.houses]
    yield Part("panes", join([panes for panes, _ in openings]), Surface("glazed", (0.03, 0.035, 0.04), 0.08))
    yield Part("frames", join([frames for _, frames in openings]), Surface("matt", None))


def _ground(site: Site) -> Iterator[Part]:
    """Nested patches; each coarser one has a hole where the finer one lies."""
    hole: tuple[float, float] | None = None
    terrain = site.config.terrain
    middle = site.at(terrain.centre_m, 0.0)
    for level, (half_x, half_y, step, texel) in enumerate(_patches(terrain)):
        x = np.linspace(-half_x, half_x, round(2 * half_x / step) + 1) + middle[0]
        y = np.linspace(-half_y, half_y, round(2 * half_y / step) + 1) + middle[1]
        mesh = grid(x, y, site.ground.heights(*np.meshgrid(x, y)))
        if hole is not None:
            mesh = without(mesh, _around(middle[0], hole[0]), _around(middle[1], hole[1]))
        sides = _around(middle[0], half_x), _around(middle[1], half_y)
        texture = ground_texture(site.ground, *sides, texel, site.config.seed)
        if terrain.track != "dirt":
            # Row 0 belongs to v = 0, the lowest y.  The dirt track is drawn mirrored, left of the line:
            # so are the images that come with the package.
            texture = texture[::-1]
        yield Part(f"ground {level}", mesh, Surface("matt", texture))
        hole = (half_x, half_y)


def _patches(terrain: TerrainConfig) -> tuple[tuple[float, float, float, float], ...]:
    """The finest patch, and those around it, the first of them wide enough to hold it."""
    (wide, _, step, texel), *others = GROUND_PATCHES
    wide = max(wide, 50 * math.ceil(max(terrain.fine_m) / 50) + 50)
    return (*terrain.fine_m, 0.5, terrain.texel_m), (wide, wide, step, texel), *others


def _around(middle: float, half: float) -> tuple[float, float]:
    return middle - half, middle + half
