"""Finds out what a folder is and reads it: transforms.json first, then a COLMAP model."""

from pathlib import Path

from plnerf.errors import SceneError
from plnerf.scene.formats_colmap import find_model, read_colmap
from plnerf.scene.formats_transforms import read_transforms
from plnerf.scene.listing import Listing


def has_poses(source: Path) -> bool:
    """Whether something is a scene: a transforms.json or a COLMAP model, be it usable or not."""
    if source.is_dir():
        return (source / "transforms.json").is_file() or find_model(source) is not None
    return source.suffix == ".json"


def read_listing(source: Path) -> Listing:
    """The images, poses and intrinsics of a scene folder, a COLMAP folder, or a transforms.json given itself.

    A scene folder that holds both is read from transforms.json, which alone has plnerf's keys.  Raises
    SceneError when nothing known is there, or what is there cannot be used.
    """
    if source.is_file() and source.suffix == ".json":
        return read_transforms(source)
    if not source.is_dir():
        raise SceneError(
            f"{source} is not {'a folder or a .json file' if source.exists() else 'there'}. Give a folder "
            "with transforms.json, or with a COLMAP model in sparse/0 and photos in images/."
        )
    if (source / "transforms.json").is_file():
        return read_transforms(source / "transforms.json")
    if find_model(source) is not None:
        return read_colmap(source)
    raise SceneError(
        f"The folder {source} holds neither transforms.json (nerfstudio, instant-ngp) nor a COLMAP model "
        "(cameras.bin or cameras.txt, in it or in sparse/0). Photos without poses need a pose estimation "
        "first."
    )
