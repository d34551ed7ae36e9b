"""Files of Gaussians, read back by parsers of the tests' own, and where they lie."""

import json
import struct
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch
from scipy.spatial.transform import Rotation
from tests.support.surveys import FRAME

from plnerf.export.splat_fit import as_gaussians
from plnerf.export.splat_gltf import write_splat_glb
from plnerf.export.splat_place import Y_UP, placement
from plnerf.export.splat_ply import write_splat, write_splat_ply
from plnerf.export.splat_project import Pinhole, render
from plnerf.export.splats import Splats

COUNT = 50


def made_up(degree: int = 2) -> Splats:
    random = np.random.default_rng(0)
    rotation = Rotation.random(COUNT, random_state=0).as_quat()[:, [3, 0, 1, 2]]
    return Splats(
        xyz=random.normal(size=(COUNT, 3)),
        scale=np.exp(random.normal(size=(COUNT, 3)) * 0.5 - 2).astype(np.float32),
        rotation=rotation.astype(np.float32),
        opacity=random.uniform(0.05, 0.95, COUNT).astype(np.float32),
        sh=(random.normal(size=(COUNT, (degree + 1) ** 2, 3)) * 0.3).astype(np.float32),
        drawn=4,
    )


def read_ply(path: Path) -> tuple[list[str], dict[str, np.ndarray]]:
    """Comments and columns, with struct alone."""
    head, body = path.read_bytes().split(b"end_header\n", 1)
    lines = head.decode("ascii").splitlines()
    assert lines[:2] == ["ply", "format binary_little_endian 1.0"]
    (count,) = (int(line.split()[2]) for line in lines if line.startswith("element vertex "))
    names = [line.split()[2] for line in lines if line.startswith("property float ")]
    assert len(body) == 4 * count * len(names)
    values = np.array(struct.unpack(f"<{count * len(names)}f", body)).reshape(count, -1)
    comments = [line.removeprefix("comment ") for line in lines if line.startswith("comment ")]
    return comments, dict(zip(names, values.T, strict=True))


def read_glb(path: Path) -> tuple[dict[str, Any], dict[str, np.ndarray]]:
    """The JSON and the attributes of the first primitive; checks the container."""
    data = path.read_bytes()
    magic, version, length = struct.unpack_from("<4sII", data)
    assert (magic, version, length) == (b"glTF", 2, len(data))
    size, kind = struct.unpack_from("<II", data, 12)
    assert kind == 0x4E4F534A and size % 4 == 0
    content = json.loads(data[20 : 20 + size])
    binary, kind = struct.unpack_from("<II", data, 20 + size)
    assert kind == 0x004E4942 and 28 + size + binary == len(data)
    body = data[28 + size :]
    assert content["buffers"] == [{"byteLength": binary}]
    found = {}
    for name, number in content["meshes"][0]["primitives"][0]["attributes"].items():
        accessor = content["accessors"][number]
        piece = content["bufferViews"][accessor["bufferView"]]
        width = {"SCALAR": 1, "VEC3": 3, "VEC4": 4}[accessor["type"]]
        dtype = {5126: "<f4", 5121: "u1"}[accessor["componentType"]]
        assert piece["byteOffset"] % 4 == 0 and piece["byteLength"] == accessor["count"] * width * int(
            dtype[-1]
        )
        raw = body[piece["byteOffset"] : piece["byteOffset"] + piece["byteLength"]]
        values = np.frombuffer(raw, dtype).reshape(accessor["count"], width)
        found[name] = values / 255 if accessor.get("normalized") else values
        if name == "POSITION":
            assert accessor["min"] == values.min(0).tolist() and accessor["max"] == values.max(0).tolist()
    return content, found


