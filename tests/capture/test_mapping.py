"""An impossible lens is refused, the images are mapped again, the best plausible model is taken."""

from dataclasses import asdict, dataclass
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pycolmap
import pytest
from PIL import Image
from tests.capture.test_sfm import COUNT, steps

from plnerf.capture.exif import PhotoFacts
from plnerf.capture.lens_fit import lens_problem
from plnerf.capture.mapping import MOST_ERROR_PX, Try, judged, kept_models, map_until_plausible, tries
from plnerf.capture.pairs import PairConfig, choose_pairs
from plnerf.capture.sfm import SfmConfig, reconstruct
from plnerf.capture.summary import summary
from plnerf.scene.formats import read_listing
from plnerf.scene.formats_colmap import write_colmap

GOOD, BENT = (440.0, 440.5), (606.0, 291.0)


def lens(fx: float, fy: float, *distortion: float) -> Any:
    params = [fx, fy, 240, 160, *distortion, *[0.0] * (4 - len(distortion))]
    return pycolmap.Camera(model="OPENCV", width=480, height=320, params=params)


def facts(count: int, focal_px: float | None = None) -> dict[str, PhotoFacts]:
    one = PhotoFacts(480, 320, 1, None, None, None, None, None, focal_px, "synthetic 480x320")
    return {f"{i:02d}.jpg": one for i in range(count)}


@dataclass
class Model:
    """What is asked of a pycolmap.Reconstruction: its images, and a lens for each of them."""

    lenses: list[tuple[float, float]]

    def reg_image_ids(self) -> list[int]:
        return list(range(len(self.lenses)))

    def image(self, i: int) -> Any:
        return SimpleNamespace(name=f"{i:02d}.jpg", camera_id=i)

    def camera(self, i: int) -> Any:
        return lens(*self.lenses[i])


def mapped(*rounds: list[Model]) -> tuple[list[int], str | None, list[Any], list[Try]]:
    """Sizes of the models of the try that is taken, the best one's problem, findings, and tries that ran."""
    ran: list[Try] = []

    def run(k: int, way: Try) -> list[Model]:
        ran.append(way)
        return rounds[k]

    taken, findings = map_until_plausible(run, tries(1.2, 0)[: len(rounds)], facts(60))
    return [len(one.images) for one in taken], taken[0].problem if taken else None, findings, ran


def shared(count: int, focal: tuple[float, float]) -> Model:
    return Model([focal] * count)


def test_a_lens_is_one_or_is_not() -> None:
    for plausible in (lens(440, 440), lens(440, 452), lens(440, 440, -0.3, 0.1), lens(440, 440, 0.3)):
        assert lens_problem(plausible, None) is None and lens_problem(plausible, 350.0) is None
    for fx, fy in ((606, 291), (1044, 363), (440, 414), (291, 606), (np.nan, 440), (-440, -440)):
        assert "cameras have square pixels" in str(lens_problem(lens(fx, fy), None))
    assert lens_problem(lens(606, 291), None) == (
        "focal lengths of 606 px across and 291 px up, where cameras have square pixels"
    )
    assert "no lens of images of 480 px has" in str(lens_problem(lens(100, 100), None))
    assert "no lens of images of 480 px has" in str(lens_problem(lens(5000, 5000), None))
    assert "where EXIF states 700 px" in str(lens_problem(lens(440, 440), 700.0))
    assert "where EXIF states 250 px" in str(lens_problem(lens(440, 440), 250.0))


@pytest.mark.parametrize("k1", [-0.4, -0.7, -0.8, -1.0, -3.0])
def test_a_distortion_folds_where_its_derivative_is_zero_within_the_image(k1: float) -> None:
    """r (1 + k1 r^2) grows up to r^2 = -1 / (3 k1); where that is the corner or beyond, no place is shown
    twice."""
    reach = (2 / 3) * (-1 / (3 * k1)) ** 0.5
    corner = np.hypot(240, 160) / 440
    assert (lens_problem(lens(440, 440, k1), None) is not None) == (reach < corner)


def test_one_bent_lens_among_many_bends_no_model() -> None:
    assert judged(Model([GOOD] * 19 + [BENT]), facts(20)).problem is None
    assert "606 px across" in str(judged(Model([GOOD] * 8 + [BENT] * 2), facts(10)).problem)
    assert "EXIF states 900 px" in str(judged(shared(5, GOOD), facts(5, 900.0)).problem)


def test_tries_differ() -> None:
    assert tries(1.2, 3) == (Try(1.2, 3), Try(MOST_ERROR_PX, 3), Try(1.2, 4))
    assert tries(MOST_ERROR_PX, 0)[1] == Try(MOST_ERROR_PX / 2, 0)


def test_a_plausible_model_ends_the_tries() -> None:
    sizes, problem, findings, ran = mapped([shared(5, BENT), shared(40, GOOD)], [shared(60, GOOD)])
    assert (sizes, problem, findings, ran) == ([40, 5], None, [], [Try(1.2, 0)])


