"""Gaussians as a binary glTF (GLB) with the extension KHR_gaussian_splatting, uncompressed.

One mesh primitive of points; attributes as the extension names them: linear scales, opacities in [0, 1],
quaternions x, y, z, w, harmonics by degree and order, and COLOR_0 for programs that do not know the extension
and draw points.  glTF's y axis is up: what is written must be in such axes.
"""

import json
import struct
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from plnerf.export.splat_sh import Y_0
from plnerf.export.splats import Splats
from plnerf.scene.files import complete_file

EXTENSION = "KHR_gaussian_splatting"
_POINTS, _ARRAY_BUFFER = 0, 34962
_COMPONENTS = {"f4": 5126, "u1": 5121}
_TYPES = {1: "SCALAR", 3: "VEC3", 4: "VEC4"}
_JSON, _BIN = 0x4E4F534A, 0x004E4942


def write_splat_glb(path: Path, splats: Splats, name: str, extras: Mapping[str, Any]) -> None:
    """Writes the GLB, complete or not at all.

    splats: in y-up axes.  name: of the node.  extras: plain JSON values about the Gaussians, in the mesh.
    """
    columns = _attributes(splats)
    views, offset = list[dict[str, Any]](), 0
    accessors = list[dict[str, Any]]()
    for key, column in columns.items():
        size = column.nbytes
        views.append({"buffer": 0, "byteOffset": offset, "byteLength": size, "target": _ARRAY_BUFFER})
        width = 1 if column.ndim == 1 else column.shape[1]
        accessors.append({
            "bufferView": len(accessors), "componentType": _COMPONENTS[column.dtype.str[1:]],
            "count": len(column), "type": _TYPES[width],
            **({"normalized": True} if column.dtype.kind == "u" else {}),
            **({"min": column.min(0).tolist(), "max": column.max(0).tolist()} if key == "POSITION" else {}),
        })  # fmt: skip
        offset += size
    primitive = {
        "attributes": {key: number for number, key in enumerate(columns)}, "mode": _POINTS,
        "extensions": {EXTENSION: {
            "kernel": "ellipse", "colorSpace": "srgb_rec709_display",
            "projection": "perspective", "sortingMethod": "cameraDistance",
        }},
    }  # fmt: skip
    content = {
        "asset": {"version": "2.0", "generator": "plnerf"},
        "extensionsUsed": [EXTENSION],
        "scene": 0,
        "scenes": [{"nodes": [0]}],
        "nodes": [{"name": name, "mesh": 0}],
        "meshes": [{"name": name, "primitives": [primitive], "extras": dict(extras)}],
        "accessors": accessors,
        "bufferViews": views,
        "buffers": [{"byteLength": offset}],
    }
    text = json.dumps(content, separators=(",", ":"), allow_nan=False).encode()
    text += b" " * (-len(text) % 4)
    with complete_file(path) as beside, beside.open("wb") as file:
        file.write(struct.pack("<4sII", b"glTF", 2, 12 + 8 + len(text) + 8 + offset))
        file.write(struct.pack("<II", len(text), _JSON) + text)
        file.write(struct.pack("<II", offset, _BIN))
        for column in columns.values():
            column.tofile(file)


def _attributes(splats: Splats) -> dict[str, np.ndarray]:
    """Little-endian arrays by attribute; each takes a multiple of four bytes a row."""
    rotation = splats.rotation[:, [1, 2, 3, 0]].astype(np.float64)
    rotation /= np.linalg.norm(rotation, axis=1, keepdims=True)
    columns = {
        "POSITION": splats.xyz,
        f"{EXTENSION}:ROTATION": rotation,
        f"{EXTENSION}:SCALE": splats.scale,
        f"{EXTENSION}:OPACITY": np.clip(splats.opacity, 0, 1),
    }
    for degree in range(splats.degree + 1):
        for k in range(2 * degree + 1):
            columns[f"{EXTENSION}:SH_DEGREE_{degree}_COEF_{k}"] = splats.sh[:, degree**2 + k]
    found = {key: np.ascontiguousarray(column, "<f4") for key, column in columns.items()}
    return found | {"COLOR_0": _fallback(splats)}


def _fallback(splats: Splats) -> np.ndarray:
    """Red, green, blue and opacity in 8 bits; glTF's vertex colours are linear."""
    encoded = np.clip(splats.sh[:, 0].astype(np.float64) * Y_0 + 0.5, 0, 1)
    linear = np.where(encoded <= 0.04045, encoded / 12.92, ((encoded + 0.055) / 1.055) ** 2.4)
    rgba = np.concatenate([linear, splats.opacity[:, None]], 1)
    return np.round(np.clip(rgba, 0, 1) * 255).astype("u1")
