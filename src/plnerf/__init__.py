"""PL-NeRF: photos of a power transmission line to a neural radiance field, and what a line engineer
needs of it.

    scene = plnerf.load_scene("photos/scene")
    survey = plnerf.survey_scene(scene)
    plnerf.write_survey(survey, Path("survey"))

What the library offers is listed in `__all__`; each name is imported from its module when it is first used.
"""

from importlib import import_module
from typing import Any

__version__ = "0.1.0"

_MODULES = {
    "DetectConfig": "plnerf.detect.config",
    "Field": "plnerf.train.field",
    "Survey": "plnerf.line.survey",
    "SurveyConfig": "plnerf.survey.config",
    "Wire": "plnerf.line.wire",
    "capture_scene": "plnerf.pipeline",
    "detect_wires": "plnerf.detect.detect",
    "load_scene": "plnerf.scene.scene",
    "open_run": "plnerf.train.run",
    "read_cloud": "plnerf.survey.lidar.point_cloud",
    "read_survey": "plnerf.line.files",
    "read_truth": "plnerf.score.truth",
    "score_survey": "plnerf.score.survey_score",
    "survey_cloud": "plnerf.survey.run",
    "survey_run": "plnerf.survey.run",
    "survey_scene": "plnerf.survey.run",
    "train_scene": "plnerf.pipeline",
    "write_survey": "plnerf.pipeline",
}

__all__ = list(_MODULES)


def __getattr__(name: str) -> Any:
    if name not in _MODULES:
        raise AttributeError(f"module 'plnerf' has no attribute {name!r}")
    return getattr(import_module(_MODULES[name]), name)


def __dir__() -> list[str]:
    return sorted([*globals(), *_MODULES])
