r"""The race on a CPU: nerfstudio's nerfacto and plnerf in turn on the same cores, photos, sizes and split.

    python benchmarks/race_cpu.py --peer-python PEER/bin/python --peer-script nerfacto_cpu.py --scene fox \
        -o RACE

The peer's script trains nerfstudio's own model, losses and optimisers in a bare loop on a transforms.json
scene, takes `DATA --down D --rays R --seconds S --threads T --evals E...`, and prints lines
`train_s S it N s/it X test PSNR P`.  It lives in an environment of its own.  Slices of both alternate;
race.json and race.md are written after each, so that a race that was cut off is not lost.  About 45 minutes;
--quick takes 3.
"""

import itertools
import json
import os
import re
import shutil
import statistics
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from dataclasses import asdict, dataclass, field, replace
from datetime import UTC, datetime
from pathlib import Path
from typing import Annotated, Any

import tyro
from rich.console import Console

from plnerf.bench.machine import circumstances
from plnerf.bench.tables import Table, figure
from plnerf.errors import ConfigError, PlnerfError

PEER_LINE = re.compile(r"train_s ([\d.]+) it (\d+) s/it ([\d.]+) test PSNR ([\d.]+)")
NOTES = (
    "Peer: nerfstudio's NerfactoModel in plain torch with its own losses and optimiser settings in a bare "
    "loop; plnerf: the command `plnerf train`. Same photos reduced by the same factor, every 8th image by "
    "name held out, same number of threads, slices in turn. Seconds of training count neither loading nor "
    "evaluation; plnerf's leave out its first step, which compiles or loads kernels, the peer's leave out "
    "nothing. Wall clock counts all from the start of the process, evaluations too.",
    "The PSNRs are not over the same pixels: the peer's is over 8,192 fixed random held-out pixels of photos "
    "that were undistorted and resampled first, plnerf's over 4,096 fixed random held-out pixels of the "
    "photos as they are, reduced. Both pool the squared errors of all pixels.",
    "plnerf's learning rates decay over the budget given, the peer's stay. The time to a PSNR is "
    "interpolated linearly between the evaluations around it; of several runs the median is told.",
)


@dataclass(frozen=True)
class Plan:
    """Seconds of training of each slice."""

    rounds: int = 3
    """Pairs of a short run of plnerf and one of the peer, for the rates."""
    ours_s: float = 15.0
    peer_rate_s: float = 20.0
    target_rounds: int = 2
    """Runs of the peer at its best setting, up to the PSNR aimed at."""
    target_most_s: float = 480.0
    target_every_s: float = 30.0
    both_s: float = 300.0
    """Long run of both; the peer's first run at its best setting goes on at least until then."""
    peer_long_s: float = 1200.0

    def times(self, factor: float) -> "Plan":
        """The same plan with all durations multiplied."""
        names = ("ours_s", "peer_rate_s", "target_most_s", "target_every_s", "both_s", "peer_long_s")
        return replace(self, **{name: getattr(self, name) * factor for name in names})


QUICK = Plan(1, 10.0, 10.0, 1, 40.0, 20.0, 30.0, 30.0)


@dataclass(frozen=True)
class Arguments:
    """The race against nerfacto."""

    peer_python: Path
    """Python of the peer's environment."""
    peer_script: Path
    """The peer's training script."""
    scene: Path
    """Scene folder with transforms.json."""
    out: Annotated[Path, tyro.conf.arg(aliases=["-o"])]
    """New folder for race.json, race.md and the runs."""
    downscale: int = 8
    """Integer factor by which images are made smaller."""
    target_db: float = 18.5
    """Held-out PSNR whose time is told."""
    best_rays: int = 256
    """Rays of a step at the peer's best setting for a small budget."""
    peer_rays: int = 1024
    """Rays of a step for its rate and its long run."""
    quick: bool = False
    """Three minutes: to see that it works, not to quote."""
    factor: float = 1.0
    """Multiplies every duration."""
    rounds: int | None = None
    """Pairs of short runs for the rates; 3 unless told otherwise."""
    target_rounds: int | None = None
    """Runs of the peer up to the PSNR aimed at; 2 unless told otherwise."""


@dataclass(frozen=True)
class Point:
    """One evaluation on held-out pixels."""

    training_s: float
    wall_s: float
    steps: int
    psnr_db: float


