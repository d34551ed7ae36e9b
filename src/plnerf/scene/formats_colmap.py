"""Reads and writes COLMAP models (sparse reconstructions), binary and text, through pycolmap.

COLMAP poses are world-to-camera with OpenCV axes, and its pixels count from the image's top-left corner with
the first pixel's centre at (0.5, 0.5): only the inverse of each pose is taken here.
"""

import os
import tempfile
from pathlib import Path

import numpy as np
from jaxtyping import Float, UInt8

from plnerf.errors import SceneError
from plnerf.scene.colmap import pycolmap
from plnerf.scene.colmap_files import check_model
from plnerf.scene.json_fields import is_file
from plnerf.scene.listing import Intrinsics, Listing, Shot, check_lens, check_present, check_unique
from plnerf.scene.transforms import rigid_pose

_MODEL_FOLDERS = ("sparse/0", "sparse", "colmap/sparse/0", ".")
_FILES = ("cameras", "images", "points3D")


def find_model(source: Path) -> Path | None:
    """The folder with cameras.bin or cameras.txt in or below ``source``, or None."""
    for folder in _MODEL_FOLDERS:
        if any((source / folder / f"cameras.{kind}").is_file() for kind in ("bin", "txt")):
            return source / folder if folder != "." else source
    return None


def read_colmap(source: Path) -> Listing:
    """The registered images of a COLMAP model, sorted by name.  Raises SceneError for what cannot be used.

    source: a folder with ``sparse/0`` and ``images/``, or the model folder itself with ``images/`` in it or
    in one of the two folders above it.
    """
    model = find_model(source)
    if model is None:
        raise SceneError(
            f"{source} holds no COLMAP model: neither cameras.bin nor cameras.txt is in it or in sparse/0."
        )
    images = _find_images(source, model)
    reconstruction = _load(model)
    root = images.parent
    shots, missing, unregistered = [], [], []
    for image in sorted(reconstruction.images.values(), key=lambda image: image.name):
        path = images / image.name
        if Path(image.name).is_absolute() or ".." in Path(image.name).parts:
            raise SceneError(
                f"The COLMAP model {model} names the image {image.name}, outside of {images}. Run the "
                "reconstruction again, with names below its folder of images."
            )
        if not image.has_pose:
            unregistered.append(image.name)
        elif not is_file(path):
            missing.append(image.name)
        else:
            camera = reconstruction.cameras[image.camera_id]
            rows = np.asarray(image.cam_from_world().inverse().matrix(), dtype=np.float64)
            shots.append(
                Shot(
                    name=path.relative_to(root).as_posix(),
                    path=path,
                    T_world_camera=rigid_pose(rows, f"{model}, image {image.name}"),
                    intrinsics=_intrinsics(camera, model),
                )
            )
    check_present(len(shots) + len(missing), missing, model, may_leave_out=False)
    if not shots:
        raise SceneError(
            f"The COLMAP model {model} has no image with a pose. Run the reconstruction again, with more "
            "overlap between the photos."
        )
    check_unique(shots, model)
    return Listing(root=root, shots=tuple(shots), format="colmap", left_out=tuple(unregistered))


def read_sparse_points(source: Path) -> tuple[Float[np.ndarray, "n 3"], UInt8[np.ndarray, "n 3"]] | None:
    """Places and colours of a COLMAP model's points, in its own frame; None where there is no model.

    Raises SceneError for a model that cannot be read.
    """
    model = find_model(source)
    if model is None:
        return None
    points = _load(model).points3D.values()
    xyz = np.array([point.xyz for point in points], np.float64).reshape(-1, 3)
    rgb = np.array([point.color for point in points], np.uint8).reshape(-1, 3)
    kept = np.isfinite(xyz).all(1)
    return xyz[kept], rgb[kept]


