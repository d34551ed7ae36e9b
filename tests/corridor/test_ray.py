"""Blocks on a Ray cluster: workers that die are replaced, a driver that dies loses nothing that was done.

Work that stands in for real tasks is defined inside of functions, so that it goes to the workers by value.
"""

import os
import signal
import subprocess
import sys
import time
from collections import Counter
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

from plnerf.corridor.engine import OnRay, require_room
from plnerf.corridor.ledger import Ledger, Task
from plnerf.errors import ConfigError, SurveyError

ray = pytest.importorskip("ray", reason='Ray is not installed: pip install "plnerf[cluster]"')
TASKS = [Task("find", f"find/{k:04d}", {"k": k}) for k in range(6)]


def noted(seconds: float = 0.0) -> Callable[[Path, Task], None]:
    """Work that notes in a file of its own which process did it."""

    def work(out: Path, task: Task) -> None:
        time.sleep(seconds)
        (out / f"{task.name}-{os.getpid()}-{time.monotonic_ns()}.did").touch()
        Ledger(out).write(task, "done")

    return work


def did(out: Path) -> Counter[str]:
    return Counter("-".join(path.name.split("-")[:3]) for path in out.glob("*.did"))


@pytest.fixture
def two_nodes() -> Iterator[str]:
    """The address of a cluster of two nodes, which are processes of their own, with one core each."""
    from ray.cluster_utils import Cluster

    cluster = Cluster(initialize_head=True, head_node_args={"num_cpus": 1, "include_dashboard": False})
    cluster.add_node(num_cpus=1)
    cluster.wait_for_nodes()
    yield cluster.address
    ray.shutdown()
    cluster.shutdown()


@pytest.mark.slow
def test_two_nodes_do_every_task_once_and_a_dead_worker_is_replaced(two_nodes: str, tmp_path: Path) -> None:
    def work(out: Path, task: Task) -> None:
        import ray

        if task.inputs["k"] == 2 and not (out / "killed").exists():
            (out / "killed").touch()
            os.kill(os.getpid(), signal.SIGKILL)
        time.sleep(0.5)
        (out / f"{ray.get_runtime_context().get_node_id()}.node").touch()
        (out / f"{task.name}-{os.getpid()}-{time.monotonic_ns()}.did").touch()
        Ledger(out).write(task, "done")

    engine = OnRay(two_nodes, 1, work=work)
    heard: list[str] = []
    engine.run(tmp_path, TASKS, lambda task: heard.append(task.name))
    assert (tmp_path / "killed").exists()
    assert did(tmp_path) == dict.fromkeys((task.name for task in TASKS), 1)
    assert {task.name for task in TASKS} <= set(heard)
    assert len(list(tmp_path.glob("*.node"))) == 2

    def failing(out: Path, task: Task) -> None:
        raise SurveyError("a photo is damaged")

    engine._work = failing
    engine.run(tmp_path, TASKS[:1], lambda task: None)
    assert Ledger(tmp_path).record(TASKS[0]).error == "a photo is damaged"


def test_an_address_without_a_cluster() -> None:
    with pytest.raises(ConfigError, match=r"no Ray cluster at 127\.0\.0\.1:1"):
        OnRay("127.0.0.1:1")


@pytest.mark.parametrize(("cores", "gpus"), [(3, 0.0), (1, 0.5)])
def test_more_than_there_is(cores: int, gpus: float) -> None:
    with pytest.raises(ConfigError, match=f"A task needs {cores} cores and {gpus:g} GPUs"):
        require_room({"CPU": 2.0, "memory": 1e9}, "auto", cores, gpus)


DRIVER = """
import sys, time
from pathlib import Path
sys.path.insert(0, {tests!r})
from tests.corridor.test_ray import TASKS, noted
from plnerf.corridor.engine import OnRay
from plnerf.corridor.ledger import Ledger
out = Path(sys.argv[1])
engine = OnRay("local", 1, work=noted(1.0))
engine.run(out, [task for task in TASKS if not Ledger(out).done(task)], lambda task: None)
engine.close()
"""


@pytest.mark.slow
def test_a_killed_driver_loses_nothing_that_was_done(tmp_path: Path) -> None:
    code = DRIVER.format(tests=str(Path(__file__).resolve().parents[2]))
    first = subprocess.Popen([sys.executable, "-c", code, str(tmp_path)])
    begin = time.monotonic()
    while not did(tmp_path) and time.monotonic() - begin < 120:
        time.sleep(0.1)
    first.send_signal(signal.SIGKILL)
    first.wait()
    time.sleep(3.0)  # what its workers had begun may still end
    before = did(tmp_path)
    done = [task for task in TASKS if Ledger(tmp_path).done(task)]
    assert 0 < len(done) < len(TASKS)
    subprocess.run([sys.executable, "-c", code, str(tmp_path)], check=True, timeout=180)
    assert all(Ledger(tmp_path).done(task) for task in TASKS)
    after = did(tmp_path)
    assert {task.name: after[task.name] for task in done} == {task.name: before[task.name] for task in done}
