"""Settings of `plnerf hang`: which wires are hung in a scene's photos, and how they are drawn."""

from dataclasses import dataclass, field
from typing import Literal

from plnerf.errors import ConfigError

Material = Literal["aluminium", "weathered", "copper"]


@dataclass(frozen=True)
class HangDepthConfig:
    """How the depth of every photo is measured: a plane sweep over reduced photos."""

    longest_px: int = 288
    """Longer side of the reduced photos: wires hide behind houses and trees, not behind leaves."""
    partners: int = 6
    """Photos that each is compared with."""
    max_turn_deg: float = 40.0
    """Angle between two directions of view beyond which surfaces look too different."""
    ranks: tuple[int, ...] = (1, 2, 3, 5, 8, 12)
    """First round, which finds the typical distance: partners by their rank in nearness, since distances are
    not known yet."""
    range_steps: int = 72
    """Distances of the first round, by a constant ratio."""
    range_ratio: float = 300.0
    """Ratio of the farthest distance of the first round to its nearest."""
    baselines: tuple[float, float] = (0.06, 0.6)
    """Second round: least and greatest baseline of partners, as shares of the typical distance."""
    best_baseline: float = 0.25
    """The baseline that is preferred."""
    nearest: float = 0.35
    """Least depth that is searched, as a share of the typical distance; wires are hung no nearer."""
    farthest: float = 8.0
    """Greatest depth that is searched, as a share of the typical distance."""
    step_px: float = 0.75
    """Shift of the reduced photos between two planes."""
    block_px: int = 7
    """Side of the squares that are compared."""
    min_score: float = 0.6
    """Normalised cross-correlation below which a pixel has no match."""
    unique: float = 0.03
    """Margin in correlation over all depths that differ by more than `agree`."""
    agree: float = 0.06
    """Relative difference up to which two depths are the same."""
    min_agreeing: int = 1
    """Partners whose own depth must agree."""
    most_off: float = 2.0
    """Factor by which a photo's typical distance may differ from the median of all: beyond, it is a wrong
    match, and the median is taken."""
    speckle_px: int = 40
    """Regions of even depth with fewer pixels are dropped."""
    around: int = 8
    """Nearest pixels of known depth that stand for one without: the least of their depths is taken."""


@dataclass(frozen=True)
class ChooseConfig:
    """Where wires are hung."""

    groups: int = 2
    """Groups of parallel wires, each in a direction of its own."""
    wires: tuple[int, int] = (2, 4)
    """Least and greatest number of wires of a group."""
    azimuth_deg: float | None = None
    """Azimuth of the first group in degrees, clockwise from north (the world's +y); None: drawn."""
    depth: tuple[float, float] = (0.6, 0.9)
    """Distances from the cameras, as shares of the scene's typical depth."""
    width_px: tuple[float, float] = (3.0, 8.0)
    """Widths in the nearest tenth of where wires are seen; drawn evenly in their logarithm."""
    sag: tuple[float, float] = (0.01, 0.04)
    """Sag, as a share of the span's length; a real span has 2 to 4 %."""
    spacing: tuple[float, float] = (0.05, 0.12)
    """Distance between neighbours of a group, as a share of the scene's typical depth."""
    least_images: int = 4
    """Images that must show a place of a wire for it to count as observable."""
    least_angle_deg: float = 10.0
    """Angle between the planes of wire and camera that those images must span: along one track a wire shows
    no parallax across it."""
    turned_deg: float = 30.0
    """Least angle between two groups."""
    candidates: int = 240
    """Places and directions that are tried for a group."""
    good_share: float = 0.7
    """One of the candidates is drawn whose observable length is at least this share of the longest."""
    kept_share: float = 0.4
    """Wires beside the first of a group are kept if so much of its observable length is theirs."""
    stations: int = 96
    """Places along a wire at which a candidate is judged."""

    def __post_init__(self) -> None:
        for name in ("depth", "width_px", "sag", "spacing"):
            low, high = getattr(self, name)
            if not 0 < low <= high:
                raise ConfigError(
                    f"hang: {name} needs two numbers above 0, the smaller first, but got {low:g} and "
                    f"{high:g}."
                )
        if self.depth[1] >= 1:
            raise ConfigError(
                "hang: wires hang in front of the scene, so depth must end below 1, but got "
                f"{self.depth[1]:g}."
            )
        if self.groups < 1 or not 1 <= self.wires[0] <= self.wires[1]:
            raise ConfigError(
                "hang: groups must be 1 or more, and wires 1 or more with the smaller number first, but got "
                f"{self.groups} and {self.wires[0]} to {self.wires[1]}."
            )
        if not 0 <= self.least_angle_deg < 90 or self.least_images < 2:
            raise ConfigError(
                "hang: a wire's place needs two images or more, and an angle from 0 to below 90 degrees, but "
                f"got {self.least_images} and {self.least_angle_deg:g}."
            )


@dataclass(frozen=True)
class DrawConfig:
    """How wires are drawn."""

    material: Material | None = None
    """None: drawn for each group."""
    sky: tuple[float, float] = (0.25, 0.7)
    """Share of the sky in the light on level ground; the sun gives the rest."""
    sun_elevation_deg: tuple[float, float] = (25.0, 65.0)
    """Elevation of the sun, whose azimuth is drawn too."""
    grey: float = 0.18
    """Reflectance that the median pixel of the photos is taken to have, which sets the light's strength."""
    samples: int = 5
    """Samples along each side of a pixel: coverage in steps of 1/25."""
    vertices: int = 6000
    """Vertices of a wire's polyline."""
    tile_px: int = 512
    """Side of the tiles in which photos are worked on, which bounds memory."""
    behind: float = 0.02
    """A wire is hidden where the scene's depth is smaller than its own by more than this share: what the
    plane sweep resolves."""


@dataclass(frozen=True)
class HangConfig:
    """All of `plnerf hang`."""

    seed: int = 0
    """Decides every random draw."""
    choose: ChooseConfig = field(default_factory=ChooseConfig)
    draw: DrawConfig = field(default_factory=DrawConfig)
    depth: HangDepthConfig = field(default_factory=HangDepthConfig)

    def __post_init__(self) -> None:
        if self.seed < 0:
            raise ConfigError(f"hang: the seed must be 0 or more, got {self.seed}.")
