"""Maps of others that cannot be read are refused, with their names."""

from collections.abc import Callable
from pathlib import Path

import pytest
from tests.survey.test_rules import FRAME, write_map

from plnerf.errors import ConfigError
from plnerf.survey.map_objects import read_objects

Damage = Callable[[bytes], bytes]
DAMAGES: dict[str, tuple[Damage, str]] = {
    "a ring that does not close": (
        lambda data: data.replace(b'"Polygon", "coordinates": [ [ [ ', b'"Polygon", "coordinates": [ [ [ 1'),
        "has a shape that is none",
    ),
    "a text that is not UTF-8": (lambda data: data.replace(b"ROAD", b"\xff\xfeA"), "cannot be read"),
    "cut off": (lambda data: data[:300], "cannot be read"),
}


@pytest.mark.parametrize("name", DAMAGES)
def test_a_damaged_map_is_refused(name: str, tmp_path: Path) -> None:
    path = write_map(tmp_path / "map.geojson")
    assert len(read_objects((path,), "class", FRAME)) == 3
    damage, said = DAMAGES[name]
    damaged = damage(path.read_bytes())
    assert damaged != path.read_bytes()
    path.write_bytes(damaged)
    with pytest.raises(ConfigError, match=rf"map\.geojson {said}"):
        read_objects((path,), "class", FRAME)
