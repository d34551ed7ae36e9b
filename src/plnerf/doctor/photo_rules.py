"""What is wrong with photos before any pose is known: findings, each with what, where and what to do."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from jaxtyping import Float

from plnerf.capture.exif import PhotoFacts
from plnerf.capture.local_frame import local_frame
from plnerf.capture.motion import blurred
from plnerf.capture.references import References
from plnerf.doctor.config import PHOTOS, PhotoDoctorConfig
from plnerf.findings import Finding


@dataclass(frozen=True, eq=False)
class Thumbnail:
    """A photo as small as it takes to judge it."""

    sharpness: float
    bright: float
    """Share of saturated pixels."""
    dark: float
    """Share of black pixels."""
    grey: Float[np.ndarray, "16 16"]
    """Grey values."""


def about_files(facts: Mapping[str, PhotoFacts], problems: Sequence[str]) -> list[Finding]:
    """Unreadable photos, too few of them, and unequal sizes."""
    found = []
    if problems:
        names = tuple(text.split(":")[0] for text in problems)
        found.append(Finding(
            "unreadable", "harms", f"{len(problems)} files cannot be used: {problems[0].rstrip('.')}.", names,
            "Copy them from the camera again, convert them to JPEG, or remove them.",
        ))  # fmt: skip
    if len(facts) < 3:
        found.append(Finding(
            "too few", "stops", f"{len(facts)} photos can be read, and poses need three or more.", (),
            "Take more, with two thirds of each seen in the next.",
        ))  # fmt: skip
    sizes: dict[tuple[int, int], list[str]] = {}
    for name, fact in facts.items():
        sizes.setdefault((fact.width_px, fact.height_px), []).append(name)
    if len(sizes) > 1:
        usual = max(sizes, key=lambda size: len(sizes[size]))
        others = tuple(name for size, names in sizes.items() if size != usual for name in names)
        found.append(Finding(
            "unequal sizes", "note",
            f"{len(others)} photos are not {usual[0]} x {usual[1]} px like most.", others,
            "That is fine where they are of another camera or turned; crops of one camera need a lens of "
            "their own.",
        ))  # fmt: skip
    return found


def about_pictures(thumbnails: Mapping[str, Thumbnail], config: PhotoDoctorConfig = PHOTOS) -> list[Finding]:
    """Blur, exposure and duplicates, of photos in the order they were taken."""
    names, found = list(thumbnails), []
    blur = blurred(np.array([one.sharpness for one in thumbnails.values()]))
    for kind, these, what, do in (
        ("blurred", tuple(np.array(names)[blur].tolist()), "are much less sharp than those around them",
         "Remove them where others show the same; fly slower, or expose shorter."),
        ("over-exposed", tuple(n for n in names if thumbnails[n].bright > config.clipped),
         f"are white over more than {config.clipped:.0%} of their area",
         "Expose shorter: before a white sky wires vanish."),
        ("under-exposed", tuple(n for n in names if thumbnails[n].dark > config.clipped),
         f"are black over more than {config.clipped:.0%} of their area", "Expose longer."),
        ("duplicates", tuple(
            b for a, b in pairwise(names)
            if np.abs(thumbnails[a].grey - thumbnails[b].grey).mean() < config.alike
         ), "show the same as the one before", "Remove them: they add time, and no angle."),
    ):  # fmt: skip
        if these:
            found.append(Finding(kind, "harms", f"{len(these)} of {len(names)} photos {what}.", these, do))
    return found


def about_positions(
    facts: Mapping[str, PhotoFacts], references: References, config: PhotoDoctorConfig = PHOTOS
) -> list[Finding]:
    """Positions that are missing or impossible."""
    found = []
    if references.problems:
        found.append(Finding(
            "no position", "harms", f"{references.problems[0].split(': ', 1)[1]}.",
            tuple(text.split(":")[0] for text in references.problems),
            "Give their positions in geo.txt, or go on without: three good ones are enough.",
        ))  # fmt: skip
    known = [name for name in facts if name in references.by_name]
    if not known:
        return [*found, Finding(
            "not georeferenced", "note", "No photo states where it was taken.", (),
            "Lengths will be unscaled; give positions in geo.txt for metres.",
        )]  # fmt: skip
    stated = np.array([references.by_name[name].xyz for name in known])
    place = local_frame(references.crs, stated).to_local(stated)
    steps = np.linalg.norm(np.diff(place[:, :2], axis=0), axis=1)
    if len(known) > 1 and not steps.any():
        found.append(Finding(
            "one place", "harms", f"All {len(known)} photos state the same position.", (),
            "The receiver stood still: give positions in geo.txt, or remove the tags.",
        ))  # fmt: skip
    limits = _limits(facts, known, steps, config)
    jumps = tuple(name for name, step, limit in zip(known[1:], steps, limits, strict=True) if step > limit)
    if jumps:
        found.append(Finding(
            "jump", "harms",
            f"{len(jumps)} positions are further from the one before than a flight goes.", jumps,
            "Correct them in geo.txt; a few wrong ones are recognised and left out.",
        ))  # fmt: skip
    return found


def about_wires(
    facts: Mapping[str, PhotoFacts], distance_m: float | None, config: PhotoDoctorConfig = PHOTOS
) -> list[Finding]:
    """How wide a conductor is in the photos, at a distance."""
    good = f"{config.good_wire_px:g} px"
    focal = [fact.focal_px for fact in facts.values() if fact.focal_px is not None]
    if not focal or distance_m is None:
        missing = "how far the wires are" if focal else "a focal length"
        return [Finding(
            "wire width unknown", "note", f"The photos do not state {missing}.", (),
            "Give --distance in metres." if focal else f"A conductor should be {good} wide or more.",
        )]  # fmt: skip
    px = float(np.median(focal)) * config.wire_diameter_m / distance_m
    ground = f"A pixel is {100 * distance_m / float(np.median(focal)):.1f} cm at {distance_m:g} m"
    what = f"{ground}: a conductor of {1000 * config.wire_diameter_m:.0f} mm is {px:.1f} px wide."
    if px < config.least_wire_px:
        return [Finding("thin wires", "stops", what, (), "Fly closer, or with a longer lens.")]
    if px < config.good_wire_px:
        do = f"Fly closer, or with a longer lens: {good} and more are good."
        return [Finding("thin wires", "harms", what, (), do)]
    return [Finding("wire width", "note", what)]


def _limits(
    facts: Mapping[str, PhotoFacts],
    known: Sequence[str],
    steps: Float[np.ndarray, " n"],
    config: PhotoDoctorConfig,
) -> list[float]:
    """How far each step may be: what a fast drone flies in the time, or many times the usual step."""
    usual = max(config.stray * float(np.median(steps)), config.least_jump_m) if len(steps) else 0.0
    limits = []
    for a, b in pairwise(known):
        first, second = facts[a].time, facts[b].time
        if first is None or second is None or second <= first:
            limits.append(usual)
        else:
            limits.append(max(usual, config.fastest_m_s * (second - first).total_seconds()))
    return limits
