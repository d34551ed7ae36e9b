"""All that decides an evaluation's numbers, in words and values, and the table that goes with them."""

import math
import os
import platform
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import torch

import plnerf
from plnerf.train.metrics import NEAR_WIRE_PX, SSIM_WINDOW
from plnerf.train.run import TrainedRun
from plnerf.train.true_pictures import CLOSE_M, WIRE_RULE


def protocol(run: TrainedRun, render_seconds: float, lpips_absent: str | None) -> dict[str, Any]:
    """The rules and circumstances of one evaluation."""
    scene, config = run.scene, run.config
    sizes = scene.images.sizes_px[list(scene.test)]
    rays = int((sizes[:, 0] * sizes[:, 1]).sum())
    return {
        "preset": config.preset,
        "scene": config.scene,
        "scene_format": scene.format,
        "resolution_px": [list(size) for size in sorted({(int(w), int(h)) for w, h in sizes})],
        "downscale": config.downscale,
        "split": "the scene's own lists; every 8th image by name where it has none",
        "training_images": len(scene.train),
        "held_out": [scene.names[i] for i in scene.test],
        "appearance_vector": "mean of the training images' vectors",
        "pose_refinement": config.train.pose_refinement,
        "held_out_poses": "held-out poses are not refined"
        if scene.stated_centre is None
        else "all given poses, those of held-out images too, were adjusted to tie points before training",
        "colours": (
            "sRGB as stored; the render is clipped to [0, 1] and not rounded to 8 bits; pixels that masks "
            "ignore are left out"
        ),
        "psnr": "float64, peak 1; the mean is that of the images' PSNRs",
        "ssim": SSIM_WINDOW,
        "lpips": lpips_absent or "AlexNet, by torchmetrics",
        "wire_mask": f"{WIRE_RULE}; not dilated",
        "near_wire": (
            f"the wire mask at the render's size, dilated by a disc of {NEAR_WIRE_PX} px; PSNR and SSIM over "
            "these pixels"
        ),
        "depth": (
            "where the density lets half of the light through, along the camera's z axis, against the truth "
            "at full size where it is nearer than 65.5 m; no surface where the accumulation is below 0.5; "
            f"median_m is over pixels with a surface, close_share counts errors up to {CLOSE_M} m among all"
        ),
        "unit": scene.frames.unit,
        "backend": config.backend,
        "device": config.device,
        "seed": config.seed,
        "step": run.step,
        "training_seconds": run.seconds,
        "render_seconds": render_seconds,
        "rays_per_second": rays / render_seconds if render_seconds > 0 else None,
        "plnerf": plnerf.__version__,
        "torch": torch.__version__,
        "hardware": hardware(config.device),
    }


def hardware(device: str) -> dict[str, Any]:
    """The machine that rendered: processor, cores, threads in use, and the GPU if it was used."""
    info = Path("/proc/cpuinfo")
    lines = info.read_text().splitlines() if info.exists() else []
    models = [line.partition(":")[2].strip() for line in lines if line.startswith("model name")]
    return {
        "cpu": models[0] if models else platform.processor() or platform.machine(),
        "cores": os.cpu_count(),
        "torch_threads": torch.get_num_threads(),
        "gpu": torch.cuda.get_device_name() if device == "cuda" else None,
    }


def plain(value: Any) -> Any:
    """JSON values in which infinity is the text "inf", since JSON has no number for it."""
    if isinstance(value, dict):
        return {key: plain(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [plain(item) for item in value]
    if isinstance(value, float) and math.isinf(value):
        return "inf" if value > 0 else "-inf"
    return value


def summary(images: Sequence[Mapping[str, Any]], mean: Mapping[str, Any], rules: Mapping[str, Any]) -> str:
    """A short table in Markdown: the images, their mean, and below it the circumstances."""
    columns = {
        "PSNR dB": ("psnr_db", None, "{:.2f}"),
        "SSIM": ("ssim", None, "{:.3f}"),
        "LPIPS": ("lpips", None, "{:.3f}"),
        "PSNR on wires dB": ("wire_psnr_db", None, "{:.2f}"),
        "near wires dB": ("near_wire_psnr_db", None, "{:.2f}"),
        "SSIM near wires": ("near_wire_ssim", None, "{:.3f}"),
        "elsewhere dB": ("elsewhere_psnr_db", None, "{:.2f}"),
        "depth error on wires m": ("wire_depth", "median_m", "{:.2f}"),
        f"wires within {CLOSE_M} m": ("wire_depth", "close_share", "{:.0%}"),
        "depth error elsewhere m": ("elsewhere_depth", "median_m", "{:.2f}"),
    }
    rows = [*images, {"name": "**mean**", **mean}]
    known = {head: column for head, column in columns.items() if any(_cell(row, column) for row in rows)}
    lines = ["| held-out image | " + " | ".join(known) + " |", "| --- |" + " ---: |" * len(known)]
    for row in rows:
        cells = [_cell(row, column) or "-" for column in known.values()]
        lines.append(f"| {row['name']} | " + " | ".join(cells) + " |")
    sizes = ", ".join(f"{width}x{height}" for width, height in rules["resolution_px"])
    lines += [
        "",
        f"Preset {rules['preset']}, {sizes} px (downscale {rules['downscale']}), step {rules['step']} after "
        f"{rules['training_seconds']:.0f} s, seed {rules['seed']}, backend {rules['backend']} on "
        f"{rules['device']} ({rules['hardware']['gpu'] or rules['hardware']['cpu']}).",
        f"Appearance: {rules['appearance_vector']}; {rules['held_out_poses']}. LPIPS: {rules['lpips']}.",
    ]
    return "\n".join(lines) + "\n"


def _cell(row: Mapping[str, Any], column: tuple[str, str | None, str]) -> str:
    key, part, form = column
    value = row[key] if part is None or row[key] is None else row[key][part]
    return form.format(value) if value is not None else ""
