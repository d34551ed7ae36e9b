"""What photos will cost: time for their poses and for training, memory, and disk.

Rates were measured on two cores of an Intel Xeon at 2.1 GHz; another machine has others.
"""

from collections.abc import Mapping

from plnerf.capture.exif import PhotoFacts
from plnerf.capture.pairs import PairConfig, choose_pairs
from plnerf.capture.sfm import SfmConfig
from plnerf.findings import Finding

FEATURES_S_PER_MP, PAIR_S, MODEL_S_PER_IMAGE = 2.2, 0.15, 0.7
"""Seconds of structure from motion: of a megapixel in which features are extracted, of a pair of images, of
an image in the model."""
MEMORY_GB = 1.5
"""Peak of structure from motion (1.1 to 1.5 for 18 to 70 photos); of training, whose pixels stay on disk."""
ENOUGH_S = 600.0
"""A pass over all pixels that is called affordable."""
DOWNSCALES = (1, 2, 4, 8, 16)


def about_cost(facts: Mapping[str, PhotoFacts], preset: str, rays_per_s: float | None) -> Finding:
    """Time, memory and disk, and by how much to make images smaller for training.

    rays_per_s: that of the preset's training; None where it was not measured.
    """
    pixels = [fact.width_px * fact.height_px for fact in facts.values()]
    what = f"On two cores, poses take about {in_words(poses_s(facts))}"
    do = ""
    if rays_per_s is not None:
        seconds = {k: sum(pixels) / k**2 / rays_per_s for k in DOWNSCALES}
        k = next((k for k in DOWNSCALES if seconds[k] <= ENOUGH_S), DOWNSCALES[-1])
        what += f"; training {preset} on each pixel once, {in_words(seconds[1])}"
        if k > 1:
            do = f"Train with --downscale {k}: {in_words(seconds[k])}; as little as wires allow."
    what += f"; {MEMORY_GB:g} GB of memory, and {3 * sum(pixels) / 1e9:.1f} GB of pixels on disk."
    return Finding("cost", "note", what, (), do)


def poses_s(facts: Mapping[str, PhotoFacts]) -> float:
    """Seconds of structure from motion of photos."""
    most_px = SfmConfig().max_image_px
    extracted = sum(
        fact.width_px * fact.height_px * min(1.0, most_px / max(fact.width_px, fact.height_px)) ** 2
        for fact in facts.values()
    )
    pairs = len(choose_pairs(len(facts), PairConfig()))
    return FEATURES_S_PER_MP * extracted / 1e6 + PAIR_S * pairs + MODEL_S_PER_IMAGE * len(facts)


def in_words(seconds: float) -> str:
    """In the unit that suits it: 40 s, 12 min, 5.5 h, 3 days."""
    if seconds < 90:
        return f"{seconds:.0f} s"
    if seconds < 5400:
        return f"{seconds / 60:.0f} min"
    if seconds < 2 * 86400:
        return f"{seconds / 3600:.1f} h"
    return f"{seconds / 86400:.0f} days"