def test_a_bent_model_is_refused_and_the_next_try_taken() -> None:
    rounds = [shared(49, BENT), shared(12, GOOD)], [shared(9, GOOD), shared(29, GOOD)], [shared(60, GOOD)]
    sizes, problem, (finding,), ran = mapped(*rounds)
    assert sizes == [29, 9] and problem is None and len(ran) == 2
    assert (finding.kind, finding.degree) == ("mapped again", "note")
    assert "in 1 of 2 tries, its poses bent: 49 images with focal lengths of 606 px across" in finding.what
    assert "taken is a model of 29 images, whose lens is plausible" in finding.what


def test_the_plausible_model_with_the_most_images_is_kept() -> None:
    """Of all tries, where none gave a largest one that is plausible; the first of equals."""
    first = [shared(50, BENT), shared(24, GOOD)]
    sizes, problem, findings, ran = mapped(first, [shared(49, BENT), shared(12, GOOD)], [shared(60, BENT)])
    assert sizes == [24, 50] and problem is None and len(ran) == 3
    assert findings[0].kind == "mapped again" and "in 3 of 3 tries" in findings[0].what
    sizes, *_ = mapped([shared(49, BENT), shared(12, GOOD)], [shared(40, BENT), shared(30, GOOD)], first)
    assert sizes == [30, 40]


def test_that_no_model_is_plausible_is_told() -> None:
    sizes, problem, (finding,), ran = mapped(*[[shared(count, BENT)] for count in (49, 50, 10)])
    assert sizes == [50] and problem is not None and len(ran) == 3
    assert (finding.kind, finding.degree, len(finding.where)) == ("bent model", "stops", 50)
    assert "in 3 of 3 tries, its poses bent, and no other model is better" in finding.what
    assert finding.what.count("606 px across and 291 px up") == 3
    assert "Do not trust these poses" in finding.do and "EXIF states the focal length" in finding.do
    report = {
        "frames": [], "registered": 50, "images": 60, "points": 9, "reprojection_px": 0.4, "failed": {},
        "left_out": [], "georeference": None, "not_georeferenced_because": "no image says where it was taken",
        "findings": [asdict(finding)],
    }  # fmt: skip
    assert f"Bent model: {finding.what}. {finding.do}." in summary(report).splitlines()


def test_nothing_mapped_is_not_mapped_again() -> None:
    assert mapped([], [shared(60, GOOD)]) == ([], None, [], [Try(1.2, 0)])


@pytest.mark.slow
def test_tries_are_kept_on_disk(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Of the drawn scene, with lenses of the first try called bent: the second's models are read again, and
    other images begin anew."""
    steps(tmp_path / "images")
    work, told = tmp_path / "work", []
    verdicts = iter(["bent", None, "bent", None])
    monkeypatch.setattr("plnerf.capture.mapping.lens_problem", lambda camera, stated: next(verdicts))

    def tell(stage: str, done: int, of: int) -> None:
        told.append((stage, done))
        if of == COUNT + 1:
            raise KeyboardInterrupt

    def run() -> Any:
        one = PhotoFacts(320, 240, 1, None, None, None, None, None, None, "drawn")
        names = sorted(path.name for path in (tmp_path / "images").iterdir())
        told.clear()
        return reconstruct(
            tmp_path / "images", dict.fromkeys(names, one), work, choose_pairs(len(names), PairConfig()),
            SfmConfig(camera_model="SIMPLE_PINHOLE", features=1500, threads=1),
            tell=tell,
        )  # fmt: skip

    found = run()
    assert len(found.registered) == COUNT and found.findings[0].kind == "mapped again"
    assert ("model, try 2", 3) in told and not any("try 3" in stage for stage, _ in told)
    assert sorted(path.name for path in work.iterdir()) == [
        "database.db", "inputs.sha256", "models", "models-2", "pairs.txt",
    ]  # fmt: skip
    assert [path.name for path in (work / "models-2").iterdir()] == ["0"]
    again = run()
    assert again.findings == found.findings and again.registered == found.registered
    assert told == [("features", 9), ("matches", 36), ("model", 9), ("model, try 2", 9)]
    Image.fromarray(np.full((240, 320, 3), 90, np.uint8)).save(tmp_path / "images" / "90.png")
    with pytest.raises(KeyboardInterrupt):
        run()
    assert not any(work.glob("models*"))


@pytest.mark.parametrize("name", ["cameras", "frames", "images", "points3D", "rigs"])
def test_models_that_lack_a_file_or_a_part_of_one_are_not_kept(name: str, tiny_scene: Path) -> None:
    folder = tiny_scene / "models"
    write_colmap(read_listing(tiny_scene), folder / "0")
    path = folder / "0" / f"{name}.bin"
    (model,) = kept_models(folder) or []
    assert model.num_reg_images() == 12
    path.write_bytes(path.read_bytes()[:-3])
    assert kept_models(folder) is None
    path.unlink()
    assert kept_models(folder) is None
    assert kept_models(tiny_scene / "other") is None
