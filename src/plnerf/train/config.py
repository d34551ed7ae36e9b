"""What decides a training run, as one value that is written into the run folder."""

import math
from dataclasses import dataclass, field
from typing import Generic, Literal, TypeVar

from plnerf.capture.poses_config import PosesConfig
from plnerf.detect.config import DetectConfig
from plnerf.errors import ConfigError
from plnerf.ops.backends import Backend
from plnerf.render.config import SystemConfig

S_co = TypeVar("S_co", bound=SystemConfig, covariant=True)


DetailMap = Literal["hessian", "ridge"]
"""By what detail pixels are chosen: curvature alone, or the long thin lines of `detect/ridges.py`."""


@dataclass(frozen=True)
class LossWeights:
    """What each term counts for; 0 turns it off."""

    colour: float = 1.0
    """Mean squared error of the colour (NeRF 2020)."""
    coarse: float = 1.0
    """The same of what coarse samples alone show, where a system renders it (Mip-NeRF: 0.1)."""
    interlevel: float = 1.0
    """Proposals must cover the final histogram (Mip-NeRF 360)."""
    interlevel_blur: tuple[float, ...] = ()
    """Half width, in s, of the box that blurs the final histogram for each proposal round, which must then
    have as much weight everywhere (zip-NeRF: 0.03 and 0.003).  Empty: the bound of Mip-NeRF 360."""
    distortion: float = 0.001
    """Weight of a ray gathers in one place (Mip-NeRF 360)."""
    normals: float = 3e-4
    """Predicted normals follow the density's gradient (Ref-NeRF R_p, its value)."""
    orientation: float = 1e-3
    """Normals that face away from the camera (Ref-NeRF R_o)."""
    normals_shape_density: bool = False
    """Whether the losses on normals also move the density, as in Ref-NeRF, and the features that normals are
    predicted from, or only the predicted normals.  They smooth surfaces, at 0.5 to 1 dB of held-out PSNR on
    the fox scene after 600 steps."""

    def __post_init__(self) -> None:
        values = (
            self.colour, self.coarse, self.interlevel, self.distortion, self.normals, self.orientation,
        )  # fmt: skip
        if min(values) < 0 or min(self.interlevel_blur, default=0.0) < 0:
            raise ConfigError(f"The weights of losses and interlevel_blur must be 0 or more, but are {self}.")


Until = Literal["spent", "settled"]
"""When a run ends: with its budget, or once held-out pixels no longer gain."""


@dataclass(frozen=True)
class SettleConfig:
    """When a run is settled.  Looks at held-out pixels follow one another by steps, whatever the machine."""

    first: int = 500
    """Steps before the first look."""
    growth: float = 1.25
    """Ratio of the steps at one look to those at the one before."""
    gain_db: float = 0.3
    """What the better of the last two looks must gain on all before, over all pixels or those near wires."""
    hold: float = 2 / 3
    """Progress at which a run waits until then: half as many steps as before follow."""

    def __post_init__(self) -> None:
        if self.first < 1 or self.growth <= 1 or not 0 < self.hold < 1:
            raise ConfigError(
                "A run that is to settle needs first >= 1, growth > 1 and 0 < hold < 1, but got "
                f"first={self.first}, growth={self.growth}, hold={self.hold}."
            )


