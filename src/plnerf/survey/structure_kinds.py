"""What kind of structure holds the wires, where their curves tell.

    terminal     wires end there, and images that would show more of them show none
    strain       the line turns much, or pulls more to one side: H/w = p differs between the spans
    suspension   strings are seen above the wires, p is the same on both sides, and the line runs straight
    unknown      all else: which way strings lie is not seen

Letters: p = H/w of a wire's catenary; t along a junction's axis.
"""

from dataclasses import replace

import numpy as np

from plnerf.line.line import Structure, StructureKind
from plnerf.survey.config_spans import StructureKindConfig
from plnerf.survey.posed_photos import Photos
from plnerf.survey.span_wires import Junction, crossing
from plnerf.survey.support import Support, Supports


def with_structure_kinds(supports: Supports, photos: Photos, config: StructureKindConfig) -> Supports:
    """The structures with their kinds and by how much the line turns at each."""
    return replace(
        supports,
        chains=tuple(tuple(_with_kind(one, photos, config) for one in chain) for chain in supports.chains),
    )


def _with_kind(support: Support, photos: Photos, config: StructureKindConfig) -> Support:
    if support.structure is None or not support.mine:
        return support
    kind = _kind(support, support.structure, photos, config)
    angle = support.junction.bend_deg
    return replace(support, structure=replace(support.structure, kind=kind, line_angle_deg=angle))


def _kind(
    support: Support, structure: Structure, photos: Photos, config: StructureKindConfig
) -> StructureKind:
    bend = support.junction.bend_deg
    if bend is None:
        # Wires beyond what is small in all photos would be missed.
        ends = not support.afar and _goes_nowhere(support.junction, structure, photos, config)
        return "terminal" if ends else "unknown"
    pull = _pull(support)
    if bend > config.strain_deg:
        return "strain"
    if pull is None:
        return "unknown"
    ratio, sigma = pull
    if abs(ratio) > max(config.strain_ratio, config.sigmas * sigma):
        return "strain"
    even = sigma <= config.even_ratio and abs(ratio) <= max(config.even_ratio, config.sigmas * sigma)
    return "suspension" if support.strings and even and bend <= config.straight_deg else "unknown"


def _pull(support: Support) -> tuple[float, float] | None:
    """ln of p before over p after, over all conductors, and its standard deviation.

    The wires of a span are seen by the same photos and share their errors, so that all of them are known no
    better than the best; where they scatter more than they state, they are known worse.
    """
    before, after = support.junction.sides
    found, variances = [], []
    for i, j in (kink.pair for kink in support.kinks):
        one, other = before[i], after[j]
        found.append(np.log(one.plane[2] / other.plane[2]))
        relative = [wire.covariance[4, 4] / wire.theta[4] ** 2 for wire in (one, other)]
        variances.append(float(sum(relative)))
    if not found:
        return None
    weights = 1 / np.maximum(variances, 1e-12)
    mean = float(weights @ found / weights.sum())
    scatter = float(weights @ (np.array(found) - mean) ** 2) / max(len(found) - 1, 1)
    return mean, max(float(np.sqrt(max(scatter, 1.0) / weights.sum())), float(weights.max() ** -0.5))


def _goes_nowhere(
    junction: Junction, structure: Structure, photos: Photos, config: StructureKindConfig
) -> bool:
    """Whether images show the air beyond the last structure as well as the wires before it, straight on and
    to both sides: wires that went on would have been detected."""
    (span, last), *_ = junction.ends
    inward = -junction.axis.u if last else junction.axis.u
    place = np.append(structure.foot[:2], span.end(last)[2])
    beyond = []
    for turn in np.radians([0.0, -config.beyond_deg, config.beyond_deg]):
        R = np.array([[np.cos(turn), -np.sin(turn)], [np.sin(turn), np.cos(turn)]])
        beyond += [place - far * np.append(R @ inward, 0.0) for far in config.beyond_m]
    t = ((place[:2] - junction.axis.a) + np.outer(config.beyond_m, inward)) @ junction.axis.u
    before = np.concatenate([wire.points(crossing(wire, junction.axis, t)) for wire in span.wires])
    there, here = photos.distances(np.array(beyond)), photos.distances(before)
    reach = config.near * here.min()
    if not np.isfinite(reach):
        return False
    least, usual = (there <= reach).sum(0).min(), np.median((here <= reach).sum(0))
    return bool(least >= config.beyond_share * usual)
