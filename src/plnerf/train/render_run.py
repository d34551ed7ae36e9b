"""Pictures and videos of a trained run: its held-out views, its training views, or a flight along them.

Writes into the run folder, for views V ("test", "train" or "path") and kinds K:
    renders/V/K/0000.png, ...      pictures                      renders/V-K.mp4    the same as a video
    renders/V/depth_16bit/*.png, depth_npy/*.npy                 raw depth, of test and train views
    renders/V/render.json          what, units, cameras
Those of an earlier call stay until all are there.
"""

import json
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any, Literal, get_args

import numpy as np
from torch import Tensor

from plnerf.errors import ConfigError
from plnerf.field.poses import rotation_matrix
from plnerf.render.paths import JUMP, TURN_DEG, fly_along, in_time_order
from plnerf.render.picture_files import write_npy, write_png, write_text
from plnerf.render.pictures import (
    DepthRange,
    accumulation_picture,
    depth_16bit,
    depth_16bit_meaning,
    depth_picture,
    depth_range,
    inferno,
    normals_picture,
    rgb_picture,
    uncertainty_picture,
    with_legend,
    world_depth,
    world_deviation,
)
from plnerf.render.pruning import Pruning, pruning_pays
from plnerf.render.system import RadianceSystem
from plnerf.render.views import RenderedView, render_view, resized
from plnerf.render.write_video import require_ffmpeg, write_video
from plnerf.scene.build_store import Progress
from plnerf.scene.cameras import Cameras
from plnerf.scene.transforms import Frames
from plnerf.scene.whole_result import whole_result
from plnerf.train.evaluate import mean_appearance
from plnerf.train.run import TrainedRun

Views = Literal["test", "train", "path"]
Output = Literal["rgb", "depth", "normals", "uncertainty", "accumulation"]

Ranges = dict[Output, DepthRange]
"""By kind of picture that shows lengths, the lengths at both ends of its colours."""

FLIGHT = Pruning()
"""What the frames of a path leave out on a CPU, where it is measured to pay; views of images are exact."""

_PREVIEWS, _PREVIEW_PX = 8, 96  # small views rendered first, so that all depth pictures share one scale


@dataclass(frozen=True)
class Shot:
    """One view to render."""

    camera: Cameras
    appearance: Tensor
    name: str | None
    """The image that was taken from here, if any."""


def render_run(
    run: TrainedRun,
    *,
    views: Views,
    outputs: tuple[Output, ...],
    frames: int = 96,
    fps: float = 24.0,
    scale: float = 1.0,
    video: bool = True,
    progress: Progress | None = None,
) -> Path:
    """Renders views of a run and returns their folder.

    frames: of the path; images have one view each.  scale: of the pictures, 1 = the training resolution.
    Raises ConfigError for options that cannot be, PlnerfError at a full disk or without ffmpeg.
    """
    _check(run.model, views, outputs, fps)
    if video:
        require_ffmpeg()
    shots = shots_of(run, views, frames, scale)
    pruning = FLIGHT if views == "path" and pruning_pays(run.model) else None
    shown = _shared_ranges(run.model, shots, run.record.frames, outputs, pruning)
    content = _description(run, shots, views, outputs, fps if video else None, scale, shown)
    content["pruning"] = asdict(pruning) if pruning is not None else None
    with whole_result(run.folder / "renders", _files_of(views, outputs)) as new:
        pictures = _write_pictures(run, shots, views, outputs, new / views, shown, pruning, progress)
        if video:
            for kind, paths in pictures.items():
                write_video(new / f"{views}-{kind}.mp4", paths, fps)
        write_text(new / views / "render.json", json.dumps(content, indent=1, allow_nan=False) + "\n")
    return run.folder / "renders" / views


