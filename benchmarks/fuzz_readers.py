"""Feeds damaged files to all readers: `python benchmarks/fuzz_readers.py [--runs 200000]`.

Each reader has a process of its own, in which Atheris (libFuzzer, extra plnerf[fuzz]) is led by the lines of
plnerf and laspy that an input reaches; without Atheris, or with --blind, changes are drawn.  Half of the
inputs are changed by libFuzzer, half by `tests/fuzz/mutations.py`, which knows numbers and JSON.

An input is found to be broken where a reader neither refuses it with a PlnerfError nor gives finite content,
takes more than 2 s of a CPU or 1 GB of memory, or ends its process.  What was found is printed and kept:
OUT/READER/*.bin, with the corpus.  Status 1 where there is any.
"""

import argparse
import contextlib
import hashlib
import os
import random
import resource
import subprocess
import sys
import tempfile
import traceback
from collections.abc import Callable
from pathlib import Path
from types import ModuleType

ROOT = Path(__file__).resolve().parent.parent
INSTRUMENTED = ["plnerf.scene", "plnerf.line.files", "plnerf.score", "plnerf.capture",
                "plnerf.mechanics.loads", "plnerf.mechanics.conductor", "plnerf.train.run",
                "plnerf.train.report", "plnerf.train.scene_record", "plnerf.train.checkpoint",
                "plnerf.train.true_pictures", "plnerf.survey.thresholds", "plnerf.survey.rule_file",
                "plnerf.survey.map_objects", "plnerf.survey.lidar.point_cloud", "plnerf.view.points",
                "laspy"]  # fmt: skip
RESTARTS = 20
"""Of a reader whose process ended: more say nothing new."""
LONGEST = 1 << 17
"""Bytes of an input."""


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("--runs", type=int, default=200_000, help="inputs of all readers together")
    parser.add_argument("--readers", nargs="*", default=[], help="all if left out")
    parser.add_argument("--out", type=Path, default=Path(tempfile.gettempdir()) / "plnerf-fuzz")
    parser.add_argument("--blind", action="store_true", help="without Atheris")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--child", help=argparse.SUPPRESS)
    options = parser.parse_args()
    sys.path[:0] = [str(ROOT), str(ROOT / "src")]
    if options.child is not None:
        fuzz(options.child, options.runs, options.out, options.seed, atheris_or_none(options.blind))
        return
    sys.exit(1 if fuzz_all(options) else 0)


def atheris_or_none(blind: bool) -> ModuleType | None:
    """The fuzzer, if it is wanted and installed."""
    if blind:
        return None
    with contextlib.suppress(ImportError):
        import atheris

        return atheris
    return None


