"""The doctor finds in photos what will fail, names it, and says what to do."""

import json
import sys
from dataclasses import replace
from datetime import datetime, timedelta
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from PIL import ExifTags, Image
from tests.capture.test_frames import seen
from tests.support.bad_photos import write_bad_photos

from plnerf.capture.exif import GpsFix, PhotoFacts
from plnerf.capture.photos import bring_upright, find_photos
from plnerf.capture.references import from_photos
from plnerf.cli.main import main
from plnerf.doctor.config import PhotoDoctorConfig
from plnerf.doctor.cost import FEATURES_S_PER_MP, MODEL_S_PER_IMAGE, PAIR_S, about_cost, in_words
from plnerf.doctor.photo_doctor import examine_photos, photo_text, write_photo_diagnosis
from plnerf.doctor.photo_rules import about_files, about_positions, about_wires
from plnerf.errors import CaptureError, ConfigError
from plnerf.findings import Finding

COST: dict[str, Any] = {"preset": "nerfacto", "rays_per_s": 2e4}
START = datetime(2026, 5, 1, 12, 0, 0)
FACTS = PhotoFacts(4000, 3000, 1, START, None, None, None, None, 3000.0, "a camera")


def flown(metres: list[float], seconds: float | None = 2.0) -> dict[str, PhotoFacts]:
    """Photos to the north of one another."""
    return {
        f"{i}.jpg": replace(
            FACTS,
            time=None if seconds is None else START + timedelta(seconds=seconds * i),
            fix=GpsFix(10.0, 50.0 + there / 111_250, 300.0, 3.0, 10.0),
        )
        for i, there in enumerate(metres)
    }


def by_kind(findings: list[Finding]) -> dict[str, Finding]:
    return {finding.kind: finding for finding in findings}


def write(path: Path, picture: np.ndarray) -> None:
    Image.fromarray(picture).save(path, quality=95)


