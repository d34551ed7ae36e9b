"""Several processes train as one does: how far their weights part, and what a step costs.

    python benchmarks/data_parallel.py SCENE -o OUT [--preset pl-nerf] [--steps 200] [--processes 2]

Trains the scene by one process of one thread, by one process of as many threads as there are processes, by
the processes of one thread each, and by one process whose first weights are off by a ten-millionth: training
amplifies whatever is off, and the last run shows how fast.  Prints at each step of the logs how far the loss
is from that of the first run, in parts of it; of the last checkpoint how far the weights are, in parts of how
far they moved from their start; the held-out PSNR; and the rays that a second of training takes.
"""

import argparse
import json
import os
import subprocess
import sys
from pathlib import Path

import torch
from safetensors.torch import load_file

from plnerf.train.checkpoint import list_checkpoints

NUDGED = """
import sys
import torch
from plnerf.cli.main import main
from plnerf.train import loop

build = loop.build_model

def nudged(*given):
    model, generator = build(*given), torch.Generator().manual_seed(1)
    with torch.no_grad():
        for value in model.parameters():
            value *= 1 + 1e-7 * torch.randn(value.shape, generator=generator)
    return model

loop.build_model = nudged
sys.argv = ["plnerf", *sys.argv[1:]]
main()
"""
"""The command line, with other first weights."""


def train(
    scene: Path, out: Path, options: list[str], *, processes: int = 1, threads: int = 1, nudge: bool = False
) -> Path:
    """One run, in a new folder unless it is there; returns the folder."""
    if (out / "config.json").exists():
        return out
    command = [sys.executable, "-m", "plnerf", "train", str(scene), "-o", str(out), *options]
    if processes > 1:
        command[1:3] = ["-m", "torch.distributed.run", "--nproc-per-node", str(processes), "-m", "plnerf"]
    if nudge:
        command[1:3] = ["-c", NUDGED]
    some = str(threads)
    environment = {**os.environ, "OMP_NUM_THREADS": some, "NUMBA_NUM_THREADS": some}
    subprocess.run(command, check=True, env=environment)
    return out


def log(run: Path, key: str) -> dict[int, float]:
    """A value of the log by step."""
    lines = [json.loads(line) for line in (run / "metrics.jsonl").read_text().splitlines()]
    return {line["step"]: line[key] for line in lines if key in line}


def weights(run: Path, which: int) -> dict[str, torch.Tensor]:
    """Those of a checkpoint that was kept: -1 the last, 0 the first."""
    tensors = load_file(list_checkpoints(run / "checkpoints")[which].with_suffix(".safetensors"))
    return {name: value.double() for name, value in tensors.items() if name.startswith("model.")}


def apart(a: dict[str, torch.Tensor], b: dict[str, torch.Tensor]) -> float:
    """Root of the summed squares of all differences."""
    return sum(float((a[name] - b[name]).square().sum()) for name in a) ** 0.5


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("scene", type=Path)
    parser.add_argument("-o", "--out", type=Path, required=True)
    parser.add_argument("--preset", default="pl-nerf")
    parser.add_argument("--steps", type=int, default=200)
    parser.add_argument("--processes", type=int, default=2)
    parser.add_argument("--downscale", type=int, default=1)
    chosen, further = parser.parse_known_args()
    n = chosen.processes
    options = ["--preset", chosen.preset, "--downscale", str(chosen.downscale), *further]
    full = [*options, "--steps", str(chosen.steps)]
    start = train(chosen.scene, chosen.out / "start", [*options, "--steps", "1"])
    one = train(chosen.scene, chosen.out / "one", full)
    threads = train(chosen.scene, chosen.out / "threads", full, threads=n)
    several = train(chosen.scene, chosen.out / "several", full, processes=n)
    nudged = train(chosen.scene, chosen.out / "nudged", full, nudge=True)
    moved = apart(weights(one, -1), weights(start, 0))
    loss = log(one, "loss")
    print(
        f"cores {len(os.sched_getaffinity(0))}; {chosen.preset}, {chosen.steps} steps; "
        f"weights moved by {moved:.4g}"
    )
    print("| run | loss off at steps, in parts | weights off, in parts of their way | held out dB | rays/s |")
    print("| --- | --- | ---: | ---: | ---: |")
    for name, run in (
        ("1 process, 1 thread", one),
        (f"1 process, {n} threads", threads),
        (f"{n} processes", several),
        ("1 process, weights off by 1e-7", nudged),
    ):
        off = [f"{step}: {abs(log(run, 'loss')[step] / loss[step] - 1):.1e}" for step in loss]
        held_out = list(log(run, "held_out_psnr_db").values())[-1]
        rate = sorted(log(run, "rays_per_s").values())
        parts = apart(weights(run, -1), weights(one, -1)) / moved
        print(f"| {name} | {', '.join(off)} | {parts:.2e} | {held_out:.3f} | {rate[len(rate) // 2]:,.0f} |")


if __name__ == "__main__":
    main()
