"""Scenes of `plnerf synth` drawn by `raster.py`, several times as fast as by its path tracer:
`python benchmarks/raster_scenes.py OUT --seeds 2 4 6 --names wind orbit [--width PX] [--views N]`.

OUT/random-N is a scene folder with its truth, as `plnerf synth OUT/random-N --scene random --seed N` makes
it, OUT/span-N likewise of the scene random-span (--span-seeds N), and OUT/NAME as `plnerf synth OUT/NAME
--scene NAME` does: the same line, land, plants, flight, exposure, blur, noise and JPEG, in simpler light.
`plnerf bench --suite coverage --scenes OUT/random-*` then measures the intervals of their surveys.
"""

import argparse
import multiprocessing
import shutil
import time
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from raster import Bodies, bodies_of, depth, picture, wires_only

from plnerf.ops.cpu_arrays import usable_cores
from plnerf.synth.build import build_site
from plnerf.synth.capture import View, plan_flight
from plnerf.synth.check import check_cameras
from plnerf.synth.flight_config import CaptureConfig
from plnerf.synth.scene_options import RANDOM, RANDOM_SPAN, SceneOptions, find_scene
from plnerf.synth.synthesize import write_scene

EXPOSURE = 2.9
"""Of the path tracer's pictures that are as bright as these."""


@dataclass(frozen=True)
class RasterStudio:
    """A `plnerf.synth.film.Studio`."""

    bodies: Bodies
    capture: CaptureConfig
    exposure: float

    def linear(self, instants: Sequence[View], seed: int) -> np.ndarray:
        del seed  # nothing here is drawn at random
        shots = [picture(self.bodies, view, self.capture) for view in instants]
        return np.mean(shots, axis=0) * (self.exposure / EXPOSURE)

    def wire_coverage(self, view: View) -> np.ndarray:
        return wires_only(self.bodies, view, self.capture)

    def depth_m(self, view: View) -> np.ndarray:
        return depth(self.bodies, view, self.capture)


def draw_scene(out: Path, name: str, options: SceneOptions) -> Path:
    """The scene of `plnerf synth --scene name` with these options in the new folder `out`."""
    config = options.apply(find_scene(name, options.seed))
    site = build_site(config.span)
    views = plan_flight(site, config.capture)
    check_cameras(site, views)
    studio = RasterStudio(bodies_of(site, config.image), config.capture, config.image.exposure)
    unfinished = out.with_name(f".{out.name}")
    shutil.rmtree(unfinished, ignore_errors=True)  # of a run that was interrupted
    write_scene(unfinished, site, views, studio, config)
    unfinished.rename(out)
    return out


def _draw(task: tuple[Path, str, SceneOptions]) -> str:
    began = time.monotonic()
    draw_scene(*task)
    return f"{task[0]}: {time.monotonic() - began:.0f} s"


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("out", type=Path)
    parser.add_argument("--seeds", type=int, nargs="+", default=[], help="of random scenes")
    parser.add_argument("--span-seeds", type=int, nargs="+", default=[], help="of random whole spans")
    parser.add_argument("--names", nargs="+", default=[], help="of scenes of plnerf synth")
    parser.add_argument("--width", type=int, help="of the images, in pixels; the same pictures")
    parser.add_argument("--views", type=int, help="images of each pass")
    given = parser.parse_args()
    given.out.mkdir(parents=True, exist_ok=True)
    common = SceneOptions(width=given.width, views=given.views)
    tasks: list[tuple[Path, str, SceneOptions]] = [
        *((given.out / f"random-{seed}", RANDOM, replace(common, seed=seed)) for seed in given.seeds),
        *((given.out / f"span-{seed}", RANDOM_SPAN, replace(common, seed=seed)) for seed in given.span_seeds),
        *((given.out / name, name, common) for name in given.names),
    ]
    with multiprocessing.get_context("fork").Pool(usable_cores()) as pool:
        for line in pool.imap(_draw, [task for task in tasks if not task[0].exists()]):
            print(line, flush=True)


if __name__ == "__main__":
    main()
