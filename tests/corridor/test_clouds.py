"""A corridor of clouds: blocks show the same lines as one cloud, each point and each span once."""

import json
from dataclasses import replace
from pathlib import Path

import laspy
import numpy as np
import pytest
from pyproj import CRS
from tests.support.lidar_clouds import line

from plnerf.cli.corridor import corridor
from plnerf.corridor.cloud_blocks import is_cloud
from plnerf.corridor.cloud_plan import SeenSpan, cloud_part, spans_of_corridor
from plnerf.corridor.config import CorridorConfig, CutConfig
from plnerf.corridor.corridor import survey_corridor
from plnerf.corridor.results import CLOUDS, MAP, Corridor
from plnerf.errors import ConfigError, SurveyError
from plnerf.line.files import SURVEY_FILE, read_survey
from plnerf.line.survey import Survey
from plnerf.scene.las_files import open_las
from plnerf.survey.lidar.point_cloud import read_cloud
from plnerf.survey.part import Cells
from plnerf.survey.run import survey_cloud

pytestmark = pytest.mark.slow

FEET = np.array([(0, 0), (160, 10), (330, 0), (490, -40), (640, -120), (800, -190)])
AT = np.array([400_000.0, 5_600_000.0, 100.0])
CONFIG = CorridorConfig(CutConfig(block_m=270.0, overlap_m=260.0))


def write_tile(path: Path, xyz: np.ndarray, crs: int = 25832, form: int = 6) -> None:
    header = laspy.LasHeader(version="1.4", point_format=form)
    header.scales, header.offsets = np.full(3, 0.001), AT
    header.add_crs(CRS.from_epsg(crs))
    las = laspy.LasData(header)
    las.x, las.y, las.z = xyz.T
    las.intensity = np.arange(len(xyz)) % 60_000
    las.write(path)