@dataclass(frozen=True)
class TrainConfig:
    """How the loop trains."""

    rays: int = 512
    """Rays of a step."""
    hash_lr: float = 3e-2
    """Learning rate of the hash tables."""
    mlp_lr: float = 1.5e-2
    """Learning rate of the networks."""
    appearance_rate: float = 0.1
    """Learning rate of the appearance vectors, as a share of that of the networks.  A step has a few rays of
    an image, and the mean of all vectors stands for images that are not trained on."""
    pose_lr: float = 5e-4
    """Learning rate of the pose corrections (radians, scene units)."""
    lr_fall_from: float = 2 / 3
    """Progress from which the learning rates fall, exponentially; until then they wait."""
    lr_final_factor: float = 0.1
    """Share of the learning rates that is left at the end."""
    warmup_steps: int = 50
    """Steps over which the learning rates rise from zero."""
    anneal_steps: int = 300
    """Steps over which the proposals' histograms sharpen (Mip-NeRF 360: 1000)."""
    normal_rays: int = 32
    """Rays of a step on which normals are trained; their losses are means, so this only sets the noise."""
    normals_from: float = 2 / 3
    """Progress from which normals are trained, where they do not shape the density: before, they would follow
    a field that still changes, and a step without them takes a tenth less time."""
    detail_share: float = 0.2
    """Share of the rays drawn from the detail pixels (thin lines)."""
    detail_part: float = 0.1
    """Part of an image's pixels that are detail pixels."""
    detail_map: DetailMap = "hessian"
    """What chooses the detail pixels: "hessian", curvature alone; "ridge", long thin lines."""
    find_wires: bool = False
    """Whether wires are detected in the images first, to guide pixels and samples."""
    curve_share: float = 0.3
    """Share of the rays drawn from the pixels along detected wires."""
    smooth_px: int = 3
    """Side of the square whose mean colour stands for a pixel at first, odd; 1: its own alone.  As long as
    few pixels of a texture were seen, their mean says more of it than one of them."""
    smooth_draws: float = 0.1
    """Draws after which pixels have their own colours, as a share of the training images' pixels."""
    unbias: float = 1.0
    """Power of the importance weights: 1 makes the loss that of uniform draws, 0 leaves it as drawn."""
    pose_refinement: bool = False
    """Whether the training cameras' poses are refined (NeRF--)."""
    pose_from: float = 0.2
    """Progress at which pose refinement begins: the field must have formed."""
    validations: int = 10
    """How often, over the whole run, held-out pixels are rendered for the log."""
    checkpoints: int = 10
    """How many checkpoints a run writes; the last two are kept."""
    loss: LossWeights = field(default_factory=LossWeights)
    settle: SettleConfig = field(default_factory=SettleConfig)
    """For runs with `until` "settled"."""

    def __post_init__(self) -> None:
        if self.rays < 1 or not 0 <= self.normal_rays <= self.rays or not 0 <= self.detail_share < 1:
            raise ConfigError(
                "Training needs rays >= 1, 0 <= normal_rays <= rays and 0 <= detail_share < 1, but got "
                f"rays={self.rays}, normal_rays={self.normal_rays}, detail_share={self.detail_share}."
            )
        if not 0 < self.detail_part <= 1 or self.checkpoints < 1 or self.validations < 0:
            raise ConfigError(
                "Training needs 0 < detail_part <= 1, checkpoints >= 1 and validations >= 0, but got "
                f"detail_part={self.detail_part}, checkpoints={self.checkpoints}, "
                f"validations={self.validations}."
            )
        if self.warmup_steps < 1 or self.anneal_steps < 1:
            raise ConfigError(
                "Training needs warmup_steps and anneal_steps of 1 or more, but got "
                f"warmup_steps={self.warmup_steps}, anneal_steps={self.anneal_steps}."
            )
        if self.smooth_px < 1 or self.smooth_px % 2 == 0 or not 0 <= self.smooth_draws < math.inf:
            raise ConfigError(
                "A square around a pixel needs an odd smooth_px and smooth_draws >= 0, but got "
                f"smooth_px={self.smooth_px}, smooth_draws={self.smooth_draws}."
            )
        rates = (self.hash_lr, self.mlp_lr, self.pose_lr, self.appearance_rate)
        if min(rates) < 0 or not 0 < self.lr_final_factor <= 1 or not 0 <= self.pose_from <= 1:
            raise ConfigError(
                "Training needs learning rates of 0 or more, 0 < lr_final_factor <= 1 and "
                f"0 <= pose_from <= 1, but got hash_lr={self.hash_lr}, mlp_lr={self.mlp_lr}, "
                f"pose_lr={self.pose_lr}, appearance_rate={self.appearance_rate}, "
                f"lr_final_factor={self.lr_final_factor}, pose_from={self.pose_from}."
            )
        if not 0 <= self.normals_from <= 1:
            raise ConfigError(
                f"Normals are trained from 0 <= normals_from <= 1 on, but normals_from={self.normals_from}."
            )
        if not 0 <= self.lr_fall_from < 1:
            raise ConfigError(
                f"Learning rates must begin to fall before the end, 0 <= lr_fall_from < 1, but "
                f"lr_fall_from={self.lr_fall_from}."
            )


@dataclass(frozen=True)
class Settings:
    """What a preset decides of a run, and what options change of it: --train.rays 512."""

    model: SystemConfig
    train: TrainConfig = field(default_factory=TrainConfig)
    detect: DetectConfig = field(default_factory=DetectConfig)
    poses: PosesConfig = field(default_factory=PosesConfig)


@dataclass(frozen=True)
class RunConfig:
    """A whole run: what is trained, on what, for how long."""

    scene: str
    """Absolute path of the scene."""
    downscale: int
    """Integer factor by which images are made smaller."""
    preset: str
    """Name of the preset that the settings started from."""
    backend: Backend
    """Implementation of the ops."""
    device: Literal["cpu", "cuda"]
    model: SystemConfig
    train: TrainConfig = field(default_factory=TrainConfig)
    detect: DetectConfig = field(default_factory=DetectConfig)
    """How wires are detected where `train.find_wires` asks for it."""
    poses: PosesConfig = field(default_factory=PosesConfig)
    """Whether the given poses are adjusted to tie points before wires are detected."""
    steps: int | None = None
    """Budget in steps; a run with a budget in steps can be repeated and resumed to the same bits."""
    seconds: float | None = None
    """Budget in seconds of training steps; loading, validation and saving are not counted."""
    until: Until = "spent"
    """When it ends: with its budget, or before, once held-out pixels no longer gain."""
    seed: int = 0
    """Decides the initial weights and, with the step, every random draw."""

    def __post_init__(self) -> None:
        if (self.steps is None) == (self.seconds is None):
            raise ConfigError(
                "Give a budget either in steps or in seconds: --steps N or --seconds S, not both."
            )
        if not 0 < (self.steps or self.seconds or 0) < math.inf:
            raise ConfigError(
                f"The budget must be positive and finite, but steps={self.steps} and seconds={self.seconds}."
            )
        blurs, rounds = self.train.loss.interlevel_blur, self.model.sampler.proposals
        if blurs and len(blurs) != len(rounds):
            raise ConfigError(
                f"train.loss.interlevel_blur needs a half width for each of the {len(rounds)} proposal "
                f"rounds, or none, but has {len(blurs)}: {list(blurs)}."
            )
        if not 0 <= self.seed < 1 << 63:
            raise ConfigError(f"The seed must be from 0 to 2^63 - 1, but is {self.seed}.")


@dataclass(frozen=True)
class Preset(Generic[S_co]):
    """Settings of a system before they are fitted to a scene."""

    model: S_co
    train: TrainConfig
    year: int
    """Of its publication: comparisons go from the oldest to the newest."""
    rays_per_s: float | None = None
    """Of training on two cores of an Intel Xeon at 2.1 GHz (`plnerf compare` on the bundled span); None where
    it was not measured.
    """
    cells_per_pixel: float = 1.0
    """Cells of the finest level per pixel's width at a distance of one scene unit; decides
    field.grid.finest.
    """
