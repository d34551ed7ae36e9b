"""A scene ready to train on: cameras in the scene frame, pixels, frames, and which images are held out."""

import atexit
import shutil
import tempfile
import warnings
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import torch
from jaxtyping import Float, Int
from torch import Tensor

from plnerf.errors import SceneError
from plnerf.scene.build_store import Progress, open_store, reduced_sizes_px
from plnerf.scene.cameras import Cameras
from plnerf.scene.formats import read_listing
from plnerf.scene.images import ImageStore
from plnerf.scene.listing import Listing, some
from plnerf.scene.orientation import cameras_box, frames_for
from plnerf.scene.photos import PhotoFiles, Pictures
from plnerf.scene.transforms import Frames

HOLD_OUT_EVERY = 8


@dataclass(frozen=True, eq=False)
class Scene:
    """One capture; all per-image tuples and keys follow the sorted image names."""

    root: Path
    names: tuple[str, ...]
    """Image paths below ``root``, with slashes, sorted."""
    cameras: Cameras
    """Scene frame, intrinsics at the training resolution."""
    frames: Frames
    box: Float[np.ndarray, "2 3"]
    """Lowest and highest corner of what the capture is about, scene frame."""
    images: ImageStore
    photos: Pictures
    """The images at their full size."""
    photo_sizes_px: Int[np.ndarray, "n 2"]
    """Width and height of the photos."""
    train: tuple[int, ...]
    test: tuple[int, ...]
    """Held-out images: never trained on."""
    wire_masks: Mapping[int, Path]
    """Full-size uint8 images, 255 = wire."""
    depths: Mapping[int, Path]
    """Full-size uint16 images, millimetres along the camera's z axis, 0 = no surface."""
    truth: Path | None
    """Exact geometry, of synthetic scenes only."""
    format: str
    """"nerfstudio", "instant-ngp" or "colmap"."""
    left_out: tuple[str, ...]
    """Images that the source lists and that are not used (no file, or no pose)."""
    stated_centre: Float[Tensor, "n 3"] | None = None
    """Camera centres as the source states them, scene frame; None: `cameras` has them."""

    @property
    def photo_cameras(self) -> Cameras:
        """The cameras with the intrinsics of the photos at their full size."""
        return self.cameras.at_size(torch.from_numpy(self.photo_sizes_px))

    def in_frames(self, frames: Frames, box: Float[np.ndarray, "2 3"]) -> "Scene":
        """The same capture in other frames of the same world, with this box; pixels and masks stay.

        Frames and box that are its own already change nothing, to the last bit.
        """
        if frames.to_json() == self.frames.to_json():
            return replace(self, box=box)
        scale, R, shift = (np.asarray(value) for value in frames.from_frames(self.frames))

        def moved(x: Float[Tensor, "n 3"]) -> Float[Tensor, "n 3"]:
            return torch.from_numpy(scale * x.double().numpy() @ R.T + shift).float()

        axes = torch.from_numpy(R @ self.cameras.R_scene_camera.double().numpy()).float()
        cameras = replace(self.cameras, R_scene_camera=axes, centre=moved(self.cameras.centre))
        stated = None if self.stated_centre is None else moved(self.stated_centre)
        return replace(self, frames=frames, box=box, cameras=cameras, stated_centre=stated)

    def with_poses(self, R_scene_camera: Float[Tensor, "n 3 3"], centre: Float[Tensor, "n 3"]) -> "Scene":
        """The same capture with other poses in the same frame; those that the source states stay known."""
        stated = self.cameras.centre if self.stated_centre is None else self.stated_centre
        cameras = replace(self.cameras, R_scene_camera=R_scene_camera, centre=centre)
        return replace(self, cameras=cameras, stated_centre=stated)


