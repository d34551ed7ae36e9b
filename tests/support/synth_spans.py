"""Two synthetic sites compared."""

from dataclasses import replace

from plnerf.synth.site import Site


def assert_same_site(a: Site, b: Site) -> None:
    """All equal to the last bit."""
    assert replace(a, lines=()) == replace(b, lines=())
    assert [line.towers for line in a.lines] == [line.towers for line in b.lines]
    for one, other in zip(a.wires, b.wires, strict=True):
        assert (one.id, one.name, one.kind, one.bundle) == (other.id, other.name, other.kind, other.bundle)
        assert (one.base.a == other.base.a).all() and (one.base.b == other.base.b).all()
        assert one.diameter_m == other.diameter_m and (one.theta == other.theta).all()
