from plnerf.detect.config import DetectConfig as DetectConfig
from plnerf.detect.detect import detect_wires as detect_wires
from plnerf.line.files import read_survey as read_survey
from plnerf.line.survey import Survey as Survey
from plnerf.line.wire import Wire as Wire
from plnerf.pipeline import capture_scene as capture_scene
from plnerf.pipeline import train_scene as train_scene
from plnerf.pipeline import write_survey as write_survey
from plnerf.scene.scene import load_scene as load_scene
from plnerf.score.survey_score import score_survey as score_survey
from plnerf.score.truth import read_truth as read_truth
from plnerf.survey.config import SurveyConfig as SurveyConfig
from plnerf.survey.lidar.point_cloud import read_cloud as read_cloud
from plnerf.survey.run import survey_cloud as survey_cloud
from plnerf.survey.run import survey_run as survey_run
from plnerf.survey.run import survey_scene as survey_scene
from plnerf.train.field import Field as Field
from plnerf.train.run import open_run as open_run

__version__: str
__all__: list[str]
