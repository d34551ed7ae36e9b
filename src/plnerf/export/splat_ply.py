"""Gaussians as the PLY of 3D Gaussian Splatting, and as the `.splat` of web viewers.

The PLY holds what the reference implementation of Kerbl et al. (2023) writes: positions, unused normals,
`f_dc` and `f_rest` (the harmonics from degree 1 on, all of red before green and blue), the logit of the
opacity, logarithms of the scales, and the quaternion w, x, y, z; little-endian float32.  A `.splat` holds 32
bytes a Gaussian and one colour: float32 position and scale, 8-bit red, green, blue, opacity, and quaternion.
"""

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from plnerf.export.splat_sh import Y_0
from plnerf.export.splats import Splats
from plnerf.scene.files import complete_file

_CLEAR = 1e-6
"""Opacities are kept from 0 and 1, whose logits are infinite."""


def write_splat_ply(path: Path, splats: Splats, comments: Sequence[str] = ()) -> None:
    """Writes the PLY, complete or not at all; positions as they are, rounded to float32.

    comments: lines of its header, in ASCII.
    """
    rest = splats.sh[:, 1:].transpose(0, 2, 1).reshape(len(splats), -1)
    opacity = np.clip(splats.opacity.astype(np.float64), _CLEAR, 1 - _CLEAR)
    columns = {
        **dict(zip("xyz", splats.xyz.T, strict=True)),
        **dict.fromkeys(("nx", "ny", "nz"), np.zeros(len(splats))),
        **{f"f_dc_{k}": splats.sh[:, 0, k] for k in range(3)},
        **{f"f_rest_{k}": rest[:, k] for k in range(rest.shape[1])},
        "opacity": np.log(opacity / (1 - opacity)),
        **{f"scale_{k}": np.log(splats.scale[:, k]) for k in range(3)},
        **{f"rot_{k}": splats.rotation[:, k] for k in range(4)},
    }
    table = np.empty(len(splats), np.dtype([(name, "<f4") for name in columns]))
    for name, column in columns.items():
        table[name] = column
    header = [
        "ply", "format binary_little_endian 1.0", *(f"comment {' '.join(line.split())}" for line in comments),
        f"element vertex {len(splats)}", *(f"property float {name}" for name in columns), "end_header",
    ]  # fmt: skip
    with complete_file(path) as beside, beside.open("wb") as file:
        file.write(("\n".join(header) + "\n").encode("ascii", "replace"))
        table.tofile(file)


def write_splat(path: Path, splats: Splats) -> None:
    """Writes the `.splat`, complete or not at all: the largest and most opaque Gaussians first."""
    order = np.argsort(-splats.scale.prod(1, dtype=np.float64) * splats.opacity)
    row = np.dtype([("xyz", "<f4", 3), ("scale", "<f4", 3), ("rgba", "u1", 4), ("rotation", "u1", 4)])
    table = np.empty(len(splats), row)
    table["xyz"], table["scale"] = splats.xyz[order], splats.scale[order]
    rgb = splats.sh[order, 0] * Y_0 + 0.5
    rgba = np.concatenate([rgb, splats.opacity[order, None]], 1)
    table["rgba"] = np.round(np.clip(rgba, 0, 1) * 255)
    table["rotation"] = np.clip(np.round(splats.rotation[order] * 128 + 128), 0, 255)
    with complete_file(path) as beside:
        table.tofile(beside)
