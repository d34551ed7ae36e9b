"""Who does the tasks: this process, one after the other, or the workers of a Ray cluster.

Ray (https://docs.ray.io) is the extra `plnerf[cluster]`.  All nodes need the same folders at the same places,
and plnerf.
"""

import logging
import os
import socket
from collections.abc import Callable, Mapping, Sequence
from importlib.util import find_spec
from pathlib import Path
from typing import Any, Protocol, runtime_checkable

from plnerf.corridor.ledger import Ledger, Task
from plnerf.errors import ConfigError, PlnerfError

Work = Callable[[Path, Task], None]
"""`run_task`, or what stands in its place."""
Heard = Callable[[Task], None]
"""Called with a task whenever its record may have changed."""
RETRIES = 3
"""A task whose worker died is started again so many times."""
POLL_S = 1.0
CONNECT_S = 10.0
"""Seconds after which a cluster that does not answer counts as absent."""
THREADS = ("OMP_NUM_THREADS", "MKL_NUM_THREADS", "OPENBLAS_NUM_THREADS", "NUMBA_NUM_THREADS")
"""Environment variables by which libraries choose their number of threads."""


def _run_task(out: Path, task: Task) -> None:
    """The work of all tasks, which is loaded where it is done: it brings most of plnerf."""
    from plnerf.corridor.tasks import run_task

    run_task(out, task)


@runtime_checkable
class Engine(Protocol):
    """Does tasks, in any order; those that fail keep no other from being done."""

    def run(self, out: Path, tasks: Sequence[Task], heard: Heard) -> None:
        """Returns once each is done or failed, as its record says."""

    def close(self) -> None:
        """Leaves what it has joined."""


class InThisProcess:
    """One after the other."""

    def __init__(self, work: Work = _run_task) -> None:
        """work: what does a task."""
        self._work = work

    def run(self, out: Path, tasks: Sequence[Task], heard: Heard) -> None:
        """Does the tasks in their order; returns once each is done or failed."""
        ledger = Ledger(out)
        for task in tasks:
            ledger.write(task, "running")
            heard(task)
            try:
                self._work(out, task)
            except PlnerfError as error:
                ledger.write(task, "failed", error=str(error))
            heard(task)

    def close(self) -> None:
        """There is nothing to leave."""


class OnRay:
    """As many at a time as the cluster has cores for."""

    def __init__(self, address: str, cores: int = 1, gpus: float = 0.0, work: Work = _run_task) -> None:
        """address: of a cluster, such as 192.0.2.1:6379; "auto": of the one that runs on this machine;
        "local": one of this machine alone, for as long as this process lives.  cores, gpus: of each task.
        work: what does a task.

        Raises ConfigError where Ray is not installed, or there is no such cluster.
        """
        if find_spec("ray") is None:
            raise ConfigError(
                'A cluster needs Ray, which is not installed. Install it, pip install "plnerf[cluster]", or '
                "leave --address out: blocks are then done one after the other."
            )
        _require_server(address)
        import ray

        self._cores, self._gpus, self._work = cores, gpus, work
        env = {"env_vars": dict.fromkeys(THREADS, str(cores)) | {"RAY_DEDUP_LOGS": "0"}}
        options: dict[str, Any] = {"include_dashboard": False} if address == "local" else {}
        try:
            ray.init(address, log_to_driver=False, runtime_env=env, logging_level=logging.ERROR, **options)
        except (ConnectionError, ValueError, RuntimeError) as error:
            raise ConfigError(
                f"There is no Ray cluster at {address} ({str(error).splitlines()[0]}). Start one, ray start "
                f"--head, or give --address local.{_about_token()}"
            ) from error
        try:
            require_room(ray.cluster_resources(), address, cores, gpus)
        except ConfigError:
            ray.shutdown()
            raise

    def run(self, out: Path, tasks: Sequence[Task], heard: Heard) -> None:
        """Does the tasks side by side; one whose worker died is started again, up to `RETRIES` times."""
        import ray
        from ray.exceptions import RayError, RayTaskError

        ledger = Ledger(out)
        remote = ray.remote(num_cpus=self._cores, num_gpus=self._gpus, max_retries=RETRIES)(_run_on_worker)
        pending = {
            remote.remote(self._work, out.resolve(), Task(task.kind, task.folder, dict(task.inputs))): task
            for task in tasks
        }
        while pending:
            ready, _ = ray.wait(list(pending), num_returns=1, timeout=POLL_S)
            for one in ready:
                task = pending.pop(one)
                try:
                    problem = ray.get(one)
                except RayTaskError as error:
                    raise RuntimeError(f"{task.name}: {error}") from error
                except RayError as error:
                    problem = f"its worker died {RETRIES + 1} times: {str(error).splitlines()[0]}"
                if problem:
                    ledger.write(task, "failed", error=problem)
                heard(task)
            for task in pending.values():
                if ledger.record(task).state == "running":
                    heard(task)

    def close(self) -> None:
        """Leaves the cluster."""
        import ray

        ray.shutdown()


def require_room(have: Mapping[str, float], address: str, cores: int, gpus: float) -> None:
    """Raises ConfigError where a cluster could never do a task.  have: all of its cores and GPUs."""
    if have.get("CPU", 0) < cores or have.get("GPU", 0) < gpus:
        raise ConfigError(
            f"A task needs {cores} cores and {gpus:g} GPUs, but the cluster at {address} has "
            f"{have.get('CPU', 0):g} and {have.get('GPU', 0):g} in all. Ask for fewer: --cores, --gpus."
        )


def _about_token() -> str:
    """Advice about tokens: a cluster that asks for one gives the same error as one that is not there."""
    if os.environ.get("RAY_AUTH_MODE") == "token":
        return " If there is one, it may have another token than this machine's: see ~/.ray/auth_token."
    return (
        " If there is one, it may ask for a token, as newer versions of Ray do: set RAY_AUTH_MODE=token here "
        "and on every node, each with the head's ~/.ray/auth_token."
    )


def _require_server(address: str) -> None:
    """Raises ConfigError where nothing answers at a host and port: Ray would try for minutes."""
    host, _, port = address.rpartition(":")
    if "/" in host or not host or not port.isdigit():
        return
    try:
        socket.create_connection((host, int(port)), CONNECT_S).close()
    except OSError as error:
        raise ConfigError(
            f"There is no Ray cluster at {address} ({error}). Start one, ray start --head, or give --address "
            "local."
        ) from error


def _run_on_worker(work: Work, out: Path, task: Task) -> str:
    """What a worker does: a task; returns the text of an error that its input causes, or nothing."""
    Ledger(out).write(task, "running")
    try:
        work(out, task)
    except PlnerfError as error:
        return str(error)
    return ""
