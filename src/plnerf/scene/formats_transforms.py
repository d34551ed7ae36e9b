"""Reads transforms.json as nerfstudio, instant-ngp and Blender's NeRF exporter write it, with plnerf's own
keys.

Poses in the file are camera-to-world with OpenGL camera axes; they leave this file with OpenCV's.  An
instant-ngp file is recognised by its key ``aabb_scale``.  plnerf's keys (all optional, under ``plnerf``):
format_version, unit, crs, origin_lon_lat_height, up, test, truth, root (the folder below which all paths
lie, where it is not that of the file); and per frame wire_mask_path and depth_path.  Keys that are not known
are passed over.
"""

import math
import posixpath
from collections.abc import Mapping
from pathlib import Path
from typing import Literal

from plnerf.errors import SceneError
from plnerf.scene.decode import stored_size_px
from plnerf.scene.json_fields import (
    Json,
    file_of,
    is_file,
    is_folder,
    number_of,
    numbers_of,
    section_of,
    text_of,
    vector_of,
)
from plnerf.scene.listing import Intrinsics, Listing, Shot, check_lens, check_present, check_unique, some
from plnerf.scene.strict_json import read_json, shown
from plnerf.scene.transforms import flip_camera_axes, rigid_pose

FORMAT_VERSION = 1
_READABLE_MODELS = {"OPENCV", "PINHOLE", "SIMPLE_PINHOLE", "SIMPLE_RADIAL", "RADIAL", "PERSPECTIVE"}
_INTRINSIC_KEYS = {"fl_x", "fl_y", "cx", "cy", "w", "h", "camera_angle_x", "camera_angle_y"}
_SUFFIXES = ("", ".png", ".jpg")


def read_transforms(path: Path) -> Listing:
    """The images, poses and intrinsics of a transforms.json.  Raises SceneError for what cannot be used."""
    data = _load(path)
    ours = section_of(data, "plnerf", path)
    version = ours.get("format_version", FORMAT_VERSION)
    if version != FORMAT_VERSION:
        raise SceneError(
            f"{path} has plnerf.format_version {version!r}, but this version of plnerf reads "
            f"{FORMAT_VERSION}. Update plnerf, or make the scene folder again with this version."
        )
    frames = data.get("frames")
    if not isinstance(frames, list) or not frames or not all(isinstance(f, dict) for f in frames):
        came = {"[]": "an empty list", "None": "nothing"}.get(str(frames), f"a {type(frames).__name__}")
        raise SceneError(
            f'{path} needs a list "frames" with one object per image, but has {came} there. Is it the file '
            "of another program?"
        )
    root = _root(ours, path)
    located = [(_name(frame, path), frame) for frame in frames]
    files = {name: _locate(root, name) for name, _ in located}
    missing = sorted(name for name, file in files.items() if file is None)
    may_leave_out = "aabb_scale" in data
    check_present(len(frames), missing, path, may_leave_out=may_leave_out)
    present = [(name, frame, file) for name, frame in located if (file := files[name]) is not None]
    present.sort(key=lambda entry: entry[0])
    data = {**data, **_shared_size(data, present[0][2])}
    shots = [_shot(root, file, frame, data, f"{path}, frame {name}") for name, frame, file in present]
    check_unique(shots, path)
    return Listing(
        root=root,
        shots=tuple(shots),
        format="instant-ngp" if may_leave_out else "nerfstudio",
        train=_names(data, "train_filenames", path, files, root),
        test=_held_out(data, ours, path, files, root),
        up=vector_of(ours, "up", path),
        unit=_unit(ours, path),
        crs=text_of(ours, "crs", f"{path}, key plnerf"),
        origin=vector_of(ours, "origin_lon_lat_height", path),
        truth=file_of(root, ours, "truth", f"{path}, key plnerf"),
        left_out=tuple(missing),
    )


def _load(path: Path) -> Json:
    data = read_json(path, SceneError, "Correct it there, or write the file again.")
    if not isinstance(data, dict):
        raise SceneError(
            f'{path} must hold a JSON object with the key "frames", but holds a {type(data).__name__}. Is it '
            "the file of another program?"
        )
    return data


def _root(ours: Json, path: Path) -> Path:
    """The folder below which the paths of the file lie."""
    stated = text_of(ours, "root", f"{path}, key plnerf")
    root = path.parent if stated is None else path.parent / stated
    if not is_folder(root):
        raise SceneError(
            f"{path} states that its images lie below {root}, which is no folder. Put them there, or correct "
            "plnerf.root."
        )
    return root


def _name(frame: Json, path: Path) -> str:
    name = frame.get("file_path")
    if not isinstance(name, str) or not name:
        raise SceneError(
            f'{path}: every frame needs "file_path", the path of its image below the folder of the file, but '
            f"one has {shown(name)}. Correct the file."
        )
    return posixpath.normpath(name.replace("\\", "/"))


def _locate(root: Path, name: str) -> Path | None:
    """The image file; a path without extension (Blender's exporter) is tried with .png and .jpg."""
    for suffix in _SUFFIXES:
        if is_file(root / (name + suffix)):
            return root / (name + suffix)
    return None


def _shown(root: Path, file: Path) -> str:
    """The image's name: its path below the scene folder, or the whole path when it lies elsewhere."""
    return (file.relative_to(root) if file.is_relative_to(root) else file).as_posix()


def _shared_size(data: Json, first: Path) -> Json:
    """w and h for the whole file: as stated, else those of the first image (all must then be of that
    size)."""
    if data.get("w") is not None and data.get("h") is not None:
        return {}
    width, height = stored_size_px(first)
    return {"w": width, "h": height}


