"""How long the stages of `reconstruct` take, estimated from images and pixels before they begin.

Rough rules of thumb for two cores: only the survey's was compared with runs, of the bundled span (63 s
estimated; 49 and 58 s on two cores of an Intel Xeon at 2.8 GHz) and of four times as many images (220 s;
298); other machines, and scenes with more wires, take other times.
"""

import math
from collections.abc import Callable
from pathlib import Path

from plnerf.capture.photos import find_photos
from plnerf.doctor.cost import poses_s
from plnerf.errors import CaptureError
from plnerf.scene.listing import Listing
from plnerf.survey.config import SurveyConfig

SURVEY_S, WIRES_S_PER_IMAGE, STEREO_S_PER_MP = 10.0, 0.3, 2.8
"""Seconds of a survey: whatever it surveys; of an image in which wires are found and fitted; of a megapixel
at the size at which stereo matches it."""
FIELD_S = 30.0
"""Seconds that a survey of a run takes longer, for the field's points on wires and its surface."""
EVAL_S_PER_MP, RENDER_S_PER_MP = 10.0, 8.0
"""Seconds of a megapixel of held-out views, with their measures, and of frames of the fly-along."""
FRAMES = 96
"""Frames of the fly-along, the default of `plnerf render`."""
HELD_OUT = 8
"""One of so many images is held out, where the scene states no split of its own."""


def capture_s(source: Path) -> float | None:
    """Seconds for the poses of a folder of photos; None for a video, whose pictures are not chosen yet."""
    try:
        return poses_s(find_photos(source).facts)
    except CaptureError:
        return None


def survey_s(listing: Listing, config: SurveyConfig) -> float:
    """Seconds of a survey from images and poses alone."""
    matched = 0.0
    for lens in (shot.intrinsics for shot in listing.shots):
        reduced = math.ceil(max(lens.width, lens.height) / config.stereo.longest_px)
        matched += lens.width * lens.height / reduced**2 / 1e6
    return SURVEY_S + WIRES_S_PER_IMAGE * len(listing.shots) + STEREO_S_PER_MP * matched


def field_survey_s(listing: Listing, downscale: int) -> float:
    """Seconds of a survey with the field, whose wires are known."""
    return survey_s(listing, SurveyConfig()) + FIELD_S


def eval_s(listing: Listing, downscale: int) -> float:
    """Seconds of the held-out views."""
    return EVAL_S_PER_MP * _megapixels(listing) / HELD_OUT / downscale**2


def render_s(listing: Listing, downscale: int) -> float:
    """Seconds of the fly-along."""
    return RENDER_S_PER_MP * FRAMES * _megapixels(listing) / len(listing.shots) / downscale**2


ESTIMATES: dict[str, Callable[[Listing, int], float]] = {
    "survey": field_survey_s, "eval": eval_s, "render": render_s,
}  # fmt: skip
"""Seconds of each stage after training, given the scene and by which factor its images are reduced."""


def _megapixels(listing: Listing) -> float:
    return sum(shot.intrinsics.width * shot.intrinsics.height for shot in listing.shots) / 1e6
