"""The commands that make scenes: from photos or a video, and synthetic ones; and all stages in one."""

from functools import partial
from pathlib import Path
from typing import Any, Literal

import tyro
from rich.console import Console

from plnerf.cli.options import Out, PresetName
from plnerf.terminal import Terminal


def capture(  # noqa: PLR0913 (an argument is an option)
    source: tyro.conf.Positional[Path],
    *,
    out: Out,
    camera_model: Literal["SIMPLE_PINHOLE", "PINHOLE", "SIMPLE_RADIAL", "RADIAL", "OPENCV"] = "OPENCV",
    intrinsics: Literal["shared", "per-image"] = "shared",
    fit_lens: bool = True,
    image_px: int = 1600,
    features: int = 4096,
    overlap: float = 0.75,
    masks: Path | None = None,
    height_datum: str | None = None,
    check_every: int = 0,
    seed: int = 0,
) -> None:
    """Make a scene of photos or a video: poses by COLMAP, place by GPS; resumes where it was cut off.

    Args:
        source: Folder of photos (EXIF and DJI positions are read, or a geo.txt in it), or a video file.
        out: Scene folder to write.
        camera_model: Lens model of COLMAP that is fitted.
        intrinsics: Whether images of one camera share their lens.
        fit_lens: Whether the lens is fitted; with --no-fit-lens the focal length that EXIF states is kept,
            without distortion: for photos that were undistorted, of a camera that is known well.
        image_px: Longer side, in pixels, of the images in which features are detected.
        features: Largest number of features of an image.
        overlap: Video only: minimum overlap of consecutive selected frames.
        masks: Folder of masks (IMAGE.png, black where an image is ignored), or one for all images.
        height_datum: Vertical reference of heights whose file states none: ellipsoid, or a vertical datum
            such as EPSG:7837.
        check_every: Every n-th control point of gcp_list.txt without a stated role becomes a check point,
            which is not fitted; 0: none.
        seed: Decides the random draws of structure from motion.
    """
    from plnerf.capture.capture import CaptureConfig
    from plnerf.capture.sfm import SfmConfig

    sfm = SfmConfig(camera_model, intrinsics, fit_lens, image_px, features, seed=seed)
    config = CaptureConfig(
        sfm, least=overlap, masks=masks, height_datum=height_datum, check_every=check_every
    )
    capture_shown(Terminal(), source, out, config)


def capture_shown(console: Console, source: Path, out: Path, config: Any) -> Path:
    """`capture_scene` with a bar for each stage, and a summary."""
    from plnerf.capture.summary import read_report, summary
    from plnerf.console import bars, say
    from plnerf.pipeline import capture_scene

    with bars(console) as progress:
        scene = capture_scene(source, out, config, progress)
    say(console, summary(read_report(out)))
    say(console, f"scene: {out}")
    return scene


def reconstruct(
    source: tyro.conf.Positional[Path],
    *,
    out: Out,
    preset: PresetName = "pl-nerf-wire",
    seconds: float = 300.0,
    downscale: int = 1,
    seed: int = 0,
) -> None:
    """Photos or a video in; a first report, a field, a refined report and pictures out.

    Reports: OUT/survey (images alone), OUT/run/survey (with the field). Skips what is up to date.

    Args:
        source: Folder of photos, a video file, or a scene with poses.
        out: Folder for everything that is made.
        preset: Named settings to train with.
        seconds: Budget in seconds of training.
        downscale: Integer factor by which images are made smaller for training.
        seed: Decides every random draw.
    """
    from plnerf.capture.capture import CaptureConfig
    from plnerf.capture.sfm import SfmConfig
    from plnerf.cli.survey import survey_shown
    from plnerf.cli.train import eval_shown, render_shown, resume_shown, train_shown
    from plnerf.console import say
    from plnerf.doctor.cost import in_words
    from plnerf.reconstruct import Listener, Stages, Training
    from plnerf.reconstruct import reconstruct as run_stages

    console = Terminal()

    def begins(stage: str, seconds: float | None) -> None:
        about = "" if seconds is None else f" (about {in_words(seconds)}, an estimate)"
        say(console, f"{stage}{about}")

    def surveyed(source: Path, out: Path, finder: Any, config: Any) -> None:
        survey_shown(console, source, out, config, finder=finder)

    stages = Stages(
        partial(capture_shown, console),
        partial(train_shown, console),
        partial(resume_shown, console),
        partial(eval_shown, console),
        partial(render_shown, console),
        surveyed,
    )
    training, listener = Training(preset, seconds, downscale, seed), Listener(partial(say, console), begins)
    run_stages(source, out, training, CaptureConfig(SfmConfig(seed=seed)), stages, listener)
    say(console, f"reconstruction: {out}")