@dataclass
class Run:
    """One slice."""

    who: str
    rays: int
    budget_s: float
    load_before: tuple[float, float, float]
    """Load averages of the machine over 1, 5 and 15 minutes, when the slice began."""
    points: list[Point] = field(default_factory=list)
    rays_per_s: float = 0.0
    wall_s: float = 0.0

    def time_to(self, target_db: float, clock: Callable[[Point], float]) -> float | None:
        """When the PSNR was reached, interpolated between evaluations; None where it never was."""
        before: Point | None = None
        for point in self.points:
            if point.psnr_db >= target_db:
                if before is None:
                    return clock(point)
                share = (target_db - before.psnr_db) / (point.psnr_db - before.psnr_db)
                return clock(before) + share * (clock(point) - clock(before))
            before = point
        return None

    def psnr_after(self, seconds: float) -> float | None:
        """The PSNR of the evaluation nearest to so many seconds of training; None where none is near."""
        nearest = min(self.points, key=lambda point: abs(point.training_s - seconds), default=None)
        if nearest is None or abs(nearest.training_s - seconds) > 1 + 0.01 * seconds:
            return None
        return nearest.psnr_db


def main(arguments: Arguments) -> None:
    """Runs all slices; the tables are written after each."""
    check(arguments)
    plan = (QUICK if arguments.quick else Plan()).times(arguments.factor)
    given = {"rounds": arguments.rounds, "target_rounds": arguments.target_rounds}
    plan = replace(plan, **{name: count for name, count in given.items() if count is not None})
    console, runs = Console(), list[Run]()
    about = {"arguments": json.loads(json.dumps(asdict(arguments), default=str)), "plan": asdict(plan)}
    about |= circumstances("cpu")
    arguments.out.mkdir(parents=True)
    for count, slice_ in enumerate(slices(arguments, plan), start=1):
        with console.status(f"slice {count}"):
            run = slice_(count)
        runs.append(run)
        last = f"{run.points[-1].psnr_db:.2f} dB" if run.points else "no evaluation"
        console.print(f"slice {count}: {run.who}, {run.rays} rays, {run.rays_per_s:,.0f} rays/s, {last}")
        write(arguments, plan, runs, about)
    console.print(table(arguments, plan, runs).for_console())


def check(arguments: Arguments) -> None:
    """Raises ConfigError for what is not there."""
    for path in (arguments.peer_python, arguments.peer_script, arguments.scene / "transforms.json"):
        if not path.exists():
            raise ConfigError(f"The race needs {path}, which is not there. Correct the path.")
    if arguments.out.exists():
        raise ConfigError(f"The race writes a new folder, but {arguments.out} is there. Name another: -o.")


def slices(arguments: Arguments, plan: Plan) -> Iterator[Callable[[int], Run]]:
    """All slices in order, plnerf and the peer in turn; each is told its number."""

    def ours(seconds: float) -> Callable[[int], Run]:
        return lambda count: run_ours(arguments, seconds, count)

    def peer(
        rays: int, seconds: float, every: float, stop_after: float = float("inf")
    ) -> Callable[[int], Run]:
        return lambda count: run_peer(arguments, rays, seconds, every, stop_after, count)

    for _ in range(plan.rounds):
        yield ours(plan.ours_s)
        yield peer(arguments.peer_rays, plan.peer_rate_s, plan.peer_rate_s)
    for i in range(plan.target_rounds):
        yield ours(plan.ours_s)
        least = plan.both_s if i == 0 else 0.0  # the first one also tells the PSNR after that time
        yield peer(arguments.best_rays, plan.target_most_s, plan.target_every_s, least)
    yield ours(plan.both_s)
    yield peer(arguments.peer_rays, plan.peer_long_s, plan.both_s)


