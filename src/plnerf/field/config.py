"""What decides the shapes of the fields.  Without PyTorch, so that the command line can show it at once."""

from dataclasses import dataclass, field
from typing import Literal

from plnerf.errors import ConfigError
from plnerf.ops.grid import GridShape

DirectionEncoding = Literal["ipe", "sh", "both"]


@dataclass(frozen=True)
class RadianceConfig:
    """Sizes and switches of the PL-NeRF field."""

    grid: GridShape
    """Of the position's encoding; `finest` is fitted to the scene's pixels unless it is changed."""
    hidden: int = 64
    """Width of the hidden layers of both networks."""
    feature: int = 15
    """Length of the feature vector from the density network to the others."""
    colour_layers: int = 2
    """Hidden layers of the colour network."""
    direction_encoding: DirectionEncoding = "ipe"
    """What the colour network knows of the direction: the frustum's IPE beside the positional encoding of
    the direction (paper), spherical harmonics (nerfacto), or IPE and spherical harmonics."""
    ipe_octaves: int = 6
    """Octaves of the frustum's IPE, in contracted units."""
    direction_octaves: int = 4
    """Octaves of the view direction's positional encoding (NeRF 2020: 4)."""
    appearance: int = 16
    """Length of the appearance vector of an image; 0 turns it off."""
    normals: bool = True
    """Whether the field predicts normals."""
    damping: bool = False
    """Whether levels of the grid that are finer than a frustum fade out (zip-NeRF)."""

    def __post_init__(self) -> None:
        if self.direction_encoding not in {"ipe", "sh", "both"}:
            raise ConfigError(
                f"direction_encoding must be ipe, sh or both, but got {self.direction_encoding!r}."
            )
        if min(self.hidden, self.feature, self.colour_layers) < 1:
            raise ConfigError(
                "A field needs hidden, feature and colour_layers of 1 or more, but got "
                f"hidden={self.hidden}, feature={self.feature}, colour_layers={self.colour_layers}."
            )
        if min(self.ipe_octaves, self.direction_octaves) < 1 or self.appearance < 0:
            raise ConfigError(
                "A field needs ipe_octaves and direction_octaves of 1 or more and appearance of 0 or more, "
                f"but got ipe_octaves={self.ipe_octaves}, direction_octaves={self.direction_octaves}, "
                f"appearance={self.appearance}."
            )


@dataclass(frozen=True)
class DensityConfig:
    """Sizes of a proposal field."""

    grid: GridShape
    """Of the position's encoding."""
    hidden: int = 16
    """Width of the only hidden layer."""

    def __post_init__(self) -> None:
        if self.hidden < 1:
            raise ConfigError(f"A proposal field needs hidden of 1 or more, but got {self.hidden}.")


@dataclass(frozen=True)
class TubeConfig:
    """Sizes of the field around curves."""

    grid: GridShape = field(
        default_factory=lambda: GridShape(levels=4, coarsest=32, finest=256, features=4, log2_table=17)
    )
    """Over a unit cube that is `SLOTS` tubes across."""
    along: float = 1 / 16
    """Share of the unit cube's side that a tube is long: the less, the farther a wire's cells reach along it,
    and the fewer rays it takes to see where across the tube it hangs."""
    hidden: int = 32
    """Width of the only hidden layer."""

    def __post_init__(self) -> None:
        if self.hidden < 1:
            raise ConfigError(f"A tube field needs hidden of 1 or more, but got {self.hidden}.")
        if not 0 < self.along <= 1:
            raise ConfigError(f"A tube field needs 0 < along <= 1, but got {self.along}.")


@dataclass(frozen=True)
class OccupancyConfig:
    """Size of the grid and how it is kept up to date."""

    cells: int = 64
    """Along an axis of the contracted cube (Instant-NGP: 128 for each of its cubes)."""
    least: float = 0.01
    """Optical depth below which an interval is skipped: that much of a ray's weight at most."""
    every: int = 16
    """Steps between updates."""
    decay: float = 0.95
    """What is left of a cell's density at an update, unless more is met there."""
    samples: int = 1 << 15
    """Cells that an update samples, half of them anywhere, half where something is."""

    def __post_init__(self) -> None:
        if min(self.cells, self.every, self.samples) < 1 or self.least <= 0 or not 0 < self.decay <= 1:
            raise ConfigError(
                "An occupancy grid needs cells, every and samples of 1 or more, least > 0 and "
                f"0 < decay <= 1, but got {self}."
            )


@dataclass(frozen=True)
class VanillaConfig:
    """Sizes and switches of the deep network; the defaults are NeRF 2020's."""

    encoding: Literal["pe", "ipe"] = "pe"
    """Of the position: that of a point, the near end of an interval (NeRF 2020), or of the whole interval's
    frustum (Mip-NeRF)."""
    octaves: int = 10
    """Octaves of the position's encoding (Mip-NeRF: 16)."""
    direction_octaves: int = 4
    """Octaves of the view direction's encoding."""
    depth: int = 8
    """Hidden layers before the density."""
    width: int = 256
    """Their width, and that of the feature vector."""
    skip: int = 5
    """Hidden layers after which the encoding is joined again; 0 for none."""
    colour_width: int = 128
    """Width of the layer before the colour."""
    contraction: bool = False
    """Whether space is contracted into a ball first (Mip-NeRF 360)."""
    appearance: int = 0
    """Length of the appearance vector of an image (NeRF-W); 0 turns it off."""
    normals: bool = False
    """Whether the field predicts normals (Ref-NeRF)."""

    def __post_init__(self) -> None:
        least = min(self.octaves, self.direction_octaves, self.depth, self.width, self.colour_width)
        if least < 1 or self.appearance < 0 or not 0 <= self.skip < self.depth:
            raise ConfigError(
                "A deep field needs octaves, direction_octaves, depth, width and colour_width of 1 or more, "
                f"appearance of 0 or more and 0 <= skip < depth, but got {self}."
            )