@pytest.fixture(scope="module")
def tiles(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Three tiles of one flight, whose edges cut spans."""
    folder = tmp_path_factory.mktemp("clouds") / "tiles"
    folder.mkdir()
    xyz = line(FEET).xyz + AT
    for k, (low, high) in enumerate(((-1e6, 250.0), (250.0, 560.0), (560.0, 1e6))):
        inside = (xyz[:, 0] - AT[0] >= low) & (xyz[:, 0] - AT[0] < high)
        write_tile(folder / f"{k}.laz", xyz[inside])
    return folder


@pytest.fixture(scope="module")
def whole(tiles: Path, tmp_path_factory: pytest.TempPathFactory) -> Survey:
    """All of it as one cloud."""
    parts = [read_cloud(path).xyz for path in sorted(tiles.glob("*.laz"))]
    path = tmp_path_factory.mktemp("clouds") / "whole.laz"
    write_tile(path, np.concatenate(parts))
    return survey_cloud(read_cloud(path))


@pytest.fixture(scope="module")
def done(tiles: Path, tmp_path_factory: pytest.TempPathFactory) -> Corridor:
    return survey_corridor(tiles, tmp_path_factory.mktemp("clouds") / "out", CONFIG)


def test_spans_are_those_of_one_cloud(done: Corridor, whole: Survey) -> None:
    assert len(done.survey.spans) == len(whole.spans) == 5
    assert [one.id for one in done.survey.structures] == [1, 2, 3, 4, 5, 6]
    assert len(done.survey.lines) == 1 and not done.failed
    kinds = [sorted(wire.kind for wire in span.wires) for span in done.survey.spans]
    assert kinds == [sorted(wire.kind for wire in span.wires) for span in whole.spans]


def test_seams_change_no_wire(done: Corridor, whole: Survey) -> None:
    """Each wire of the whole cloud has one of the blocks in the same place, with the same sag."""
    mine, ours = done.survey.frame, whole.frame
    ends = [
        (wire, mine.to_world(wire.points(np.array([0.0, wire.base.length_m])))) for wire in done.survey.wires
    ]
    assert len(ends) == len(whole.wires)
    for wire in whole.wires:
        at = ours.to_world(wire.points(np.array([0.0, wire.base.length_m])))
        off, other = min(
            ((min(np.abs(at - its).max(), np.abs(at - its[::-1]).max()), one) for one, its in ends),
            key=lambda pair: pair[0],
        )
        assert off < 1e-5
        assert wire.sag is not None and other.sag is not None
        assert other.sag.value == pytest.approx(wire.sag.value, abs=1e-5)


def clouds_of(done: Corridor) -> list[laspy.LasData]:
    """The clouds of all blocks."""
    clouds = []
    for one in json.loads((done.folder / CLOUDS).read_text()):
        with open_las(done.folder / one["file"]) as reader:
            clouds.append(reader.read())
    return clouds


def test_each_point_is_in_one_cloud_with_what_was_known_of_it(done: Corridor, tiles: Path) -> None:
    clouds = clouds_of(done)
    assert len(clouds) > 2
    given = [laspy.read(path) for path in sorted(tiles.glob("*.laz"))]
    before = np.concatenate([np.column_stack([las.xyz.round(3), las.intensity]) for las in given])
    after = np.concatenate([np.column_stack([las.xyz.round(3), las.intensity]) for las in clouds])
    assert after.shape == before.shape
    order, other = np.lexsort(before.T), np.lexsort(after.T)
    assert np.abs(before[order] - after[other]).max() < 2e-3


def test_seams_change_no_class(done: Corridor, whole: Survey) -> None:
    clouds = clouds_of(done)
    mine = np.concatenate([np.column_stack([las.xyz.round(3), las.classification]) for las in clouds])
    theirs = np.column_stack([whole.frame.to_world(whole.cloud.xyz).round(3), whole.cloud.label])
    mine, theirs = mine[np.lexsort(mine.T[:3])], theirs[np.lexsort(theirs.T[:3])]
    assert np.abs(mine[:, :3] - theirs[:, :3]).max() < 2e-3
    assert (mine[:, 3] == theirs[:, 3]).mean() > 0.9999  # rounding orders some points otherwise


def test_points_of_blocks_are_gone_and_the_map_is_whole(done: Corridor) -> None:
    assert not list(done.folder.glob("clouds/*/points.laz"))
    pyogrio = pytest.importorskip("pyogrio")
    assert "wires" in {name for name, _ in pyogrio.list_layers(done.folder / MAP)}


def test_stations_go_through(done: Corridor) -> None:
    blocks = [read_survey(path) for path in sorted(done.folder.glob(f"clouds/*/survey/{SURVEY_FILE}"))]
    begins = [line.from_m for block in blocks for line in block.lines]
    assert min(begins) == 0.0 and max(begins) > 300


def test_tiles_that_do_not_belong_together(tiles: Path, tmp_path: Path) -> None:
    xyz = line(FEET[:2]).xyz + AT
    write_tile(tmp_path / "a.laz", xyz)
    write_tile(tmp_path / "b.laz", xyz, crs=25833)
    with pytest.raises(SurveyError, match=r"b\.laz has the coordinate system EPSG:25833"):
        survey_corridor(tmp_path, tmp_path / "out", CONFIG)


def test_tiles_in_feet_are_refused(tmp_path: Path) -> None:
    write_tile(tmp_path / "a.laz", line(FEET[:2]).xyz + AT, crs=2263)
    with pytest.raises(SurveyError, match="is not in metres"):
        survey_corridor(tmp_path, tmp_path / "out", CONFIG)


def test_what_a_cloud_is(tmp_path: Path, tiny_scene: Path) -> None:
    assert is_cloud(Path("a.LAZ")) and not is_cloud(tiny_scene) and not is_cloud(tmp_path)


def axis(*ends: tuple[float, float]) -> np.ndarray:
    return np.array([[x, y, 0.0] for x, y in ends])


CORES = (Cells(100.0, np.array([[0, 0], [1, 0]])), Cells(100.0, np.array([[2, 0], [3, 0]])))
BOTH = (True, True)


def test_a_span_that_two_blocks_see_comes_once_and_in_the_right_one() -> None:
    seen = [
        SeenSpan(0, axis((0, 50), (150, 50)), BOTH, 3), SeenSpan(0, axis((150, 50), (290, 50)), BOTH, 3),
        SeenSpan(1, axis((290.4, 50), (150.3, 50)), BOTH, 3),
        SeenSpan(1, axis((290, 50), (400, 50)), BOTH, 3),
    ]  # fmt: skip
    spans = spans_of_corridor(seen, CORES)
    assert [one.block for one in spans] == [0, 1, 1]
    assert [one.number.structures for one in spans] == [(1, 2), (2, 3), (3, 4)]
    assert [one.number.from_m for one in spans] == pytest.approx([0.0, 150.0, 290.0], abs=1.0)
    part = cloud_part(spans, 1, CORES[1])
    assert [part.numbers[k].span for k in part.mine] == [2, 3]


def test_what_is_cut_off_where_a_block_ends_is_no_span() -> None:
    seen = [
        SeenSpan(0, axis((0, 50), (150, 50)), BOTH, 3),
        SeenSpan(0, axis((150, 50), (220, 50)), (True, False), 3),
        SeenSpan(1, axis((150, 50), (290, 50)), BOTH, 3),
    ]  # fmt: skip
    assert [one.block for one in spans_of_corridor(seen, CORES)] == [0, 1]


def test_a_branch_is_of_the_same_line_and_a_line_apart_of_another() -> None:
    seen = [
        SeenSpan(0, axis((0, 50), (100, 50)), BOTH, 3), SeenSpan(0, axis((100, 50), (190, 50)), BOTH, 3),
        SeenSpan(0, axis((100, 50), (100, 90)), BOTH, 3), SeenSpan(0, axis((10, 5), (60, 5)), BOTH, 1),
    ]  # fmt: skip
    spans = spans_of_corridor(seen, CORES)
    assert [one.number.line for one in spans] == [1, 1, 1, 2]
    assert spans[2].number.structures[0] == 2 or spans[2].number.structures[1] == 2
    assert replace(spans[0].number, span=1) == spans[0].number


def test_a_cloud_has_no_field(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match="holds no photos to train a field of"):
        corridor(tmp_path / "a.laz", out=tmp_path / "out", seconds=60.0)
    assert not (tmp_path / "out").exists()
