"""A survey and the truth in, how far off it is out: values."""

from dataclasses import dataclass

from plnerf.capture.similarity import Similarity
from plnerf.errors import SurveyError
from plnerf.line.survey import Survey
from plnerf.score.clearance_score import ClearanceScore, score_clearances
from plnerf.score.config import DEFAULT, WireScoreConfig
from plnerf.score.observable import Observable, score_observable
from plnerf.score.supports_score import SupportMatches, match_supports
from plnerf.score.truth import Truth
from plnerf.score.wire_matches import Match, WireMatches, match_wires


@dataclass(frozen=True)
class SurveyScore:
    """How far a survey is off."""

    wires: WireMatches
    clearances: ClearanceScore
    before_refit: tuple[Match, ...]
    """Of the same wires as they were detected; empty of clouds."""
    supports: SupportMatches
    observable: Observable | None
    """None: the truth does not state what is observable."""
    invented_certain: tuple[int, ...]
    """Ids of the invented wires that the survey calls certain."""


def score_survey(
    survey: Survey, truth: Truth, config: WireScoreConfig = DEFAULT.wires, *, unscaled: bool = False
) -> SurveyScore:
    """Compares a survey with the truth in the survey's LineFrame; truth: in the survey's world.

    unscaled: whether the truth has no scale of its own but was brought to the survey's: tolerances are then
    in units of the LineFrame, of which half of the scene's box has 20.  Raises SurveyError for an unscaled
    survey otherwise, and where both are in different frames.
    """
    if survey.frame.unit != "m" and not unscaled:
        raise SurveyError(
            f"The survey {survey.source} is unscaled, so that its wires cannot be compared with true ones in "
            "metres. Give the photos' positions or control points, and survey again."
        )
    there, wires = truth.moved(Similarity(*survey.frame.similarity)), survey.wires
    matches = match_wires(wires, there.wires, config)
    ids = {wire.id for wire in wires}
    before = match_wires([wire for wire in survey.detected if wire.id in ids], there.wires, config)
    stated = () if survey.clearances is None else survey.clearances.wires
    clearances = score_clearances(matches.matches, wires, stated, there, config)
    supports = match_supports(survey.structures, there.structures, there.wires, config)
    certain = tuple(wire.id for wire in wires if wire.evidence.certain and wire.id in matches.invented)
    observable = score_observable(wires, there, config)
    return SurveyScore(matches, clearances, before.matches, supports, observable, certain)
