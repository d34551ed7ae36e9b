"""The page on troubleshooting has every finding of the doctor, with its degree and its text."""

import ast
import re
from dataclasses import replace
from pathlib import Path

import numpy as np
from tests.conftest import ROOT
from tests.doctor.test_photo_doctor import FACTS, flown

import plnerf.doctor
from plnerf.capture.references import References, from_photos
from plnerf.doctor.config import SCENES
from plnerf.doctor.cost import about_cost
from plnerf.doctor.coverage import advice
from plnerf.doctor.photo_rules import Thumbnail, about_files, about_pictures, about_positions, about_wires
from plnerf.findings import Finding

PAGE = (ROOT / "docs" / "troubleshooting.md").read_text(encoding="utf-8")
REASON = "(the first"
"""Where the page does not quote, since the text is the first photo's own reason."""


def all_findings() -> list[Finding]:
    """Every finding that the rules of photos can make."""
    lost = replace(FACTS, fix=None, fix_problem="it is 0, 0: the receiver had no position")
    jumps = flown([*(10.0 * i for i in range(5)), 50_000.0])
    still = flown([0.0] * 5) | {"lost.jpg": lost}
    nowhere = {"a.jpg": replace(FACTS, fix=None)}
    grey = np.random.default_rng(0).uniform(0, 255, (40, 16, 16))
    pictures = {f"{i:02d}.jpg": Thumbnail(100.0, 0.0, 0.0, grey[i]) for i in range(40)}
    pictures |= {"20.jpg": replace(pictures["20.jpg"], sharpness=1.0)}
    pictures |= {"41.jpg": Thumbnail(100.0, 0.9, 0.0, grey[39])}
    pictures |= {"42.jpg": Thumbnail(100.0, 0.0, 0.9, grey[0])}
    small = {"b.jpg": replace(FACTS, width_px=400, height_px=300)}
    return [
        *about_files({}, ["a.jpg: cut off"]),
        *about_files(jumps | small, []),
        *about_pictures(pictures),
        *about_positions(jumps, from_photos(jumps)),
        *about_positions(still, from_photos(still)),
        *about_positions(nowhere, References("EPSG:4979", {}, "geo.txt")),
        *(one for distance in (10.0, 40.0, 400.0, None) for one in about_wires(jumps, distance)),
        *about_wires({"a.jpg": replace(FACTS, focal_px=None)}, 10.0),
        about_cost({str(i): FACTS for i in range(200)}, "nerfacto", 2e4),
    ]


def rows() -> list[list[str]]:
    return [[cell.strip() for cell in line.strip("|").split("|")] for line in PAGE.splitlines()]


def without_numbers(text: str) -> str:
    return re.sub(r"\d+(?:[.,]\d+)*", "N", text)


def test_every_finding_of_photos_is_on_the_page_with_its_text() -> None:
    on_page = {(row[0], row[1], row[2]): row for row in rows() if len(row) == 5}
    for found in all_findings():
        texts = {text for kind, degree, text in on_page if (kind, degree) == (found.kind, found.degree)}
        assert texts, f"{found.kind} ({found.degree}) is not on the page"
        if any(REASON in text for text in texts):
            continue
        assert without_numbers(found.what) in {without_numbers(text) for text in texts}, found.what
    kinds = {kind for kind, _, _ in on_page} - {"finding", "---"}
    assert kinds == {found.kind for found in all_findings()}, "a row without a finding, or a rule not tried"


def test_no_finding_of_the_doctor_is_left_out_here() -> None:
    kinds = set()
    for path in Path(plnerf.doctor.__file__).parent.glob("*.py"):
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            if isinstance(node, ast.Call) and getattr(node.func, "id", "") in {"Finding", "note", "harms"}:
                first = node.args[0]
                kinds.add(first.value if isinstance(first, ast.Constant) else getattr(first, "id", "?"))
    assert kinds - {"kind"} <= {found.kind for found in all_findings()}  # kind: of about_pictures, run here


def test_every_verdict_on_a_stretch_is_on_the_page() -> None:
    on_page = {row[0] for row in rows() if len(row) == 3}
    assert set(advice(SCENES)) <= on_page