def fuzz_all(options: argparse.Namespace) -> int:
    """Number of readers with something found."""
    from tests.fuzz.readers import all_readers

    with tempfile.TemporaryDirectory() as folder:
        names = options.readers or [reader.name for reader in all_readers(Path(folder))]
    each = -(-options.runs // len(names))
    led = "drawn" if atheris_or_none(options.blind) is None else "led by coverage"
    print(f"{len(names)} readers, {each} inputs each, {led}\n")
    print("| reader | inputs | accepted | found |\n| --- | ---: | ---: | --- |")
    total, broken = 0, 0
    for name in names:
        done, accepted, found = fuzz_in_processes(name, each, options)
        print(f"| {name} | {done:,} | {accepted:,} | {'; '.join(found) or '–'} |", flush=True)
        total, broken = total + done, broken + bool(found)
    print(f"\n{total:,} inputs in all, {broken} of {len(names)} readers with something found.")
    return broken


def fuzz_in_processes(name: str, runs: int, options: argparse.Namespace) -> tuple[int, int, list[str]]:
    """Inputs done, inputs accepted, and what was found; after a process that ends, another."""
    out = options.out / name.replace("/", "_")
    out.mkdir(parents=True, exist_ok=True)
    (out / "log.txt").unlink(missing_ok=True)
    done, accepted, ends, count = 0, 0, [], out / "count.txt"
    for turn in range(RESTARTS):
        count.unlink(missing_ok=True)
        command = [sys.executable, __file__, "--child", name, "--runs", str(runs - done), "--out", str(out)]
        command += ["--seed", str(options.seed + turn), *["--blind"] * options.blind]
        with (out / "output.txt").open("wb") as output:
            ended = subprocess.run(command, stdout=output, stderr=output, check=False, timeout=3600)
        if not count.exists():
            sys.exit(f"{name} was not begun: {(out / 'output.txt').read_text(errors='replace')[-1000:]}")
        fed, taken = (count.read_text().splitlines() or ["0 0"])[-1].split()
        done, accepted = done + int(fed), accepted + int(taken)
        if ended.returncode in {0, 77}:
            break
        ends.append(f"process ended with {ended.returncode}, on {keep(out, (out / 'last.bin').read_bytes())}")
    log = (out / "log.txt").read_text().splitlines() if (out / "log.txt").exists() else []
    return done, accepted, [*log, *ends]


def keep(out: Path, content: bytes) -> str:
    """Name of the file that an input is kept in."""
    name = f"{hashlib.sha256(content).hexdigest()[:12]}.bin"
    (out / name).write_bytes(content)
    return name


def fuzz(name: str, runs: int, out: Path, seed: int, atheris: ModuleType | None) -> None:
    """Feeds a reader in this process, and writes down what was found."""
    with atheris.instrument_imports(include=INSTRUMENTED) if atheris else contextlib.nullcontext():
        from tests.fuzz.accepted import MAX_MEMORY, feed
        from tests.fuzz.mutations import mutated
        from tests.fuzz.readers import all_readers
    folder = tempfile.mkdtemp(dir="/dev/shm" if os.access("/dev/shm", os.W_OK) else None)
    reader = next(one for one in all_readers(Path(folder)) if one.name == name)
    for content in reader.seeds:
        assert feed(reader, content), f"{name} does not take what fuzzing begins from"
    used = int(Path("/proc/self/statm").read_text().split()[0]) * os.sysconf("SC_PAGE_SIZE")
    resource.setrlimit(resource.RLIMIT_AS, (used + MAX_MEMORY, used + MAX_MEMORY))
    counts, seen = [0, 0], set()
    count = (out / "count.txt").open("w", buffering=1)

    def one_input(content: bytes) -> None:
        (out / "last.bin").write_bytes(content)
        counts[0] += 1
        try:
            counts[1] += feed(reader, content)
        except BaseException as error:  # also what native code raises that is no Exception
            at = traceback.extract_tb(error.__traceback__)[-1]
            where = (type(error).__name__, at.filename, at.lineno)
            if where not in seen:
                seen.add(where)
                text = " ".join(str(error).split())[:160].replace(str(folder), "")
                line = f"{where[0]}: {text} ({Path(at.filename).name}:{at.lineno}), {keep(out, content)}\n"
                with (out / "log.txt").open("a") as log:
                    log.write(line)
        count.write(f"{counts[0]} {counts[1]}\n")

    change = _mutator(mutated, reader.is_json, atheris)
    if atheris is None:
        draw = random.Random(f"{name} {seed}")
        for _ in range(runs):
            one_input(mutated(draw.choice(reader.seeds), draw, reader.is_json))
        return
    corpus = out / "corpus"
    corpus.mkdir(exist_ok=True)
    for content in reader.seeds:
        keep(corpus, content)
    arguments = [f"-runs={runs}", f"-seed={seed + 1}", f"-max_len={LONGEST}", "-timeout=60"]
    arguments.append("-rss_limit_mb=0")  # that of the process does
    atheris.Setup(["fuzz", *arguments, str(corpus)], one_input, custom_mutator=change)
    atheris.Fuzz()


def _mutator(
    mutated: Callable[..., bytes], is_json: bool, atheris: ModuleType | None
) -> Callable[[bytes, int, int], bytes]:
    """Every other input by libFuzzer, the others by what is known of the formats."""

    def change(content: bytes, most: int, seed: int) -> bytes:
        draw = random.Random(seed)
        if atheris is not None and draw.random() < 0.5:
            return bytes(atheris.Mutate(content, most))
        return mutated(content, draw, is_json)[:most]

    return change


if __name__ == "__main__":
    main()