def write_colmap(listing: Listing, folder: Path, *, text: bool = False) -> None:
    """Writes poses and intrinsics (no points) as a COLMAP model of PINHOLE or OPENCV cameras into ``folder``.

    Image names are written relative to ``images/``.  Raises SceneError when a camera has k3, which COLMAP's
    OPENCV model has not.
    """
    reconstruction = pycolmap.Reconstruction()
    cameras: dict[Intrinsics, int] = {}
    for number, shot in enumerate(listing.shots, start=1):
        lens = shot.intrinsics
        if lens not in cameras:
            cameras[lens] = len(cameras) + 1
            reconstruction.add_camera_with_trivial_rig(_colmap_camera(lens, cameras[lens], shot.name))
        T_camera_world = np.linalg.inv(shot.T_world_camera)
        image = pycolmap.Image(
            name=shot.name.removeprefix("images/"),
            camera_id=cameras[lens],
            image_id=number,
            keypoints=np.zeros((0, 2)),
        )
        reconstruction.add_image_with_trivial_frame(image, pycolmap.Rigid3d(T_camera_world[:3]))
    folder.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory(dir=folder.parent, prefix=f"{folder.name}.partial-") as beside:
        (reconstruction.write_text if text else reconstruction.write_binary)(beside)
        for file in Path(beside).iterdir():
            os.replace(file, folder / file.name)


def _find_images(source: Path, model: Path) -> Path:
    above = [source, model, *model.absolute().parents[:2]]
    for folder in above:
        if (folder / "images").is_dir():
            return folder / "images"
    raise SceneError(
        f'The COLMAP model {model} needs its photos in a folder "images" inside it or in one of the two '
        "folders above it, but none is there. Move or link the photos to such a folder."
    )


def _load(model: Path) -> pycolmap.Reconstruction:
    kind = "bin" if (model / "cameras.bin").is_file() else "txt"
    absent = [f"{name}.{kind}" for name in _FILES if not (model / f"{name}.{kind}").is_file()]
    if absent:
        raise SceneError(
            f"The COLMAP model {model} is not whole: {', '.join(absent)} is not there. Copy the whole model "
            "folder, or run the reconstruction again."
        )
    check_model(model)
    try:
        return pycolmap.Reconstruction(model)
    except (ValueError, RuntimeError, KeyError, IndexError, OSError, MemoryError) as error:
        raise SceneError(
            f"The COLMAP model {model} cannot be read ({str(error).splitlines()[0]}). Copy it again, or run "
            "the reconstruction again."
        ) from error


def _intrinsics(camera: pycolmap.Camera, model: Path) -> Intrinsics:
    p = [float(value) for value in camera.params]
    match camera.model_name:
        case "SIMPLE_PINHOLE":
            fl_x, fl_y, cx, cy, k1, k2, p1, p2 = p[0], p[0], p[1], p[2], 0.0, 0.0, 0.0, 0.0
        case "PINHOLE":
            fl_x, fl_y, cx, cy, k1, k2, p1, p2 = p[0], p[1], p[2], p[3], 0.0, 0.0, 0.0, 0.0
        case "SIMPLE_RADIAL":
            fl_x, fl_y, cx, cy, k1, k2, p1, p2 = p[0], p[0], p[1], p[2], p[3], 0.0, 0.0, 0.0
        case "RADIAL":
            fl_x, fl_y, cx, cy, k1, k2, p1, p2 = p[0], p[0], p[1], p[2], p[3], p[4], 0.0, 0.0
        case "OPENCV":
            fl_x, fl_y, cx, cy, k1, k2, p1, p2 = p
        case other:
            raise SceneError(
                f"Camera {camera.camera_id} of the COLMAP model {model} has the model {other}, which cannot "
                "be used; plnerf reads SIMPLE_PINHOLE, PINHOLE, SIMPLE_RADIAL, RADIAL and OPENCV. Undistort "
                "the photos (colmap image_undistorter) and give the folder that it writes."
            )
    lens = Intrinsics(
        int(camera.width),
        int(camera.height),
        fl_x,
        fl_y,
        cx,
        cy,
        (k1, k2, p1, p2, 0.0),
        f"COLMAP camera {camera.camera_id}",
    )
    check_lens(lens, f"{model}, camera {camera.camera_id}")
    return lens


def _colmap_camera(lens: Intrinsics, number: int, name: str) -> pycolmap.Camera:
    k1, k2, p1, p2, k3 = lens.distortion
    if k3:
        raise SceneError(
            f"The camera of {name} has k3 = {k3:g}, which COLMAP's OPENCV model has not. Undistort the "
            "photos first."
        )
    params = [lens.fl_x, lens.fl_y, lens.cx, lens.cy]
    distorted = any((k1, k2, p1, p2))
    return pycolmap.Camera(
        model="OPENCV" if distorted else "PINHOLE",
        width=lens.width,
        height=lens.height,
        params=[*params, k1, k2, p1, p2] if distorted else params,
        camera_id=number,
    )
