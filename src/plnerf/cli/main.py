"""The command line.  Each subcommand is one call; whatever is heavy is imported where it is used.

Exit status: 0 on success, 1 on bad input (one paragraph on standard error), 2 on wrong arguments, 3 where the
doctor finds a scene not usable for wires, or a survey no conductor, 130 on Ctrl-C.
"""

import os
import sys
import warnings
from pathlib import Path
from typing import Annotated, Literal

import tyro
from rich.console import Console

from plnerf.cli.measure import bench, compare
from plnerf.cli.options import Out, Output, PresetName
from plnerf.errors import ConfigError, PlnerfError

app = tyro.extras.SubcommandApp()


@app.command
def demo(out: Out = Path("runs/demo"), seconds: float = 240.0, quick: bool = False) -> None:
    """Train on the bundled span, evaluate it and render a fly-along; no data and no options needed.

    Args:
        out: Folder for everything that is made.
        seconds: Training time in seconds.
        quick: A short look: 20 s of training at half size and a short fly-along.
    """
    from plnerf.pipeline import run_demo

    run_demo(out, seconds=seconds, quick=quick, console=Console())


@app.command
def capture(  # noqa: PLR0913 (an argument is an option)
    source: tyro.conf.Positional[Path],
    *,
    out: Out,
    camera_model: Literal["SIMPLE_PINHOLE", "PINHOLE", "SIMPLE_RADIAL", "RADIAL", "OPENCV"] = "OPENCV",
    intrinsics: Literal["shared", "per-image"] = "shared",
    image_px: int = 1600,
    features: int = 4096,
    overlap: float = 0.75,
    masks: Path | None = None,
    seed: int = 0,
) -> None:
    """Make a scene of photos or a video: poses by COLMAP, place by GPS; goes on where it was cut off.

    Args:
        source: Folder of photos (EXIF and DJI positions are read, or a geo.txt in it), or a video file.
        out: Scene folder to write.
        camera_model: Lens of COLMAP that is fitted.
        intrinsics: Whether images of one camera share their lens.
        image_px: Longer side in pixels of the images in which features are looked for.
        features: Most features of an image.
        overlap: Of a video: share of a picture that the next one chosen still shows.
        masks: Folder of masks (IMAGE.png, black where an image shall be ignored), or one for all images.
        seed: Decides the random draws of structure from motion.
    """
    from plnerf.capture.capture import CaptureConfig
    from plnerf.capture.report import capture_and_tell
    from plnerf.capture.sfm import SfmConfig

    sfm = SfmConfig(camera_model, intrinsics, image_px, features, seed=seed)
    capture_and_tell(source, out, CaptureConfig(sfm, least=overlap, masks=masks), Console())


