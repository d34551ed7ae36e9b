"""Everything that reads files of others, with small files that it takes: what fuzzing begins from."""

import json
import shutil
from collections.abc import Callable, Iterator
from dataclasses import asdict, dataclass
from importlib.util import find_spec
from pathlib import Path

import imageio
import numpy as np
import torch
from PIL import ExifTags, Image
from tests.conftest import write_tiny_scene
from tests.score.test_clouds import LINE, POINTS, text_of, write_las
from tests.support.catenary_surveys import corridor
from tests.support.tiny_run import SMALL, tiny_config
from tests.survey.test_rules import FRAME, write_map

from plnerf.capture.capture import _Chosen, _chosen_before, _Inputs
from plnerf.capture.control import read_gcp_list
from plnerf.capture.exif import read_facts
from plnerf.capture.frames import Taken
from plnerf.capture.references import read_geo_txt
from plnerf.capture.summary import read_report
from plnerf.capture.video import video_pictures
from plnerf.line.files import read_survey, read_wires, write_survey_json, write_wires
from plnerf.mechanics.conductor import load_conductor
from plnerf.mechanics.loads import load_states
from plnerf.pipeline import bundled_span
from plnerf.reconstruct import read_state
from plnerf.scene.decode import read_rgb
from plnerf.scene.formats import read_listing
from plnerf.scene.formats_colmap import write_colmap
from plnerf.scene.ply import read_ply, write_ply
from plnerf.scene.scene import load_scene
from plnerf.score.clouds import read_points
from plnerf.score.truth import read_truth
from plnerf.survey.lidar.point_cloud import read_cloud
from plnerf.survey.map_objects import read_objects
from plnerf.survey.rule_file import load_matrix
from plnerf.survey.thresholds import TABLES, load_table
from plnerf.train.checkpoint import load_checkpoint, save_checkpoint
from plnerf.train.optimizer import TableAdam
from plnerf.train.report import read_log
from plnerf.train.run import read_config, write_run
from plnerf.train.scene_record import read_record
from plnerf.train.true_pictures import read_depth_mm, read_wire_mask
from plnerf.view.points import read_survey_points

NAMES = [f"{i:04d}.png" for i in range(12)]
GCP = "EPSG:25832\n" + "\n".join(
    f"{400000 + i}.5 5700000.25 {100 + i} {10 + k}.5 {20 + i} {NAMES[k]} p{i}"
    for i in range(3)
    for k in range(3)
)
GEO = "EPSG:4979\n" + "\n".join(f"{name} 8.5 47.{i} 450 0 0 0 0.02 0.05" for i, name in enumerate(NAMES))
REPORT = {"format_version": 1, "source": "photos", "images": 3, "registered": 3, "failed": {}, "findings": []}
LOG = [{"step": 10, "seconds": 1.5, "loss": 0.25}, {"step": 20, "seconds": 3.0, "held_out_psnr_db": 21.5}]
STATE = {"training": json.dumps({"preset": "pl-nerf", "seconds": 60.0}), "eval": "step-10"}


@dataclass(frozen=True)
class Reader:
    """A function that reads a file which somebody else may have written."""

    name: str
    path: Path
    """The file whose content is replaced; what lies beside it stays."""
    read: Callable[[], object]
    seeds: tuple[bytes, ...]
    """Contents that it takes."""

    @property
    def is_json(self) -> bool:
        """Whether the file is JSON, whose values can be replaced one by one."""
        return self.path.suffix in {".json", ".geojson"}


def all_readers(folder: Path) -> Iterator[Reader]:
    """The readers, each with files of its own below a folder, which are written."""
    yield from _scenes(folder)
    yield from _pictures(folder / "pictures")
    yield from _points(folder / "points")
    yield from _surveys(folder / "surveys")
    yield from _runs(folder / "runs")
    yield from _captures(folder / "captures")


def _reader(path: Path, read: Callable[[], object], *others: bytes) -> Reader:
    name = f"{path.parent.name}/{path.name}"
    return Reader(name, path, read, (path.read_bytes(), *others))