def _write_pictures(
    run: TrainedRun,
    shots: list[Shot],
    views: Views,
    outputs: tuple[Output, ...],
    folder: Path,
    shown: Ranges,
    pruning: Pruning | None,
    progress: Progress | None,
) -> dict[Output, list[Path]]:
    """Renders and writes one picture of each kind for every shot; returns their paths."""
    frames = run.record.frames
    pictures: dict[Output, list[Path]] = {kind: [] for kind in outputs}
    for i, shot in enumerate(shots):
        view = render_view(
            run.model, shot.camera, shot.appearance, normals="normals" in outputs,
            deviation="uncertainty" in outputs, pruning=pruning,
        )  # fmt: skip
        for kind in outputs:
            pictures[kind].append(folder / kind / f"{i:04d}.png")
            write_png(pictures[kind][-1], _picture(kind, view, frames, shown))
        if "depth" in outputs and views != "path":
            depth = world_depth(view, frames)
            meaning = depth_16bit_meaning(frames)
            write_png(folder / "depth_16bit" / f"{i:04d}.png", depth_16bit(depth, frames), meaning)
            write_npy(folder / "depth_npy" / f"{i:04d}.npy", depth)
        if progress is not None:
            progress(i + 1, len(shots))
    return pictures


def evenly(images: Sequence[int], count: int) -> list[int]:
    """At most `count` of the images, evenly over their order, first and last among them."""
    if len(images) <= count:
        return list(images)
    return [images[k] for k in np.linspace(0, len(images) - 1, count).round().astype(int)]


def shots_of(run: TrainedRun, views: Views, frames: int, scale: float) -> list[Shot]:
    """The views to render; training views have their own appearance and refined pose."""
    scene = run.record
    mean = mean_appearance(run)
    refined = refined_cameras(run.model, scene.cameras)
    if views == "path":
        cameras = resized(fly_along(refined[in_time_order(scene.names, scene.train)], frames), scale)
        return [Shot(cameras[[i]], mean, None) for i in range(frames)]
    chosen = in_time_order(scene.names, scene.test if views == "test" else scene.train)
    cameras = resized(scene.cameras if views == "test" else refined, scale)
    vectors = run.model.appearance.detach()
    return [Shot(cameras[[i]], mean if views == "test" else vectors[i], scene.names[i]) for i in chosen]


def refined_cameras(model: RadianceSystem, cameras: Cameras) -> Cameras:
    """Cameras with the pose corrections that training found; the same ones where it sought none."""
    correction = model.poses.correction.detach().cpu()
    return Cameras(
        R_scene_camera=rotation_matrix(correction[:, :3]) @ cameras.R_scene_camera,
        centre=cameras.centre + correction[:, 3:],
        focal_px=cameras.focal_px,
        principal_px=cameras.principal_px,
        distortion=cameras.distortion,
        size_px=cameras.size_px,
    )


def _check(model: RadianceSystem, views: str, outputs: tuple[str, ...], fps: float) -> None:
    known_views, known = get_args(Views), get_args(Output)
    if views not in known_views:
        raise ConfigError(f"Views to render are {', '.join(known_views)}, but got {views!r}.")
    unknown = [kind for kind in outputs if kind not in known]
    if unknown or not outputs:
        raise ConfigError(
            f"Outputs to render are {', '.join(known)} (one or several), but got "
            f"{', '.join(map(repr, unknown)) or 'none'}."
        )
    if "normals" in outputs and not model.predicts_normals:
        raise ConfigError(
            "This run's model predicts no normals: it was trained with model.field.normals=false. Leave "
            "normals out of the outputs, or train with normals."
        )
    if not 0 < fps < float("inf"):
        raise ConfigError(f"A video needs a positive number of frames per second, but got {fps}.")


def _picture(kind: Output, view: RenderedView, frames: Frames, shown: Ranges) -> np.ndarray:
    if kind == "rgb":
        return rgb_picture(view.rgb)
    if kind == "accumulation":
        return accumulation_picture(view.accumulation)
    if kind == "normals":
        return normals_picture(view)
    if kind == "uncertainty":
        picture = uncertainty_picture(world_deviation(view, frames), shown[kind])
        return with_legend(picture, shown[kind], inferno)
    return with_legend(depth_picture(world_depth(view, frames), shown[kind]), shown[kind])