@app.command
def reconstruct(
    source: tyro.conf.Positional[Path],
    *,
    out: Out,
    preset: PresetName = "pl-nerf-wire",
    seconds: float = 300.0,
    downscale: int = 1,
    seed: int = 0,
) -> None:
    """Photos or a video in, pictures and points on wires out; what is done is not done again.

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
    from plnerf.reconstruct import Training, reconstruct_all

    training = Training(preset, seconds, downscale, seed)
    reconstruct_all(source, out, training, CaptureConfig(SfmConfig(seed=seed)), Console())


@app.command
def train(  # noqa: PLR0913 (an argument is an option)
    scene: tyro.conf.Positional[Path],
    *,
    out: Out,
    preset: PresetName = "pl-nerf",
    seconds: float | None = None,
    steps: int | None = None,
    downscale: int = 1,
    resume: bool = False,
    seed: int = 0,
    device: Literal["auto", "cpu", "cuda"] = "auto",
    backend: Literal["auto", "torch", "numba", "triton"] = "auto",
    set: tyro.conf.UseAppendAction[tuple[str, ...]] = (),
) -> None:
    """Train a radiance field on images with known camera poses.

    Args:
        scene: Folder with transforms.json (nerfstudio, instant-ngp) or a COLMAP model, or the file itself.
        out: Run folder to write.
        preset: Named settings to start from.
        seconds: Budget in seconds of training; 300 when neither this nor --steps is given.
        steps: Budget in steps; such a run can be repeated, and resumed, to the same bits.
        downscale: Integer factor by which images are made smaller.
        resume: Go on with the run in OUT from its newest checkpoint, with its own settings.
        seed: Decides the initial weights and every random draw.
        device: Where to train.
        backend: Implementation of the ops: numba on a CPU, triton on a CUDA device, plain torch anywhere.
        set: A setting to change, as path.to.key=value, e.g. model.field.direction_encoding=sh.
    """
    from plnerf.pipeline import resume_run, train_scene

    if resume and set:
        raise ConfigError(
            "--resume goes on with the run's own settings, so it takes no --set. Change them in "
            f"{out / 'config.json'}, or train anew into another folder."
        )
    if resume:
        resume_run(scene, out, steps=steps, seconds=seconds, console=Console())
    else:
        budget = 300.0 if seconds is None and steps is None else seconds
        train_scene(
            scene, out, preset=preset, steps=steps, seconds=budget, downscale=downscale, settings=set,
            seed=seed, device=device, backend=backend, console=Console(),
        )  # fmt: skip


@app.command
def eval(run: tyro.conf.Positional[Path]) -> None:
    """Measure a run on its held-out images: PSNR, SSIM, wire PSNR, side-by-side panels.

    Args:
        run: Run folder written by `plnerf train`.
    """
    from plnerf.pipeline import evaluate

    evaluate(run, console=Console())


@app.command
def render(
    run: tyro.conf.Positional[Path],
    *,
    views: Literal["test", "train", "path"] = "path",
    outputs: tuple[Output, ...] = ("rgb", "depth"),
    frames: int = 96,
    fps: float = 24.0,
    scale: float = 1.0,
    video: bool = True,
) -> None:
    """Render views of a run to PNG and MP4.

    Args:
        run: Run folder written by `plnerf train`.
        views: Held-out views, training views, or a smooth path along the training cameras.
        outputs: What to render.
        frames: Frames of the path.
        fps: Frames per second of the video.
        scale: Size of the pictures relative to the training images.
        video: Whether to write an MP4 beside the PNGs.
    """
    from plnerf.pipeline import render as render_views

    render_views(
        run, views=views, outputs=outputs, frames=frames, fps=fps, scale=scale, video=video, console=Console()
    )


@app.command
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
) -> None:
    """Render a synthetic power line with its exact truth (needs the extra plnerf[synth]).

    Args:
        out: Scene folder to write; must not exist.
        scene: Which scene, whose own values stand for what is left out: span, double-circuit, bundle,
            distribution, hills, forest, far, parallel, parallel-two-passes, exposure, noisy-poses.
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
    """
    from plnerf.pipeline import synthesize_scene
    from plnerf.synth.options import SceneOptions

    options = SceneOptions(
        seed=seed, samples=samples, width=width, height=height, views=views, motion_blur=motion_blur,
        noise=noise, jpeg_quality=jpeg_quality, auto_exposure=auto_exposure, exposure_drift=exposure_drift,
        white_balance_drift=white_balance_drift, pose_noise_m=pose_noise_m, pose_noise_deg=pose_noise_deg,
    )  # fmt: skip
    synthesize_scene(out, scene, options, console=Console())


@app.command
def survey(
    source: tyro.conf.Positional[Path],
    *,
    out: Annotated[Path | None, tyro.conf.arg(aliases=["-o"])] = None,
    voltage_kv: float | None = None,
    thresholds: Path | None = None,
    clearance_m: float | None = None,
    temperature_c: float | None = None,
) -> None:
    """Conductors as catenaries, sag, clearances, a classified cloud, a report; status 3 if there are none.

    Args:
        source: Run folder, or a LAS or LAZ file in metres, whose classes are not looked at.
        out: Folder to write; survey in the run folder, or beside the cloud, when left out.
        voltage_kv: Nominal voltage in kV, for the clearances that a table requires.
        thresholds: Table of required clearances (TOML); NERC FAC-003-4 when left out.
        clearance_m: A distance in metres to be kept from everything, in place of a table's.
        temperature_c: Of the conductors when they were surveyed, in degrees Celsius.
    """
    from plnerf.pipeline import survey as survey_source
    from plnerf.report.deliver import SurveyOptions

    options = SurveyOptions(voltage_kv, thresholds, clearance_m, temperature_c)
    if not survey_source(source, out, options, console=Console())["conductors"]:
        sys.exit(3)


@app.command
def score(
    survey: tyro.conf.Positional[Path],
    *,
    truth: Path | None = None,
    out: Annotated[Path | None, tyro.conf.arg(aliases=["-o"])] = None,
    classes: tuple[int, ...] | None = None,
    by_cameras: Path | None = None,
) -> None:
    """Score a survey against the truth: wires found and whole, where they are, sag, clearances, certainty.

    Args:
        survey: Survey or run folder, or survey.json; or points or curves alone, in the world
            frame: PLY, LAS, GeoJSON, text, NumPy.
        truth: The truth.json of a scene, or its folder; that of the run's scene when left out.
        out: JSON to write; beside the survey's file when left out.
        classes: Classes of LAS to take; wires (13 and 14) if there are any, else all, when left out.
        by_cameras: Scene that the survey was made of, if it has poses of its own: the truth
            is turned and shifted onto its cameras, by the images' names.
    """
    from plnerf.score.score import score_survey

    score_survey(
        survey, truth=truth, out=out, classes=classes, by_cameras=by_cameras, console=Console()
    )


@app.command
def doctor(
    scene: tyro.conf.Positional[Path],
    *,
    out: Annotated[Path | None, tyro.conf.arg(aliases=["-o"])] = None,
    distance: float | None = None,
    wire_diameter: float = 0.03,
    sigma_px: float = 0.5,
    preset: PresetName = "pl-nerf-wire",
) -> None:
    """Say before training whether photos, or a scene's poses, can show where wires are; status 3 if not.

    Args:
        scene: Scene with poses (transforms.json, COLMAP), or a folder of photos.
        out: JSON to write.
        distance: From cameras to wires in metres; when left out, a scene's span box, that of what the images
            of a capture see, or 10 m; of photos their height over the start (DJI).
        wire_diameter: Of a conductor in metres.
        sigma_px: How well a wire is found in an image, in pixels; of scenes with poses.
        preset: What is to be trained; of photos, how long that takes.
    """
    from plnerf.doctor.photo_doctor import examine_photos
    from plnerf.doctor.scene_doctor import examine
    from plnerf.scene.formats import has_poses

    console = Console()
    if has_poses(scene):
        found = examine(
            scene, out=out, distance=distance, wire_diameter_m=wire_diameter, sigma_px=sigma_px,
            console=console,
        )  # fmt: skip
        sys.exit(0 if found.usable else 3)
    from plnerf.pipeline import find_preset

    usable = examine_photos(
        scene, distance_m=distance, wire_diameter_m=wire_diameter, preset=preset,
        rays_per_s=find_preset(preset).rays_per_s, out=out, console=console,
    )  # fmt: skip
    sys.exit(0 if usable else 3)


app.command(bench)
app.command(compare)


def main() -> None:
    """Entry point of the `plnerf` command."""
    # PyTorch and Numba bring a pool of OpenMP threads each, whose idle threads spin and starve the
    # other's: where anything else runs, a step took three times as long.  Read when the libraries are
    # loaded.
    os.environ.setdefault("OMP_WAIT_POLICY", "PASSIVE")
    # A thread that waits for the next kernel looks for it for some 30 us before it sleeps: waking it takes
    # longer.  (GNU's OpenMP; ten times as much is a tenth faster alone, and 2.7 times slower beside others.)
    os.environ.setdefault("GOMP_SPINCOUNT", "2000")
    console = Console(stderr=True, emoji=False)  # a path may read :x:

    def tell(title: str, text: str) -> None:
        console.print(f"[bold red]{title}[/]: ", end="")
        console.print(text, markup=False, highlight=False, soft_wrap=True)

    def note(message: Warning | str, *_: object, **__: object) -> None:
        console.print(f"note: {message}", markup=False, highlight=False, soft_wrap=True)

    try:
        with warnings.catch_warnings():
            warnings.simplefilter("once", UserWarning)
            warnings.showwarning = note
            app.cli(
                prog="plnerf", description="From photos of a power line to a radiance field and its measures."
            )
    except PlnerfError as error:
        tell(type(error).__name__, str(error))
        sys.exit(1)
    except OSError as error:
        tell("OSError", f"{error}. Check that the folder exists, is writable and has space left.")
        sys.exit(1)
    except KeyboardInterrupt:
        console.print("Interrupted. A training run goes on with --resume.")
        sys.exit(130)


if __name__ == "__main__":
    main()