def _shot(root: Path, file: Path, frame: Json, data: Json, where: str) -> Shot:
    if "transform_matrix" not in frame:
        raise SceneError(
            f"{where}: the frame has no transform_matrix, so this image has no pose. Remove the frame, or "
            "run the pose estimation again."
        )
    matrix = numbers_of(frame["transform_matrix"])
    if not matrix.size:
        raise SceneError(
            f"{where}: transform_matrix must be 4 rows of 4 numbers, but is "
            f"{shown(frame['transform_matrix'])}. Correct the file."
        )
    if matrix.ndim != 2 or matrix.shape[1] != 4:
        raise SceneError(
            f"{where}: transform_matrix must be 4 rows of 4 numbers, but has shape {matrix.shape}. Correct "
            "the file."
        )
    return Shot(
        name=_shown(root, file),
        path=file,
        T_world_camera=flip_camera_axes(rigid_pose(matrix, where)),
        intrinsics=_intrinsics(frame, data, file, where),
        mask=file_of(root, frame, "mask_path", where),
        wire_mask=file_of(root, frame, "wire_mask_path", where),
        depth=file_of(root, frame, "depth_path", where),
    )


def _intrinsics(frame: Json, data: Json, file: Path, where: str) -> Intrinsics:
    """The frame's own values before the file's.  A frame with intrinsics but without w and h has its image's
    size."""
    both = {**data, **frame}
    _check_model(both, where)
    own = not _INTRINSIC_KEYS.isdisjoint(frame)
    sized = frame if own else data
    width, height = number_of(sized, "w", where), number_of(sized, "h", where)
    if width is None or height is None:
        width, height = stored_size_px(file)
    fl_x, fl_y = _focal(both, "x", width, where), _focal(both, "y", height, where)
    if fl_x is None and fl_y is None:
        raise SceneError(
            f"{where}: no focal length. The file must give fl_x (and fl_y, cx, cy) in pixels or "
            "camera_angle_x in radians, for the whole file or per frame. Take them from the camera's "
            "calibration, or run the pose estimation again."
        )
    cx, cy = number_of(both, "cx", where), number_of(both, "cy", where)
    k1, k2, p1, p2, k3 = (number_of(both, key, where) or 0.0 for key in ("k1", "k2", "p1", "p2", "k3"))
    x = fl_x if fl_x is not None else fl_y
    y = fl_y if fl_y is not None else fl_x
    assert x is not None and y is not None
    lens = Intrinsics(
        width=round(width),
        height=round(height),
        fl_x=x,
        fl_y=y,
        cx=width / 2 if cx is None else cx,
        cy=height / 2 if cy is None else cy,
        distortion=(k1, k2, p1, p2, k3),
        owner=f"frame {frame['file_path']}" if own else "the whole file",
    )
    check_lens(lens, where)
    return lens


def _focal(values: Json, axis: Literal["x", "y"], size: float, where: str) -> float | None:
    focal = number_of(values, f"fl_{axis}", where)
    if focal is not None:
        return focal
    angle_rad = number_of(values, f"camera_angle_{axis}", where)
    if angle_rad is None or not 0 < angle_rad < math.pi:
        return None
    return 0.5 * size / math.tan(0.5 * angle_rad)


def _check_model(values: Json, where: str) -> None:
    model = values.get("camera_model", "OPENCV")
    higher = [key for key in ("k4", "k5", "k6") if values.get(key)]
    if not isinstance(model, str) or model not in _READABLE_MODELS or values.get("is_fisheye") or higher:
        what = (
            f"non-zero {', '.join(higher)}"
            if higher
            else "is_fisheye"
            if values.get("is_fisheye")
            else shown(model)
        )
        raise SceneError(
            f"{where}: the camera model ({what}) cannot be used; plnerf reads pinhole cameras with OpenCV's "
            "k1, k2, p1, p2, k3. Undistort the photos first (colmap image_undistorter) and use the poses of "
            "the result."
        )


def _held_out(
    data: Json, ours: Json, path: Path, files: Mapping[str, Path | None], root: Path
) -> tuple[str, ...] | None:
    """nerfstudio's test list, else its validation list, else plnerf's."""
    for values, key in ((data, "test_filenames"), (data, "val_filenames"), (ours, "test")):
        names = _names(values, key, path, files, root)
        if names is not None:
            return names
    return None


def _names(
    values: Json, key: str, path: Path, files: Mapping[str, Path | None], root: Path
) -> tuple[str, ...] | None:
    """The images that a list of file names means; those that were left out are passed over."""
    listed = values.get(key)
    if listed is None:
        return None
    if not isinstance(listed, list) or not all(isinstance(name, str) for name in listed):
        raise SceneError(
            f'{path}: "{key}" must be a list of file paths, but is {shown(listed)}. Correct the file.'
        )
    wanted = [posixpath.normpath(name.replace("\\", "/")) for name in listed]
    unknown = [name for name in wanted if name not in files]
    if unknown:
        raise SceneError(
            f'{path}: "{key}" names {len(unknown)} images that are no frames of the file ({some(unknown)}). '
            "Use the file_path of the frames."
        )
    return tuple(_shown(root, file) for name in wanted if (file := files[name]) is not None)


def _unit(values: Json, path: Path) -> Literal["m", "unscaled"]:
    match values.get("unit", "unscaled"):
        case "m":
            return "m"
        case "unscaled":
            return "unscaled"
        case other:
            raise SceneError(
                f'{path}: plnerf.unit must be "m" or "unscaled", but is {shown(other)}. Lengths are metres '
                "or unknown; convert the poses if they are in another unit."
            )
