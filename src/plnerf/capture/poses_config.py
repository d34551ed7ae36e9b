"""Settings of the adjustment of given poses to tie points."""

from dataclasses import dataclass, field

from plnerf.errors import ConfigError


@dataclass(frozen=True)
class TieConfig:
    """Which features are found, and which of them match."""

    features: int = 2048
    """Features of a photo at most: the strongest."""
    contrast: float = 0.02
    """Least contrast of a feature (OpenCV's contrastThreshold)."""
    max_image_px: int = 1600
    """Longer side of the photos in which features are found."""
    partners: int = 10
    """Photos that each is matched with: those taken from near by in nearly the same direction."""
    ratio: float = 0.8
    """Greatest distance of a match as a share of that of the next best.  Lowe 2004, section 7.1."""
    epipolar_px: float = 8.0
    """Greatest distance from the epipolar line: poses may be off by so much."""
    min_images: int = 3
    """Least photos that show a tie point.  Any two agree by chance along their epipolar lines."""

    def __post_init__(self) -> None:
        if min(self.features, self.max_image_px) < 64 or self.partners < 1 or self.min_images < 2:
            raise ConfigError(
                "Tie points need features and max_image_px of 64 or more, partners of 1 or more and "
                f"min_images of 2 or more, but got {self}."
            )
        if not (0 < self.ratio <= 1 and self.epipolar_px > 0 and self.contrast > 0):
            raise ConfigError(
                "Tie points need a ratio above 0 and at most 1, and epipolar_px and contrast above 0, but "
                f"got {self}."
            )


@dataclass(frozen=True)
class AdjustmentConfig:
    """Noise of features, and accuracy of poses."""

    pose_px: float = 0.5
    """Initial standard deviation of poses, as the displacement in the photo that an error of the rotation, or
    of the position, causes; the final one is learnt."""
    feature_px: float = 0.5
    """Standard deviation of a feature's position: twice what is left at good poses, since errors of
    neighbouring features are not independent."""
    outlier_px: float = 1.5
    """Scale of the robust loss (Geman and McClure): residuals beyond it lose their weight."""
    steps: int = 10
    """Gauss-Newton steps."""

    def __post_init__(self) -> None:
        if not (self.pose_px > 0 and self.feature_px > 0 and self.outlier_px > 0 and self.steps >= 1):
            raise ConfigError(
                "A bundle adjustment needs pose_px, feature_px and outlier_px above 0 and steps of 1 or "
                f"more, but got {self}."
            )


@dataclass(frozen=True)
class PosesConfig:
    """Whether the given poses of a scene are adjusted before wires are detected."""

    adjust: bool = True
    """Whether poses are adjusted where that makes photos agree better."""
    loose_px: float = 0.25
    """Poses are adjusted where the median reprojection error of tie points is more than this,"""
    gain: float = 0.85
    """and falls to this share or less: of exact poses it falls to 0.92 and more,"""
    agree_px: float = 1.0
    """and to no more than this: what stays farther apart are no matches."""
    groups: int = 5
    """Groups of neighbouring photos that show whether an adjustment would help."""
    group_size: int = 5
    """Photos of a group."""
    min_points: int = 30
    """Fewest tie points: with fewer for each group the groups decide nothing, and all photos are tried; with
    fewer in all photos, poses stay as they are."""
    max_images: int = 2000
    """Scenes of more images are not adjusted: the equations take memory with the square of this number."""
    ties: TieConfig = field(default_factory=TieConfig)
    adjustment: AdjustmentConfig = field(default_factory=AdjustmentConfig)

    def __post_init__(self) -> None:
        if (
            not (0 < self.gain <= 1 and self.loose_px > 0 and self.agree_px > 0)
            or min(self.groups, self.min_points) < 1
            or self.group_size < 3
        ):
            raise ConfigError(
                "poses need a gain above 0 and at most 1, loose_px and agree_px above 0, groups and "
                f"min_points of 1 or more and a group_size of 3 or more, but got {self}."
            )