def synth(  # noqa: PLR0913 (an argument is an option)
    out: tyro.conf.Positional[Path],
    *,
    scene: str = "span",
    seed: int | None = None,
    samples: int | None = None,
    width: int | None = None,
    height: int | None = None,
    views: int | None = None,
    motion_blur: float | None = None,
    noise: float | None = None,
    jpeg_quality: int | None = None,
    auto_exposure: bool | None = None,
    exposure_drift: float | None = None,
    white_balance_drift: float | None = None,
    pose_noise_m: float | None = None,
    pose_noise_deg: float | None = None,
    photos: bool = False,
) -> None:
    """Render a synthetic power line with its exact truth (needs the extra plnerf[synth]).

    Args:
        out: Scene folder to write; must not exist.
        scene: Which scene, whose own values stand for what is left out: span, double-circuit, bundle,
            distribution, hills, forest, far, parallel, parallel-two-passes, same-way, both-ends, exposure,
            noisy-poses, three-spans, crossing, orbit, grid, wind, long, random (whose seed draws everything),
            random-span (likewise, filmed from structure to structure).
        seed: Decides terrain, vegetation, the flight and all noise (span: 7).
        samples: Samples per pixel of the path tracer (span: 64).
        width: Image width in pixels, with the same field of view (span: 480).
        height: Image height in pixels (span: 320).
        views: Images in each pass of the flight (span: 24).
        motion_blur: Longest smear of a wire while the shutter is open, in pixels (span: 0).
        noise: Standard deviation of the sensor's noise at mid grey, as a part of white (span: 0).
        jpeg_quality: Quality of the images, 1 to 100 (span: 95).
        auto_exposure: Whether the camera's automatic sets the exposure of every image (span: no).
        exposure_drift: Slow drift of the exposure, standard deviation in stops (span: 0).
        white_balance_drift: Slow drift of red against blue, relative standard deviation (span: 0).
        pose_noise_m: Standard deviation of the written camera centres along each axis, metres (span: 0).
        pose_noise_deg: Standard deviation of the written directions about each axis, degrees (span: 0).
        photos: Also write OUT/photos for plnerf capture: the images without poses, the focal length in
            EXIF, and geo.txt with positions that are off by 2 cm on each axis (standard deviation).
    """
    from plnerf.console import bar, say
    from plnerf.pipeline import synthesize_scene
    from plnerf.synth.scene_options import SceneOptions
    from plnerf.synth.synthesize import summary

    options = SceneOptions(
        seed=seed, samples=samples, width=width, height=height, views=views, motion_blur=motion_blur,
        noise=noise, jpeg_quality=jpeg_quality, auto_exposure=auto_exposure, exposure_drift=exposure_drift,
        white_balance_drift=white_balance_drift, pose_noise_m=pose_noise_m, pose_noise_deg=pose_noise_deg,
    )  # fmt: skip
    console = Terminal()
    with bar(console, "synth") as progress:
        folder = synthesize_scene(out, scene, options, progress, photos)
    say(console, f"scene folder: {folder} ({summary(folder)})")
    if photos:
        say(console, f"photos without poses: {folder / 'photos'}")
