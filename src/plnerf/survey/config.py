"""Everything that decides a survey, as one value that is written into survey.json."""

from dataclasses import dataclass, field
from typing import Literal

from plnerf.capture.poses_config import PosesConfig
from plnerf.detect.config import DetectConfig
from plnerf.errors import ConfigError
from plnerf.mechanics.config import MechanicsConfig
from plnerf.survey.config_crown_tops import CrownTopConfig
from plnerf.survey.config_encroachments import EncroachmentConfig
from plnerf.survey.config_ground import ClassifyConfig, ClearanceConfig, CoverageConfig, FieldConfig
from plnerf.survey.config_names import NamesConfig
from plnerf.survey.config_rules import RulesConfig
from plnerf.survey.config_spans import ChainConfig, CrossarmConfig, StructureKindConfig, TensionStringConfig
from plnerf.survey.config_wires import KindsConfig, SupportConfig, WireEvidenceConfig, WirePointsConfig
from plnerf.survey.lidar.config import LidarConfig
from plnerf.survey.refine.config import RefineConfig
from plnerf.survey.stereo.config import StereoConfig


@dataclass(frozen=True)
class SurveyConfig:
    """How a run, a scene or a cloud is surveyed."""

    poses: PosesConfig = field(default_factory=PosesConfig)
    """Whether the given poses of scenes are adjusted to tie points; runs keep the poses of their training."""
    detect: DetectConfig = field(default_factory=DetectConfig)
    """Wires of scenes, and of runs whose preset detected none."""
    points: WirePointsConfig = field(default_factory=WirePointsConfig)
    """Points on wires that a run's field shows."""
    surface: FieldConfig = field(default_factory=FieldConfig)
    """Points on surfaces that a run's field shows."""
    stereo: StereoConfig = field(default_factory=StereoConfig)
    """Points on surfaces that pairs of images show."""
    spans: ChainConfig = field(default_factory=ChainConfig)
    """Which wires make a span, and which spans a line, of images."""
    supports: SupportConfig = field(default_factory=SupportConfig)
    """Structures that hold the wires, of images."""
    crossarms: CrossarmConfig = field(default_factory=CrossarmConfig)
    """What is a structure's arm rather than a wire, of images."""
    structure_kinds: StructureKindConfig = field(default_factory=StructureKindConfig)
    """Suspension, strain or terminal structures, of images."""
    strings: TensionStringConfig = field(default_factory=TensionStringConfig)
    """Tension strings, which hold wires short of their structures."""
    refine: RefineConfig = field(default_factory=RefineConfig)
    """The refit of wires to the images."""
    evidence: WireEvidenceConfig = field(default_factory=WireEvidenceConfig)
    """What a wire rests on."""
    kinds: KindsConfig = field(default_factory=KindsConfig)
    """Which wires are shield wires."""
    classify: ClassifyConfig = field(default_factory=ClassifyConfig)
    """The ground, and classes of the points, of images."""
    crown_tops: CrownTopConfig = field(default_factory=CrownTopConfig)
    """Tops of plants that stereo does not see, of images."""
    names: NamesConfig = field(default_factory=NamesConfig)
    """Names of structures, phases, circuits and lines."""
    coverage: CoverageConfig = field(default_factory=CoverageConfig)
    """How much of the ground and the air around each span was seen."""
    clearance: ClearanceConfig = field(default_factory=ClearanceConfig)
    """Clearances, and what is required of them."""
    mechanics: MechanicsConfig = field(default_factory=MechanicsConfig)
    """The same line at other temperatures, in wind and under ice."""
    rules: RulesConfig = field(default_factory=RulesConfig)
    """Clearances by a matrix of rules."""
    encroachments: EncroachmentConfig = field(default_factory=EncroachmentConfig)
    """Every object that comes too near."""
    lidar: LidarConfig = field(default_factory=LidarConfig)
    """Wires and structures of a point cloud."""
    use_classes: bool = False
    """Clouds only: whether the input's classes decide what is ground, noise, or near to wires; wires and
    structures are found without them."""
    keep_classes: bool = False
    """Clouds only: whether files keep the input's classes, with the survey's beside them (`plnerf_class`)."""
    height_datum: str | None = None
    """What heights are above where the input's CRS does not state it: `ellipsoid`, or a vertical CRS such as
    EPSG:7837."""
    temperature_c: float | None = None
    """Temperature of the conductors when they were surveyed, in degrees Celsius, if it is known."""
    report_units: Literal["metres", "feet"] = "metres"
    """Unit of the lengths in the report's tables; drawings, coordinates and files are in metres."""
    pictures: int = 4
    """Photos that the report shows with the wires drawn over them."""

    def __post_init__(self) -> None:
        if self.pictures < 0:
            raise ConfigError(f"A survey needs pictures of 0 or more, but got {self.pictures}.")