def load_scene(
    source: Path | str,
    *,
    store: Path | None = None,
    downscale: int = 1,
    progress: Progress | None = None,
) -> Scene:
    """Reads a scene folder, a COLMAP folder or a transforms.json.

    store: folder for the reduced pixels, built on the first call and reused after; None: a temporary folder,
    removed when the process ends.  downscale: integer factor by which width and height shrink.  Raises
    SceneError for whatever cannot be used; warns when images are left out.
    """
    source = Path(source)
    listing = read_listing(source)
    store = store or _temporary_folder()
    sizes = reduced_sizes_px(listing.shots, 1)
    if listing.left_out:
        warnings.warn(
            f"Left out, having no file or no pose: {len(listing.left_out)} of the "
            f"{len(listing.left_out) + len(listing.shots)} images that {source} lists "
            f"({some(listing.left_out)}).",
            stacklevel=2,
        )
    train, test = split(listing)
    T_world_camera = np.stack([shot.T_world_camera for shot in listing.shots])
    frames = frames_for(
        T_world_camera,
        up=listing.up,
        unit=listing.unit,
        crs=listing.crs,
        origin=listing.origin,
    )
    images = open_store(listing.shots, listing.root, store, downscale=downscale, progress=progress)
    return Scene(
        root=listing.root,
        names=tuple(shot.name for shot in listing.shots),
        cameras=scene_cameras(listing, frames, downscale),
        frames=frames,
        box=cameras_box(frames.to_scene(T_world_camera[:, :3, 3])),
        images=images,
        photos=images if downscale == 1 else PhotoFiles(listing.shots),
        photo_sizes_px=sizes,
        train=train,
        test=test,
        wire_masks={i: shot.wire_mask for i, shot in enumerate(listing.shots) if shot.wire_mask is not None},
        depths={i: shot.depth for i, shot in enumerate(listing.shots) if shot.depth is not None},
        truth=listing.truth,
        format=listing.format,
        left_out=listing.left_out,
    )


def scene_cameras(listing: Listing, frames: Frames, downscale: int) -> Cameras:
    """The listing's cameras in the scene frame; intrinsics scaled per axis by the true ratio of the sizes."""
    T_world_camera = np.stack([shot.T_world_camera for shot in listing.shots])
    lenses = [shot.intrinsics for shot in listing.shots]
    sizes = reduced_sizes_px(listing.shots, downscale)
    ratio = sizes / np.array([[lens.width, lens.height] for lens in lenses])
    focal = np.array([[lens.fl_x, lens.fl_y] for lens in lenses]) * ratio
    principal = np.array([[lens.cx, lens.cy] for lens in lenses]) * ratio
    R_scene_camera, centre = frames.pose_to_scene(T_world_camera)
    return Cameras(
        R_scene_camera=torch.from_numpy(R_scene_camera).float(),
        centre=torch.from_numpy(centre).float(),
        focal_px=torch.from_numpy(focal).float(),
        principal_px=torch.from_numpy(principal).float(),
        distortion=torch.tensor([lens.distortion for lens in lenses], dtype=torch.float32),
        size_px=torch.from_numpy(sizes),
    )


def split(listing: Listing) -> tuple[tuple[int, ...], tuple[int, ...]]:
    """Indices of training and held-out images: the file's lists, else every eighth by name is held out."""
    position = {shot.name: i for i, shot in enumerate(listing.shots)}
    everything = range(len(listing.shots))
    train, test = listing.train, listing.test
    if train is None and test is None:
        held = set(everything[::HOLD_OUT_EVERY])
        chosen = set(everything) - held
    else:
        held = {position[name] for name in test} if test is not None else set()
        chosen = {position[name] for name in train} if train is not None else set(everything) - held
        held = held if test is not None else set(everything) - chosen
    both = sorted(held & chosen)
    if both:
        raise SceneError(
            f"The lists of the scene in {listing.root} want to train on images that they also hold out "
            f"({some(listing.shots[i].name for i in both)}), so that the evaluation would be of no worth. "
            "Take each image out of one of the two lists."
        )
    if not chosen or not held:
        raise SceneError(
            f"Of the {len(listing.shots)} images in {listing.root}, {len(chosen)} are for training and "
            f"{len(held)} held out; each needs at least one. Correct the lists in the file (train_filenames, "
            "test_filenames, plnerf.test), remove them (then every eighth image is held out), or add images."
        )
    return tuple(sorted(chosen)), tuple(sorted(held))


def _temporary_folder() -> Path:
    """A new folder that is removed when the process ends."""
    folder = tempfile.mkdtemp(prefix="plnerf-")
    atexit.register(shutil.rmtree, folder, ignore_errors=True)
    return Path(folder)
