"""The command: says where it is, ends when it is told to, and says what is missing."""

import socket
import sys
import threading
from pathlib import Path
from typing import Any

import pytest

import plnerf.cli.view as command
from plnerf.cli.main import main
from plnerf.cli.stop import Terminated
from plnerf.errors import ConfigError


def test_without_the_extra_it_says_what_to_install(
    monkeypatch: pytest.MonkeyPatch, tiny_scene: Path
) -> None:
    monkeypatch.setattr(command, "find_spec", lambda name: None)
    with pytest.raises(ConfigError, match=r'not installed. Run: pip install "plnerf\[view\]"'):
        command.view(tiny_scene)


needs_viser = pytest.mark.skipif(command.find_spec("viser") is None, reason="plnerf[view] is not installed")


def run(arguments: list[str], monkeypatch: pytest.MonkeyPatch) -> int:
    monkeypatch.setattr(sys, "argv", ["plnerf", "view", *arguments])
    try:
        main()
    except SystemExit as ended:
        return int(ended.code or 0)
    return 0


@needs_viser
def test_it_says_its_address_and_ends_by_itself(
    monkeypatch: pytest.MonkeyPatch, tiny_scene: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    with socket.create_server(("127.0.0.1", 0)) as free:
        port = free.getsockname()[1]
    assert run([str(tiny_scene), "--port", str(port), "--seconds", "0.05"], monkeypatch) == 0
    said = capsys.readouterr()
    assert said.out.splitlines() == [f"Open http://127.0.0.1:{port} in a browser. Ctrl-C ends it."]
    with pytest.raises(OSError):
        socket.create_connection(("127.0.0.1", port), timeout=2).close()


@needs_viser
@pytest.mark.parametrize(("stop", "status"), [(KeyboardInterrupt, 0), (Terminated, 143)])
def test_ctrl_c_ends_it_well(
    stop: type[BaseException], status: int, monkeypatch: pytest.MonkeyPatch, tiny_scene: Path
) -> None:
    class Interrupted(threading.Event):
        def wait(self, timeout: float | None = None) -> bool:
            raise stop

    class Threading:
        Event: Any = Interrupted

    monkeypatch.setattr(command, "threading", Threading)
    assert run([str(tiny_scene), "--port", "0"], monkeypatch) == status


@needs_viser
@pytest.mark.parametrize("seconds", [float("nan"), float("inf"), -1.0])
def test_seconds_that_are_none_are_refused(seconds: float, tiny_scene: Path) -> None:
    with pytest.raises(ConfigError, match="--seconds must be 0 or more and finite"):
        command.view(tiny_scene, seconds=seconds)


@needs_viser
def test_a_taken_port_is_named(
    monkeypatch: pytest.MonkeyPatch, tiny_scene: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    with socket.create_server(("127.0.0.1", 0)) as taken:
        port = taken.getsockname()[1]
        assert run([str(tiny_scene), "--port", str(port)], monkeypatch) == 1
    assert f"The port {port} of 127.0.0.1 cannot be opened" in capsys.readouterr().err
