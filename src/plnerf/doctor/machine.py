"""The machine: backend, cores, memory; and which kernels are compiled already, and where."""

import json
from contextlib import suppress
from dataclasses import asdict, dataclass
from importlib import import_module
from pathlib import Path
from stat import S_ISREG

import psutil
import torch

from plnerf.ops.cpu_arrays import usable_cores
from plnerf.ops.kernel_cache import PACKAGE, PREFIX, kept_kernels, kernel_files, kernel_hash
from plnerf.render.self_test import resolve_backend
from plnerf.scene.files import write_text
from plnerf.scene.memory import available_bytes
from plnerf.train.protocol import hardware


@dataclass(frozen=True)
class KernelFolder:
    """A folder in which compiled kernels are kept."""

    path: str
    kernels: int
    """Number of kernels of this version of plnerf that are kept here once they are compiled."""
    compiled: int
    """Number of these that are compiled."""
    files: int
    """Number of files with machine code; a kernel has one for each combination of argument types."""
    megabytes: float
    other_megabytes: float
    """Size of the kernels of other versions, which are removed after two weeks."""


@dataclass(frozen=True)
class Machine:
    """Device, processor, memory and compiled kernels: they decide how fast plnerf is."""

    device: str
    backend: str
    processor: str
    usable_cores: int
    memory_gb: float
    free_gb: float
    """Memory that this process may still allocate."""
    kernel_hash: str
    """Hash of the source of all kernels: after an edit to one of them all are compiled anew."""
    kernels: tuple[KernelFolder, ...]
    not_kept: int
    """Kernels for which no place is writable: every process compiles them."""


def examine_machine() -> Machine:
    """Examines this machine; imports every file that defines kernels, and compiles none."""
    for path in kernel_files(PACKAGE):
        parts = path.relative_to(PACKAGE).with_suffix("").parts
        if path.parent.name != "ops" or path.stem.startswith("cpu_"):
            import_module(".".join(("plnerf", *parts)))
    device = "cuda" if torch.cuda.is_available() else "cpu"
    places = kept_kernels()
    about = hardware(device)
    return Machine(
        device=device,
        backend=resolve_backend("auto", torch.device(device)),
        processor=str(about.get("cpu", "")),
        usable_cores=usable_cores(),
        memory_gb=psutil.virtual_memory().total / 1e9,
        free_gb=available_bytes() / 1e9,
        kernel_hash=kernel_hash(),
        kernels=tuple(_folder(path, names) for path, names in sorted(places.items()) if path),
        not_kept=len(places.get("", ())),
    )


def _folder(path: str, indices: list[str]) -> KernelFolder:
    """indices: names of the files that list what is compiled of each kernel."""
    folder = Path(path)
    code = list(folder.glob("*.nbc"))
    others = [one for one in folder.parent.glob(f"{PREFIX}*") if one != folder]
    return KernelFolder(
        path,
        kernels=len(indices),
        compiled=sum((folder / name).exists() for name in indices),
        files=len(code),
        megabytes=_megabytes([folder]),
        other_megabytes=_megabytes(others),
    )


def _megabytes(folders: list[Path]) -> float:
    return sum(_bytes(one) for folder in folders for one in folder.glob("*")) / 1e6


def _bytes(path: Path) -> int:
    """Size of a file; 0 of a folder, and of what another process has removed since it was listed."""
    with suppress(FileNotFoundError):
        about = path.stat()
        return about.st_size if S_ISREG(about.st_mode) else 0
    return 0


def machine_text(machine: Machine) -> str:
    """A few lines for a terminal."""
    kernels, compiled = (
        sum(getattr(one, name) for one in machine.kernels) for name in ("kernels", "compiled")
    )
    lines = [
        f"backend    {machine.backend} on {machine.device}",
        f"processor  {machine.processor}, {machine.usable_cores} usable cores",
        f"memory     {machine.memory_gb:.1f} GB, {machine.free_gb:.1f} GB free",
        f"kernels    {compiled} of {kernels} were compiled before; the others are when they are first used",
    ]
    for one in machine.kernels:
        other = f", and {one.other_megabytes:.1f} MB of other versions" if one.other_megabytes else ""
        lines.append(f"           {one.compiled} of {one.kernels}, {one.megabytes:.1f} MB{other}: {one.path}")
    if machine.not_kept:
        lines.append(
            f"           {machine.not_kept} cannot be kept: set NUMBA_CACHE_DIR to a folder that is writable"
        )
    return "\n".join(lines)


def write_machine(path: Path, machine: Machine) -> None:
    """The same as JSON."""
    write_text(path, json.dumps(asdict(machine), indent=1) + "\n")
