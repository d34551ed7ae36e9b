"""The command that hangs known wires in the photos of a captured scene."""

from dataclasses import replace
from pathlib import Path
from typing import Literal

import tyro

from plnerf.cli.options import Out
from plnerf.terminal import Terminal


def hang(  # noqa: PLR0913 (an argument is an option)
    scene: tyro.conf.Positional[Path],
    *,
    out: Out,
    seed: int = 0,
    groups: int = 2,
    wires: tuple[int, int] = (2, 4),
    azimuth: float | None = None,
    depth: tuple[float, float] = (0.6, 0.9),
    width: tuple[float, float] = (3.0, 8.0),
    sag: tuple[float, float] = (0.01, 0.04),
    material: Literal["aluminium", "weathered", "copper"] | None = None,
) -> None:
    """Draw exact catenaries into the photos of a captured scene, and write their truth.

    Args:
        scene: Scene with poses and photos: a scene folder, a transforms.json, or a COLMAP folder.
        out: Folder to write, images/ and truth.json; must not exist.
        seed: Decides every random draw.
        groups: Groups of parallel wires, each in a direction of its own.
        wires: Least and greatest number of wires of a group.
        azimuth: Direction of the first group in degrees clockwise from north (the world's +y); drawn
            when left out.
        depth: Range of the distances from the cameras, as shares of the scene's depth.
        width: Range of widths in pixels, where a wire is nearest (the nearest tenth of its places).
        sag: Range of the sag, as a share of the span.
        material: What wires are made of; drawn for each group when left out.
    """
    from plnerf.console import bars, say
    from plnerf.pipeline import hang_wires
    from plnerf.synth.hang_config import ChooseConfig, DrawConfig, HangConfig
    from plnerf.synth.hang_truth import summary_of

    config = HangConfig(
        seed,
        ChooseConfig(groups, wires, azimuth_deg=azimuth, depth=depth, width_px=width, sag=sag),
        replace(DrawConfig(), material=material),
    )
    console = Terminal()
    with bars(console) as progress:
        folder = hang_wires(scene, out, config, progress)
    say(console, summary_of(folder))
    say(console, f"photos: {folder / 'images'}, truth: {folder / 'truth.json'}")
