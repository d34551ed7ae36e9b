"""The images of a rendered scene as a camera with a satellite receiver leaves them, without poses.

The folder holds the same JPEGs with their focal length in EXIF, and geo.txt: the camera centres on the earth,
each off by normal noise of the stated standard deviation, as real-time kinematic positioning (RTK) has it.
It holds neither poses nor anything of the truth.
"""

from pathlib import Path

import numpy as np
from PIL import ExifTags, Image

from plnerf.capture.local_frame import LocalFrame
from plnerf.scene.files import write_text
from plnerf.scene.formats import read_listing

PLACE = LocalFrame("EPSG:4979", (10.0, 51.0, 250.0))
"""Where on the earth the synthetic world's origin is put."""
FILM_DIAGONAL_MM = float(np.hypot(36, 24))
POSITION_SIGMA_M = 0.02
"""Standard deviation of the stated positions along each axis."""


def write_photos(scene: Path, folder: Path, noise_m: float = POSITION_SIGMA_M, seed: int = 0) -> Path:
    """Writes the photos of a synthetic scene folder into `folder`, which returns.

    noise_m: standard deviation of the stated positions along each axis, in metres.  seed: decides that noise.
    """
    exact = read_listing(scene)
    folder.mkdir(parents=True, exist_ok=True)
    centres = np.stack([shot.T_world_camera[:3, 3] for shot in exact.shots])
    off = noise_m * np.random.default_rng(seed).standard_normal(centres.shape)
    rows = [PLACE.crs]
    for shot, (x, y, z) in zip(exact.shots, PLACE.to_crs(centres + off), strict=True):
        lens, name = shot.intrinsics, shot.path.name
        with Image.open(shot.path) as image:
            exif = image.getexif()
            equivalent = round(FILM_DIAGONAL_MM * lens.fl_x / np.hypot(lens.width, lens.height))
            exif.get_ifd(ExifTags.IFD.Exif)[ExifTags.Base.FocalLengthIn35mmFilm] = equivalent
            image.save(folder / name, exif=exif, quality="keep")
        rows.append(f"{name} {x:.10f} {y:.10f} {z:.4f} 0 0 0 {noise_m} {noise_m}")
    write_text(folder / "geo.txt", "\n".join(rows) + "\n")
    return folder