@pytest.fixture
def photos(tmp_path: Path) -> Path:
    """Twelve good photos, a blurred one, a white one, a black one, a twin, a cut-off file and a raw one."""
    folder = tmp_path / "photos"
    folder.mkdir()
    for i in range(12):
        write(folder / f"{i:02d}.jpg", seen(30.0 * i))
    write(folder / "05b.jpg", seen(165.0, blur=25))
    write(
        folder / "06b.jpg",
        np.maximum(seen(195.0), 255 * (np.indices((200, 320))[0] < 90)[..., None]).astype(np.uint8),
    )
    write(folder / "07b.jpg", seen(225.0) * (np.indices((200, 320))[0] < 120)[..., None].astype(np.uint8))
    write(folder / "08b.jpg", seen(240.5))
    write(folder / "20.jpg", cv2.resize(seen(400.0), (300, 200)))
    whole = (folder / "11.jpg").read_bytes()
    (folder / "21.jpg").write_bytes(whole[: len(whole) // 2])
    (folder / "22.NEF").write_bytes(b"raw")
    return folder


def test_every_fault_is_named_with_its_photos(photos: Path, tmp_path: Path) -> None:
    calls: list[tuple[int, int]] = []
    diagnosis = examine_photos(
        photos, distance_m=None, **COST, progress=lambda done, of: calls.append((done, of))
    )
    write_photo_diagnosis(tmp_path / "d.json", diagnosis)
    assert calls == [(k, 18) for k in range(1, 19)]
    content = json.loads((tmp_path / "d.json").read_text())
    found = {finding["kind"]: finding for finding in content["findings"]}
    assert diagnosis.usable and content["usable"] and content["photos"] == 17
    assert set(found["unreadable"]["where"]) == {"21.jpg", "22.NEF"}
    assert "05b.jpg" in found["blurred"]["where"] and len(found["blurred"]["where"]) <= 2
    assert found["over-exposed"]["where"] == ["06b.jpg"] and found["under-exposed"]["where"] == ["07b.jpg"]
    assert found["duplicates"]["where"] == ["08b.jpg"]
    assert found["unequal sizes"]["where"] == ["20.jpg"]
    assert found["not georeferenced"]["degree"] == found["wire width unknown"]["degree"] == "note"
    assert all(finding["do"] for finding in content["findings"] if finding["kind"] != "cost")
    for finding in diagnosis.findings:  # whole sentences
        assert all(text[0].isupper() or text[0].isdigit() for text in (finding.what, finding.do) if text)
        assert finding.text.endswith(".") and ".." not in finding.text
    text = photo_text(diagnosis)
    assert "harms  over-exposed: 1 of 17 photos are white over more than 25% of their area. " in text
    assert "before a white sky wires vanish. (06b.jpg)" in text


def test_bad_photos_are_left_out_and_named(tmp_path: Path) -> None:
    bad = write_bad_photos(tmp_path)
    for i in range(3):
        write(tmp_path / f"{i}.jpg", seen(30.0 * i))
    diagnosis = examine_photos(tmp_path, distance_m=None, **COST)
    assert diagnosis.photos == 3 and diagnosis.usable
    assert set(by_kind(list(diagnosis.findings))["unreadable"].where) == bad
    copied = bring_upright(find_photos(tmp_path), tmp_path / "scene" / "images")
    assert list(copied.facts) == ["0.jpg", "1.jpg", "2.jpg"]
    assert {problem.split(":")[0] for problem in copied.problems} == bad


def test_too_few_photos_stop(photos: Path, tmp_path: Path) -> None:
    for path in sorted(photos.iterdir())[2:]:
        path.unlink()
    assert not examine_photos(photos, distance_m=None, **COST).usable
    assert about_files({}, [])[0].degree == "stops"


def test_jumps_are_told_from_fast_flights() -> None:
    steady = [10.0 * i for i in range(10)]
    facts = flown(steady)
    assert not about_positions(facts, from_photos(facts))
    wrong = [*steady[:5], 50_000.0, *steady[6:]]
    for seconds in (2.0, None):
        facts = flown(wrong, seconds)
        assert by_kind(about_positions(facts, from_photos(facts)))["jump"].where == ("5.jpg", "6.jpg")
    pause = flown([*steady, 10_000.0, 10_010.0])
    pause["10.jpg"], pause["11.jpg"] = (
        replace(pause[name], time=START + timedelta(hours=1, seconds=k))
        for k, name in enumerate(["10.jpg", "11.jpg"])
    )
    assert not about_positions(pause, from_photos(pause))  # an hour is enough for ten kilometres


def test_positions_that_stand_still_or_lack() -> None:
    facts = flown([0.0] * 5)
    assert "one place" in by_kind(about_positions(facts, from_photos(facts)))
    facts["2.jpg"] = replace(FACTS, fix=None, fix_problem="it is 0, 0: the receiver had no position")
    missing = by_kind(about_positions(facts, from_photos(facts)))["no position"]
    assert missing.where == ("2.jpg",) and "0, 0" in missing.what
    nowhere = {name: replace(fact, fix=None) for name, fact in facts.items()}
    assert by_kind(about_positions(nowhere, from_photos(nowhere)))["not georeferenced"].degree == "note"


@pytest.mark.parametrize(
    ("distance", "degree", "px"), [(10.0, "note", "9.0"), (50.0, "harms", "1.8"), (150.0, "stops", "0.6")]
)
def test_a_wire_is_as_wide_as_lens_and_distance_make_it(distance: float, degree: str, px: str) -> None:
    (finding,) = about_wires({"a": FACTS}, distance)
    assert finding.degree == degree and f"is {px} px wide" in finding.what
    assert f"A pixel is {100 * distance / 3000:.1f} cm at {distance:g} m" in finding.what


def test_an_unknown_lens_or_distance_is_reported() -> None:
    assert "how far the wires are" in about_wires({"a": FACTS}, None)[0].what
    assert "a focal length" in about_wires({"a": replace(FACTS, focal_px=None)}, 10.0)[0].what


def test_the_cost_grows_with_pixels_and_pairs() -> None:
    few = about_cost({f"{i}": FACTS for i in range(20)}, "nerfacto", 2e4)
    # Features come from 1600 x 1200 px of each; 190 pairs; 240 MP, of which a 16th takes 3 minutes.
    seconds = FEATURES_S_PER_MP * 20 * 1.92 + PAIR_S * 190 + MODEL_S_PER_IMAGE * 20
    assert f"On two cores, poses take about {in_words(seconds)}; " in few.what
    assert f"training nerfacto on each pixel once, {in_words(12_000.0)}; 1.5 GB of memory" in few.what
    assert few.what.endswith("and 0.7 GB of pixels on disk.")
    assert few.do.startswith("Train with --downscale 8: 3 min")  # by 4 it is still more than ten minutes
    unknown = about_cost({f"{i}": FACTS for i in range(20)}, "mine", None)
    assert "training" not in unknown.what and not unknown.do
    assert [in_words(s) for s in (40.0, 720.0, 20_000.0, 300_000.0)] == ["40 s", "12 min", "5.6 h", "3 days"]


def test_the_command_takes_photos_and_ends_with_its_status(
    photos: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    for path in photos.glob("*.jpg"):
        image = Image.open(path) if path.name != "21.jpg" else None
        if image is not None:
            exif = image.getexif()
            exif.get_ifd(ExifTags.IFD.Exif)[ExifTags.Base.FocalLengthIn35mmFilm] = 24
            image.save(path, exif=exif, quality=95)
    for distance, status in (("5", 0), ("60", 3)):
        monkeypatch.setattr(sys, "argv", ["plnerf", "doctor", str(photos), "--distance", distance])
        with pytest.raises(SystemExit) as stop:
            main()
        out = capsys.readouterr().out
        assert stop.value.code == status and "17 photos can be read" in out and "px wide" in out
    with pytest.raises(CaptureError, match="is no folder of photos"):
        examine_photos(photos / "absent", distance_m=None, **COST)


def test_the_configuration_decides(photos: Path) -> None:
    thick = about_wires({"a": FACTS}, 50.0, PhotoDoctorConfig(wire_diameter_m=0.06, good_wire_px=3.5))
    assert "is 3.6 px wide" in thick[0].what and thick[0].degree == "note"
    lenient = examine_photos(
        photos, distance_m=None, **COST, config=PhotoDoctorConfig(clipped=1.0, alike=0.0)
    )
    assert not {"over-exposed", "under-exposed", "duplicates"} & {one.kind for one in lenient.findings}
    for wrong in ({"clipped": 0.0}, {"dark": 250}, {"fastest_m_s": 0.0}):
        with pytest.raises(ConfigError):
            PhotoDoctorConfig(**wrong)  # type: ignore[arg-type]