@pytest.mark.parametrize("degree", [0, 1, 2])
def test_the_ply_is_that_of_3d_gaussian_splatting(degree: int, tmp_path: Path) -> None:
    splats = made_up(degree)
    write_splat_ply(tmp_path / "a.ply", splats, ["wires are\ndrawn"])
    comments, columns = read_ply(tmp_path / "a.ply")
    rest = 3 * ((degree + 1) ** 2 - 1)
    assert comments == ["wires are drawn"]
    assert list(columns) == [
        "x", "y", "z", "nx", "ny", "nz", "f_dc_0", "f_dc_1", "f_dc_2", *(f"f_rest_{k}" for k in range(rest)),
        "opacity", "scale_0", "scale_1", "scale_2", "rot_0", "rot_1", "rot_2", "rot_3",
    ]  # fmt: skip

    def stacked(*names: str) -> np.ndarray:
        return np.stack([columns[name] for name in names], 1)

    near = {"atol": 1e-6, "rtol": 1e-5}
    np.testing.assert_allclose(stacked("x", "y", "z"), splats.xyz, **near)
    np.testing.assert_allclose(1 / (1 + np.exp(-columns["opacity"])), splats.opacity, **near)
    np.testing.assert_allclose(np.exp(stacked("scale_0", "scale_1", "scale_2")), splats.scale, **near)
    np.testing.assert_allclose(stacked("rot_0", "rot_1", "rot_2", "rot_3"), splats.rotation, **near)
    np.testing.assert_allclose(stacked("f_dc_0", "f_dc_1", "f_dc_2"), splats.sh[:, 0], **near)
    for k in range(rest):  # all of red, then green, then blue
        channel, function = divmod(k, rest // 3)
        np.testing.assert_allclose(columns[f"f_rest_{k}"], splats.sh[:, 1 + function, channel], **near)


@pytest.mark.parametrize("degree", [0, 2])
def test_the_glb_holds_what_the_extension_asks_for(degree: int, tmp_path: Path) -> None:
    splats = made_up(degree)
    write_splat_glb(tmp_path / "a.glb", splats, "run", {"drawn": 4})
    content, found = read_glb(tmp_path / "a.glb")
    primitive = content["meshes"][0]["primitives"][0]
    assert primitive["mode"] == 0 and content["extensionsUsed"] == ["KHR_gaussian_splatting"]
    extension = primitive["extensions"]["KHR_gaussian_splatting"]
    assert (extension["kernel"], extension["colorSpace"]) == ("ellipse", "srgb_rec709_display")
    assert content["meshes"][0]["extras"] == {"drawn": 4}
    own = {name.removeprefix("KHR_gaussian_splatting:"): value for name, value in found.items()}
    harmonics = [f"SH_DEGREE_{n}_COEF_{k}" for n in range(degree + 1) for k in range(2 * n + 1)]
    assert set(own) == {"POSITION", "ROTATION", "SCALE", "OPACITY", "COLOR_0", *harmonics}
    near = {"atol": 1e-6, "rtol": 1e-5}
    np.testing.assert_allclose(own["POSITION"], splats.xyz, **near)
    np.testing.assert_allclose(own["ROTATION"], splats.rotation[:, [1, 2, 3, 0]], **near)
    np.testing.assert_allclose(np.linalg.norm(own["ROTATION"], axis=1), 1, atol=1e-6)
    np.testing.assert_allclose(own["SCALE"], splats.scale, **near)
    np.testing.assert_allclose(own["OPACITY"][:, 0], splats.opacity, **near)
    for k, name in enumerate(harmonics):
        np.testing.assert_allclose(own[name], splats.sh[:, k], **near)
    encoded = np.clip(0.28209479 * splats.sh[:, 0] + 0.5, 0, 1)
    shown = np.where(
        own["COLOR_0"][:, :3] <= 0.0031308, own["COLOR_0"][:, :3] * 12.92,
        1.055 * own["COLOR_0"][:, :3] ** (1 / 2.4) - 0.055,
    )  # fmt: skip
    np.testing.assert_allclose(
        shown, encoded, atol=0.03
    )  # 8 bits of linear light are coarse where it is dark


def test_a_splat_has_32_bytes_and_the_most_visible_first(tmp_path: Path) -> None:
    splats = made_up()
    write_splat(tmp_path / "a.splat", splats)
    data = (tmp_path / "a.splat").read_bytes()
    assert len(data) == 32 * COUNT
    rows = [struct.unpack_from("<6f8B", data, 32 * k) for k in range(COUNT)]
    weight = [row[3] * row[4] * row[5] * row[9] for row in rows]
    assert weight[0] == max(weight) and weight[-1] < weight[0] / 10
    nearest = int(np.argmin(np.abs(splats.xyz - rows[0][:3]).sum(1)))
    np.testing.assert_allclose(rows[0][3:6], splats.scale[nearest], rtol=1e-6)
    np.testing.assert_allclose((np.array(rows[0][10:14]) - 128) / 128, splats.rotation[nearest], atol=0.01)


def seen(splats: Splats, R: np.ndarray, centre: np.ndarray) -> torch.Tensor:
    R_local_camera, at = (torch.from_numpy(one.copy()).float() for one in (R, centre))
    eye = Pinhole(
        R_local_camera, at, torch.tensor([40.0, 40.0]), torch.tensor([20.0, 15.0]), (40, 30), 0.1
    )  # fmt: skip
    return render(as_gaussians(splats), eye)[0]


def test_moved_gaussians_look_the_same_from_a_moved_camera() -> None:
    splats, R_camera = made_up(), Rotation.from_euler("xyz", [-80, 10, 20], degrees=True).as_matrix()
    centre = -4 * R_camera[:, 2]
    before = seen(splats, R_camera, centre)
    assert before.max() > 0.3
    for R, shift in (
        (Y_UP, np.zeros(3)),
        (Rotation.random(random_state=3).as_matrix(), np.array([3.0, -2.0, 1.0])),
    ):
        after = seen(splats.moved(R, shift), R @ R_camera, R @ centre + shift)
        torch.testing.assert_close(after, before, atol=2e-4, rtol=1e-3)


def test_the_sidecar_places_local_coordinates_in_the_world_and_the_crs() -> None:
    splats = made_up()
    place = placement(FRAME, splats.xyz + np.array([5.0, 0.0, 2.0]), "run")
    local, about = place.local(splats), place.to_json()
    world = FRAME.to_world(splats.xyz)
    T, T_gltf = np.array(about["T_world_local"]), np.array(about["T_world_gltf"])
    np.testing.assert_allclose(local.xyz @ T[:3, :3].T + T[:3, 3], world, atol=1e-9)
    gltf = local.moved(Y_UP, np.zeros(3)).xyz
    np.testing.assert_allclose(gltf @ T_gltf[:3, :3].T + T_gltf[:3, 3], world, atol=1e-9)
    assert np.linalg.det(T_gltf[:3, :3]) == pytest.approx(1)
    np.testing.assert_allclose(about["origin_in_world"], np.round(about["origin_in_world"]), atol=1e-9)
    np.testing.assert_allclose(np.median(local.xyz, axis=0), [-5, 0, -2], atol=6)
    assert about["crs"] == "EPSG:25832" and about["unit"] == "m"
    east, north, height = about["origin_crs"]
    assert 4e5 < east < 5e5 and 5.5e6 < north < 5.6e6 and height == pytest.approx(212.4 + T[2, 3], abs=0.1)
    longitude, latitude = about["origin_lon_lat_height"][:2]
    assert longitude == pytest.approx(8.1234567, abs=0.01) and latitude == pytest.approx(49.7654321, abs=0.01)
