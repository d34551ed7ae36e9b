"""Two synthetic spans compared."""

from dataclasses import replace

from plnerf.synth.span import Span


def assert_same_span(a: Span, b: Span) -> None:
    """All equal to the last bit."""
    assert replace(a, wires=()) == replace(b, wires=())
    for one, other in zip(a.wires, b.wires, strict=True):
        assert (one.id, one.name, one.kind, one.bundle) == (other.id, other.name, other.kind, other.bundle)
        assert (one.base.a == other.base.a).all() and (one.base.b == other.base.b).all()
        assert one.diameter_m == other.diameter_m and (one.theta == other.theta).all()
