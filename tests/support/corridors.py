"""A corridor whose line is known: photos along it, and work on its blocks that costs nothing.

`KnownLine` stands in the place of what finds wires and surveys spans: of the true line it shows each block
what photos within reach would show, in the block's own frame.
"""

import json
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from plnerf.corridor.block_scene import GIVEN, GivenWires
from plnerf.corridor.ledger import Ledger, Task
from plnerf.corridor.part_file import PART, read_part
from plnerf.corridor.tasks import SURVEY, WIRES
from plnerf.export.crs import crs_transform
from plnerf.export.exports import LAS
from plnerf.export.las import write_las
from plnerf.line.cloud import CONDUCTOR, GROUND, NO_WIRE, Cloud
from plnerf.line.ends import Evidence, Open
from plnerf.line.files import SURVEY_FILE, read_wires, write_survey_json, write_wires
from plnerf.line.frame import LineFrame
from plnerf.line.line import Line
from plnerf.line.move import move_wire
from plnerf.line.survey import Survey
from plnerf.line.wire import Wire
from plnerf.scene.files import write_text
from plnerf.scene.formats import read_listing
from plnerf.scene.orientation import frames_for
from plnerf.survey.part import numbered_part, own_points

WORLD = LineFrame(np.eye(3), 1.0, np.zeros(3), "m")
"""The frame of the true line."""
REACH_M = 60.0
"""How far from a photo wires are seen."""
SIDES_M, HEIGHT_M, EVERY_M = (-14.0, 14.0), 22.0, 6.0
"""Two passes beside the line."""


def photos_along(folder: Path, line: Line) -> Path:
    """Writes a scene of photos on both sides of a line, which look at it; the files are no pictures."""
    (folder / "images").mkdir(parents=True)
    frames = []
    for side in SIDES_M:
        for span in line.spans:
            base = span.wires[1].base
            for s in np.arange(0.0, base.length_m, EVERY_M):
                eye = base.place(np.array([s]), np.array([[side, HEIGHT_M]]))[0]
                name = f"images/{len(frames):04d}.jpg"
                (folder / name).write_bytes(str(len(frames)).encode())
                frames.append({"file_path": name, "transform_matrix": _looking(eye, -side * base.n).tolist()})
    content = {
        "fl_x": 300.0, "fl_y": 300.0, "w": 480, "h": 320,
        "plnerf": {"unit": "m", "up": [0, 0, 1], "crs": "EPSG:25832"}, "frames": frames,
    }  # fmt: skip
    (folder / "transforms.json").write_text(json.dumps(content))
    return folder


def _looking(eye: np.ndarray, flat: np.ndarray) -> np.ndarray:
    """OpenGL's camera-to-world at a place, level, along a direction in plan."""
    back = -np.array([*flat, 0.0]) / np.linalg.norm(flat)
    up = np.array([0.0, 0.0, 1.0])
    pose = np.eye(4)
    pose[:3, :3] = np.stack([np.cross(up, back), up, back], 1)
    pose[:3, 3] = eye
    return pose


@dataclass(frozen=True)
class KnownLine:
    """Does tasks from the truth.  Called as `run_task`."""

    line: Line

    def __call__(self, out: Path, task: Task) -> None:
        """Writes what the task would, and its record."""
        folder, ledger = out / task.folder, Ledger(out)
        with (out / "did.txt").open("a") as file:
            file.write(f"{task.name}\n")
        files = (self._find if task.kind == "find" else self._survey)(folder)
        ledger.write(task, "done", seconds=1.0, processor_seconds=1.5, peak_mb=100.0, files=files)

    def _find(self, folder: Path) -> tuple[Path, ...]:
        frame, eyes = _frame_and_eyes(folder)
        seen = [of for wire in self.line.wires if (of := _within(wire, eyes)) is not None]
        wires = [replace(move_wire(wire, WORLD, frame), id=k) for k, wire in enumerate(seen, 1)]
        write_wires(folder / WIRES, wires, frame, {})
        return (folder / WIRES,)

    def _survey(self, folder: Path) -> tuple[Path, ...]:
        """The spans that the given wires show, with numbers of their own, and points on and below them."""
        part, (frame, _) = read_part(folder / PART), _frame_and_eyes(folder)
        given, of = read_wires(folder / GIVEN)
        assert len(GivenWires(folder / GIVEN).path.name)
        shown = [move_wire(wire, of, WORLD) for wire in given]
        spans, points, owners, renamed = [], [np.zeros((0, 3))], [np.zeros(0, np.int64)], {}
        for span in self.line.spans:
            near = [wire for wire in span.wires if any(_beside(wire, other) for other in shown)]
            if not near:
                continue
            wires = []
            for wire in near:
                renamed[wire.id] = len(renamed) + 1
                wires.append(replace(move_wire(wire, WORLD, frame), id=renamed[wire.id]))
                on = wires[-1].points(np.linspace(0.0, wire.base.length_m, 40))
                points += [on, on * [1.0, 1.0, 0.0]]
                owners += [np.full(40, renamed[wire.id]), np.full(40, NO_WIRE)]
            spans.append(replace(span, wires=tuple(wires)))
        held = {one for span in spans for one in span.structures}
        feet = [
            replace(one, foot=frame.from_world(one.foot)) for one in self.line.structures if one.id in held
        ]
        xyz, wire = np.concatenate(points), np.concatenate(owners)
        cloud = Cloud(xyz, np.where(wire > 0, CONDUCTOR, GROUND).astype(np.uint8), wire)
        lines, cloud, _ = numbered_part(part, frame, [Line(1, tuple(feet), tuple(spans))], cloud)
        survey = own_points(Survey(frame, lines, cloud, str(folder), from_images=True), part)
        place = folder / SURVEY
        write_survey_json(place / SURVEY_FILE, survey)
        write_las(place / LAS, survey.cloud, crs_transform(survey), synthetic=True)
        write_text(place / "report.html", "a span\n")
        return (place / SURVEY_FILE, place / LAS, place / "report.html")


def _frame_and_eyes(folder: Path) -> tuple[LineFrame, np.ndarray]:
    listing = read_listing(folder)
    poses = np.stack([shot.T_world_camera for shot in listing.shots])
    frames = frames_for(poses, up=listing.up, unit=listing.unit, crs=listing.crs, origin=listing.origin)
    return LineFrame.of_scene(frames), poses[:, :3, 3]


def _within(wire: Wire, eyes: np.ndarray) -> Wire | None:
    """What photos within reach show of a wire, known to centimetres; None where that is next to nothing."""
    s = np.linspace(0.0, wire.base.length_m, 80)
    apart = np.linalg.norm(wire.points(s)[:, None] - eyes, axis=2).min(1)
    inside = s[apart <= REACH_M]
    if len(inside) < 8:
        return None
    seen = Evidence("a test", 40, reach_m=0.1)
    known = replace(wire, covariance=np.diag([4e-5] * 5 + [1e-6]), evidence=seen)
    open_ended = replace(known, ends=(Open("not searched"), Open("not searched")))
    return open_ended.between(float(inside[0]), float(inside[-1]))


def _beside(wire: Wire, other: Wire) -> bool:
    """Whether another wire runs on this one."""
    local = wire.base.local(other.points(np.linspace(0.0, other.base.length_m, 9)))
    return bool(np.abs(local[:, 1:] - wire.at(local[:, 0])).max() < 0.2)