def _shared_ranges(
    model: RadianceSystem,
    shots: list[Shot],
    frames: Frames,
    outputs: tuple[Output, ...],
    pruning: Pruning | None,
) -> Ranges:
    """One range for all pictures of lengths of a kind, found on a few small views: a video's colours must not
    flicker."""
    lengths: dict[Output, list[np.ndarray]] = {
        kind: [] for kind in outputs if kind in {"depth", "uncertainty"}
    }
    if not lengths:
        return {}
    for i in np.unique(np.linspace(0, len(shots) - 1, _PREVIEWS).astype(int)):
        small = min(1.0, _PREVIEW_PX / float(shots[i].camera.size_px.max()))
        camera = resized(shots[i].camera, small)
        view = render_view(
            model, camera, shots[i].appearance, normals=False, deviation="uncertainty" in lengths,
            pruning=pruning,
        )  # fmt: skip
        for kind, found in lengths.items():
            found.append(world_depth(view, frames) if kind == "depth" else world_deviation(view, frames))
    return {kind: depth_range(found, frames) for kind, found in lengths.items()}


def _files_of(views: Views, outputs: tuple[Output, ...]) -> list[str]:
    """What a call may write, as patterns below renders/: an earlier one may have had more frames."""
    kinds = (*outputs, *(("depth_16bit", "depth_npy") if "depth" in outputs else ()))
    numbered = [f"{views}/{kind}/[0-9]*.{suffix}" for kind in kinds for suffix in ("png", "npy")]
    return [*numbered, f"{views}/render.json", *(f"{views}-{kind}.mp4" for kind in outputs)]


def _description(
    run: TrainedRun,
    shots: list[Shot],
    views: Views,
    outputs: tuple[Output, ...],
    fps: float | None,
    scale: float,
    shown: Ranges,
) -> dict[str, Any]:
    """What render.json says."""
    frames = run.record.frames
    refined = views != "test" and run.config.train.pose_refinement
    content: dict[str, Any] = {
        "format_version": 1,
        "views": views,
        "outputs": list(outputs),
        "frames": len(shots),
        "fps": fps,
        "scale": scale,
        "step": run.step,
        "training_seconds": run.seconds,
        "rgb": "8-bit sRGB; appearance vector: "
        + ("each image's own" if views == "train" else "mean of the training images' vectors"),
        "poses": "as refined in training" if refined else "the scene's",
        "normals": "(n + 1)/2 of the run's scene frame (z up), black where there is no surface",
        "accumulation": "8-bit grey, 255 = every ray ends",
    }
    if (depth := shown.get("depth")) is not None:
        content["depth"] = {
            "picture": "viridis, even in the logarithm of the depth along the camera's axis, near is bright; "
            "dark grey: no surface",
            "near": depth.near,
            "far": depth.far,
            "unit": "m" if frames.unit == "m" else "unscaled",
        }
        if views != "path":
            content["depth"]["depth_16bit"] = depth_16bit_meaning(frames)
            content["depth"]["depth_npy"] = "float32, the same depth in the same unit, 0 = no surface"
    if (deviation := shown.get("uncertainty")) is not None:
        content["uncertainty"] = {
            "picture": "inferno, even in the logarithm of the standard deviation of the distance at which a "
            "ray ends, large is bright; dark grey: no surface",
            "least": deviation.near,
            "greatest": deviation.far,
            "unit": "m" if frames.unit == "m" else "unscaled",
        }
    if views == "path":
        content["path"] = (
            "splines along the longest pass of the training cameras in the order of their names; a pass ends "
            f"at a step of more than {JUMP:g} median steps or a turn of more than {TURN_DEG:g} degrees"
        )
    content["cameras"] = {
        "axes": "OpenCV's (x right, y down, z forward); camera to world; pinhole in pixels of the pictures",
        "views": [_camera(shot, frames) for shot in shots],
    }
    return content


def _camera(shot: Shot, frames: Frames) -> dict[str, Any]:
    camera = shot.camera
    T_world_camera = frames.pose_to_world(
        camera.R_scene_camera[0].double().numpy(), camera.centre[0].double().numpy()
    )
    return {
        "name": shot.name,
        "size_px": camera.size_px[0].tolist(),
        "focal_px": camera.focal_px[0].tolist(),
        "principal_px": camera.principal_px[0].tolist(),
        "distortion_k1_k2_p1_p2_k3": camera.distortion[0].tolist(),
        "T_world_camera": T_world_camera.tolist(),
    }
