"""Every error a user can cause.  The command line prints its text as one paragraph and exits with status 1.

A text says what was expected, what came (path, shape, value) and what to do about it.
"""


class PlnerfError(Exception):
    """Base of all errors that bad input, a full disk or a wrong option can cause."""


class SceneError(PlnerfError):
    """The scene folder, its images or its camera poses cannot be used."""


class CaptureError(PlnerfError):
    """Photos, a video or their positions cannot be made into a scene."""


class SurveyError(PlnerfError):
    """Points or curves of wires, or the truth to compare them with, cannot be read."""


class ConfigError(PlnerfError):
    """A setting is unknown, of the wrong type, or contradicts another."""


class CheckpointError(PlnerfError):
    """A checkpoint cannot be written, read, or continued from."""


class TrainingError(PlnerfError):
    """A loss, a weight, or what a model renders is not finite."""
