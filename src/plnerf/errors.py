"""Every error a user can cause.  The command line prints its text as one paragraph and exits with status 1.

A text says what was expected, what came (path, shape, value) and what to do about it.
"""

import errno


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


_ADVICE = {
    errno.ENAMETOOLONG: "A name is longer than the file system takes, mostly 255 bytes: choose another.",
    errno.ENOSPC: "Make room on the disk.",
    errno.EDQUOT: "Your share of the disk is used up: make room.",
    errno.EFBIG: "Files may not get so large here: raise the limit (ulimit -f), or choose another disk.",
    errno.ENOMEM: "The system is short of memory: close other programs, or raise the limit (ulimit -v).",
    errno.EROFS: "The disk is read-only: choose another place.",
    errno.EACCES: "Check that you may read and write there.",
    errno.EPERM: "Check that you may read and write there.",
    errno.ENOTDIR: "A part of the path is a file where a folder is needed: choose another place.",
    errno.ENOENT: "Check that the folder exists.",
    errno.EMFILE: "Too many files are open: raise the limit (ulimit -n).",
}


def advice_on(error: OSError) -> str:
    """What to do about a file or folder that the system refuses, as a sentence."""
    known = _ADVICE.get(error.errno or 0)
    return known or "Check that the folder exists, is writable and has space left."