def _scenes(folder: Path) -> Iterator[Reader]:
    posed = folder / "posed"
    write_tiny_scene(posed)
    yield _reader(posed / "transforms.json", lambda: read_listing(posed))
    for kind in ("bin", "txt"):
        scene = folder / f"colmap-{kind}"
        shutil.copytree(posed, scene)
        model = scene / "sparse" / "0"
        write_colmap(read_listing(scene), model)
        (scene / "transforms.json").unlink()
        if kind == "txt":
            _as_text(model)
        for path in sorted(model.iterdir()):
            one = _reader(path, lambda scene=scene: read_listing(scene))
            yield Reader(f"colmap/{path.name}", one.path, one.read, one.seeds)


def _as_text(model: Path) -> None:
    from plnerf.scene.colmap import pycolmap

    pycolmap.Reconstruction(model).write_text(model)
    for path in model.glob("*.bin"):
        path.unlink()


def _pictures(folder: Path) -> Iterator[Reader]:
    folder.mkdir()
    pixels = np.random.default_rng(0).integers(0, 255, (24, 32, 3), np.uint8)
    image, exif = Image.fromarray(pixels), Image.Exif()
    exif[ExifTags.Base.Make] = "DJI"
    exif.get_ifd(ExifTags.IFD.GPSInfo).update({
        1: "N", 2: (47.0, 22.0, 37.0), 3: "E", 4: (8.0, 32.0, 30.0), 5: b"\0", 6: 450.5,
    })  # fmt: skip
    exif.get_ifd(ExifTags.IFD.Exif).update({ExifTags.Base.FocalLengthIn35mmFilm: 24})
    for kind in ("jpg", "png", "tif", "webp"):
        path = folder / f"photo.{kind}"
        image.save(path, exif=exif)
        yield _reader(path, lambda path=path: read_rgb(path))
    wires, depth = folder / "wires.png", folder / "depth.png"
    image.convert("L").save(wires)
    Image.fromarray(pixels[..., 0].astype(np.uint16)).save(depth)
    yield _reader(wires, lambda: read_wire_mask(wires))
    yield _reader(depth, lambda: read_depth_mm(depth))
    photo = folder / "facts.jpg"
    image.resize((320, 240)).save(photo, exif=exif, quality=30)
    yield _reader(photo, lambda: read_facts(photo))
    video = folder / "video.mp4"
    with imageio.get_writer(video, fps=5, macro_block_size=1) as writer:
        for k in range(4):
            writer.append_data(np.roll(pixels, k, 1))
    yield _reader(video, lambda: sum(picture.shape[0] for _, _, picture in video_pictures(video)))


def _points(folder: Path) -> Iterator[Reader]:
    folder.mkdir()
    wide = POINTS[0] + np.random.default_rng(0).uniform(-60, 60, (400, 3)) * [1, 1, 0.2]
    write_ply(folder / "cloud.ply", POINTS, {"wire": np.arange(3, dtype=np.int32)})
    np.save(folder / "points.npy", POINTS)
    np.savez(folder / "points.npz", points=POINTS, colours=np.ones((3, 3)))
    (folder / "points.csv").write_text(text_of(np.c_[np.ones(3), POINTS], ";", "id;X;Y;Z"))
    (folder / "points.txt").write_text(text_of(np.c_[POINTS, np.ones(3)], " ", "//X Y Z R"))
    line = {"type": "LineString", "coordinates": LINE.tolist()}
    several = {"type": "MultiPoint", "coordinates": POINTS.tolist()}
    features = [{"type": "Feature", "properties": {"id": 1}, "geometry": one} for one in (line, several)]
    collection = {"type": "FeatureCollection", "features": features}
    (folder / "lines.geojson").write_text(json.dumps(collection))
    for kind in ("las", "laz"):
        write_las(folder / f"points.{kind}", POINTS, [14, 14, 2])
    ply = folder / "cloud.ply"
    yield Reader("points/ply", ply, lambda: read_ply(ply), (ply.read_bytes(),))
    yield Reader("points/viewed", ply, lambda: read_survey_points(ply, FRAME), (ply.read_bytes(),))
    for path in sorted(folder.iterdir()):
        yield _reader(path, lambda path=path: read_points(path))
    for kind in ("las", "laz"):
        cloud = folder / f"survey.{kind}"
        write_las(cloud, wide, [2] * len(wide))
        yield _reader(cloud, lambda cloud=cloud: read_cloud(cloud))