def run_ours(arguments: Arguments, seconds: float, count: int) -> Run:
    """`plnerf train` in a process of its own; evaluations are read from its log as they come."""
    folder = arguments.out / f"ours-{count}"
    validations = round(min(60, max(10, 2 * seconds)))
    command = [
        sys.executable, "-m", "plnerf.cli.main", "train", str(arguments.scene), "-o", str(folder),
        "--downscale", str(arguments.downscale), "--seconds", str(seconds), "--device", "cpu",
        "--train.validations", str(validations), "--train.checkpoints", "1",
    ]  # fmt: skip
    run, rates, seen, begin = (
        Run("plnerf", 0, seconds, os.getloadavg()),
        list[float](),
        0,
        time.perf_counter(),
    )
    with Child(command, arguments.out / f"ours-{count}.log", dict(os.environ)) as child:
        running = True
        while running:
            running = child.runs()
            log = folder / "metrics.jsonl"
            lines = log.read_text().splitlines(keepends=True) if log.exists() else []
            whole = [json.loads(line) for line in lines if line.endswith("\n")]
            for entry in whole[seen:]:
                if "rays_per_s" in entry:
                    rates.append(entry["rays_per_s"])
                else:
                    wall = time.perf_counter() - begin
                    run.points.append(Point(entry["seconds"], wall, entry["step"], entry["held_out_psnr_db"]))
            seen = len(whole)
            time.sleep(0.05 if running else 0)
        child.check()
    run.wall_s = time.perf_counter() - begin
    run.rays = json.loads((folder / "config.json").read_text())["train"]["rays"]
    run.rays_per_s = statistics.median(rates[len(rates) // 10 :])
    shutil.rmtree(folder / "pixels")
    return run


def run_peer(
    arguments: Arguments, rays: int, seconds: float, every: float, stop_after: float, count: int
) -> Run:
    """The peer's script, evaluated every so often; ended once the target and `stop_after` are reached."""
    evaluations = [
        str(e) for e in itertools.takewhile(lambda e: e < seconds - 1, itertools.count(every, every))
    ]
    command = [
        str(arguments.peer_python), "-u", str(arguments.peer_script), str(arguments.scene),
        "--down", str(arguments.downscale), "--rays", str(rays), "--seconds", str(seconds),
        "--threads", str(len(os.sched_getaffinity(0))), "--evals", *evaluations,
    ]  # fmt: skip
    # Set for plnerf's own sake, whose two thread pools would spin against each other; the peer has one.
    environment = {key: value for key, value in os.environ.items() if key != "OMP_WAIT_POLICY"}
    run, begin = Run("nerfacto", rays, seconds, os.getloadavg()), time.perf_counter()
    with Child(command, arguments.out / f"peer-{count}.log", environment) as child:
        for line in child.lines():
            if match := PEER_LINE.search(line):
                spent, steps, per_step, psnr_db = (float(text) for text in match.groups())
                point = Point(spent, time.perf_counter() - begin, int(steps), psnr_db)
                run.points.append(point)
                run.rays_per_s = rays / per_step
                if point.psnr_db >= arguments.target_db and spent >= stop_after - 1:
                    break
        else:
            child.check()
    run.wall_s = time.perf_counter() - begin
    return run


class Child:
    """A process whose output goes to a file; ended with the context, whatever happens."""

    def __init__(self, command: list[str], log: Path, environment: dict[str, str]) -> None:
        self._log, self._command = log, command
        self._file = log.open("w")
        self._process = subprocess.Popen(
            command, stdout=self._file, stderr=subprocess.STDOUT, env={**environment, "COLUMNS": "100"}
        )

    def __enter__(self) -> "Child":
        return self

    def __exit__(self, *_: object) -> None:
        if self.runs():
            self._process.terminate()
        self._process.wait()
        self._file.close()

    def runs(self) -> bool:
        """Whether it has not ended yet."""
        return self._process.poll() is None

    def lines(self) -> Iterator[str]:
        """Whole lines of its output as they come, until it ends."""
        with self._log.open() as output:
            part, running = "", True
            while running:
                running = self.runs()
                part += output.read()
                *whole, part = part.split("\n")
                yield from whole
                time.sleep(0.05 if running else 0)

    def check(self) -> None:
        """Raises PlnerfError with the end of its output unless it ended well."""
        if status := self._process.wait():
            end = "\n".join(self._log.read_text().splitlines()[-15:])
            raise PlnerfError(
                f"{' '.join(self._command)} ended with status {status}; see {self._log}:\n{end}"
            )


def table(arguments: Arguments, plan: Plan, runs: list[Run]) -> Table:
    """What was measured so far, side by side."""
    ours = [run for run in runs if run.who == "plnerf" and run.budget_s == plan.ours_s]
    ours_long = [run for run in runs if run.who == "plnerf" and run.budget_s == plan.both_s]
    best = [run for run in runs if run.who == "nerfacto" and run.rays == arguments.best_rays]
    many = [run for run in runs if run.who == "nerfacto" and run.rays == arguments.peer_rays]
    first = runs[: 2 * plan.rounds]
    paired = zip(first[::2], first[1::2], strict=False)  # the last may have no partner yet
    pairs = [mine.rays_per_s / theirs.rays_per_s for mine, theirs in paired]
    rows: list[tuple[str, ...]] = []

    def faster(
        what: str, peer: float | None, mine: float | None, ratio: float | None, digits: int = 3
    ) -> None:
        times = f"{figure(ratio)}×" if ratio is not None else "–"
        rows.append((what, figure(peer, digits), figure(mine, digits), times))

    def better(what: str, peer: float | None, mine: float | None) -> None:
        more = f"{mine - peer:+.2f} dB" if peer is not None and mine is not None else "–"
        rows.append((what, figure(peer, 4), figure(mine, 4), more))

    def times_to(several: list[Run], clock: Callable[[Point], float]) -> float | None:
        return middle([run.time_to(arguments.target_db, clock) for run in several])

    for words, clock in (("training", training_s), ("wall clock", wall_s)):
        a, b = times_to(best, clock), times_to(ours, clock)
        what = f"s of {words} to {arguments.target_db:g} dB (nerfacto: {arguments.best_rays} rays)"
        faster(what, a, b, a / b if a and b else None)
    rate = middle([run.rays_per_s for run in ours[: plan.rounds]])
    many_rate = middle([run.rays_per_s for run in many[: plan.rounds]])
    faster(f"rays/s (nerfacto: {arguments.peer_rays} rays)", many_rate, rate, middle(pairs))
    best_rate = middle([run.rays_per_s for run in best])
    times = rate / best_rate if best_rate and rate else None
    faster(f"rays/s (nerfacto: {arguments.best_rays} rays)", best_rate, rate, times)
    both, short, long = plan.both_s, plan.ours_s, plan.peer_long_s
    for several, rays in ((best, arguments.best_rays), (many, arguments.peer_rays)):
        peer_db = middle([run.psnr_after(both) for run in several])
        ours_db = middle([run.psnr_after(both) for run in ours_long])
        better(f"PSNR after {both:g} s of both (nerfacto: {rays} rays)", peer_db, ours_db)
    peer_db = middle([run.psnr_after(long) for run in many])
    what = f"PSNR after {long:g} s of nerfacto ({arguments.peer_rays} rays), {short:g} s of plnerf"
    better(what, peer_db, middle([run.psnr_after(short) for run in ours]))
    return Table("Race on a CPU", ("what", "nerfacto", "plnerf", "plnerf is"), tuple(rows), NOTES)


def training_s(point: Point) -> float:
    """Seconds of training."""
    return point.training_s


def wall_s(point: Point) -> float:
    """Seconds since the process was started."""
    return point.wall_s


def middle(values: list[Any]) -> float | None:
    """The median of what there is."""
    there = [value for value in values if value is not None]
    return statistics.median(there) if there else None


def write(arguments: Arguments, plan: Plan, runs: list[Run], about: dict[str, Any]) -> None:
    """race.json with every evaluation, race.md with the table."""
    done = datetime.now(UTC).isoformat(timespec="seconds")
    content = {"format_version": 1, "done_utc": done, **about, "runs": [asdict(run) for run in runs]}
    head = (
        f"{about['date_utc']}, {about['cpu']}, {about['usable_cores']} cores; {arguments.scene.name} at "
        f"1/{arguments.downscale} size; {len(runs)} slices so far{', quick' if arguments.quick else ''}.\n\n"
    )
    for name, text in (
        ("race.json", json.dumps(content, indent=1) + "\n"),
        ("race.md", head + table(arguments, plan, runs).markdown()),
    ):
        part = arguments.out / f"{name}.part"
        part.write_text(text)
        part.replace(arguments.out / name)


if __name__ == "__main__":
    try:
        main(tyro.cli(Arguments))
    except PlnerfError as error:
        sys.exit(f"{type(error).__name__}: {error}")
