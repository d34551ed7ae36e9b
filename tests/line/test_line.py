import pytest

from plnerf.errors import SurveyError
from plnerf.line.line import Span


def test_a_span_lies_between_two_structures() -> None:
    assert Span(1, (2, 3), ()).structures == (2, 3)
    assert Span(1, (None, None), ()).structures == (None, None)
    with pytest.raises(SurveyError, match="Span 4 begins and ends at structure 2"):
        Span(4, (2, 2), ())