def _surveys(folder: Path) -> Iterator[Reader]:
    folder.mkdir()
    survey = corridor(count=50)
    write_survey_json(folder / "survey.json", survey)
    write_wires(folder / "wires.json", survey.wires, survey.frame, settings={})
    truth = json.loads((bundled_span() / "truth.json").read_text())
    small = {key: value[:2] if isinstance(value, list) else value for key, value in truth.items()}
    (folder / "truth.json").write_text(json.dumps(small | {"ground": None}))
    shutil.copy(TABLES / "nerc-fac-003-5.toml", folder / "clearances.toml")
    yield _reader(folder / "survey.json", lambda: read_survey(folder / "survey.json"))
    yield _reader(folder / "wires.json", lambda: read_wires(folder / "wires.json"))
    yield _reader(folder / "truth.json", lambda: read_truth(folder / "truth.json"))
    yield _reader(folder / "clearances.toml", lambda: load_table(folder / "clearances.toml"))
    yield from _tables(folder)
    if find_spec("pyogrio") is not None:  # of the extra plnerf[gis]
        yield from _maps(folder)


def _tables(folder: Path) -> Iterator[Reader]:
    """Rules, states and conductors, of which the package has some."""
    of_kind: dict[str, tuple[str, Callable[[Path], object]]] = {
        "rules": ("fac-003-5.toml", load_matrix),
        "states": ("nesc-250b.toml", load_states),
        "conductors": ("243-al1-39-st1a.toml", load_conductor),
    }
    for kind, (name, load) in of_kind.items():
        path = folder / f"{kind}.toml"
        shutil.copy(TABLES.parent / kind / name, path)
        yield _reader(path, lambda load=load, path=path: load(path))


def _maps(folder: Path) -> Iterator[Reader]:
    for suffix in ("geojson", "gpkg"):
        path = write_map(folder / f"map.{suffix}")
        yield _reader(
            path, lambda path=path: [one.shape.bounds for one in read_objects((path,), "class", FRAME)]
        )


def _runs(folder: Path) -> Iterator[Reader]:
    folder.mkdir()
    write_tiny_scene(folder / "scene")
    scene = load_scene(folder / "scene", store=folder / "pixels")
    write_run(folder, tiny_config(folder / "scene", *SMALL), scene)
    (folder / "metrics.jsonl").write_text("".join(json.dumps(row) + "\n" for row in LOG))
    (folder / "reconstruct.json").write_text(json.dumps(STATE))
    yield _reader(folder / "config.json", lambda: read_config(folder))
    yield _reader(folder / "scene.json", lambda: read_record(folder))
    yield _reader(folder / "metrics.jsonl", lambda: read_log(folder / "metrics.jsonl"))
    yield _reader(folder / "reconstruct.json", lambda: read_state(folder / "reconstruct.json"))
    model = torch.nn.Linear(3, 2)
    for value in model.parameters():
        value.grad = torch.ones_like(value)
    optimizer = TableAdam([{"params": [*model.parameters()]}], "numba")
    optimizer.step()
    kept = save_checkpoint(folder / "checkpoints", model, optimizer, step=1, seconds=1.5, frames={}).path
    for path in (kept, kept.with_suffix(".safetensors")):
        yield _reader(path, lambda: load_checkpoint(kept, model, optimizer))


def _captures(folder: Path) -> Iterator[Reader]:
    folder.mkdir()
    inputs = _Inputs("video.mp4", 10, 20, 0.9, 0.7)
    taken = (
        Taken("000000", 0.0, 9.5, None, True, None, False),
        Taken("000001", 0.2, 3.5, 0.5, False, None, False),
    )
    (folder / "000000.jpg").touch()
    (folder / "frames.json").write_text(json.dumps(asdict(_Chosen(inputs, taken))))
    (folder / "capture.json").write_text(json.dumps(REPORT))
    (folder / "geo.txt").write_text(GEO)
    (folder / "gcp_list.txt").write_text(GCP)
    yield _reader(folder / "frames.json", lambda: _chosen_before(folder / "frames.json", inputs, folder))
    yield _reader(folder / "capture.json", lambda: read_report(folder))
    yield _reader(folder / "geo.txt", lambda: read_geo_txt(folder / "geo.txt", NAMES))
    yield _reader(folder / "gcp_list.txt", lambda: read_gcp_list(folder / "gcp_list.txt", NAMES))
