"""A browser of the viewer without a browser: speaks viser's protocol, and keeps what it gets."""

import threading
import time
from collections.abc import Callable
from typing import Any

import msgspec.msgpack
import numpy as np
import viser
import zstandard
from websockets.exceptions import ConnectionClosed
from websockets.sync.client import connect

WAIT_S = 30.0


class ViewerClient:
    """Connects at once; `with` closes it."""

    def __init__(self, port: int, **headers: str) -> None:
        protocol = f"viser-v{viser.__version__}"
        self._socket = connect(
            f"ws://127.0.0.1:{port}",
            subprotocols=[protocol],
            max_size=None,
            compression=None,
            additional_headers=headers,
        )  # type: ignore[list-item]
        self.messages: list[dict[str, Any]] = []
        self._reader = threading.Thread(target=self._read, daemon=True)
        self._reader.start()

    def __enter__(self) -> "ViewerClient":
        return self

    def __exit__(self, *_: object) -> None:
        self._socket.close()

    def vanish(self) -> None:
        """As when the machine is unplugged: the connection ends without a word."""
        self._socket.socket.close()

    def _read(self) -> None:
        try:
            while True:
                self.messages += decoded(self._socket.recv(decode=False))
        except (ConnectionClosed, OSError, ValueError):
            return

    def send(self, type_: str, **fields: Any) -> None:
        self._socket.send(msgspec.msgpack.encode({"type": type_, **fields}))

    def look(self, position: np.ndarray, at: np.ndarray, width: int = 96, height: int = 64) -> None:
        """Its camera is at a place; the first such message makes it a client."""
        z = (at - position) / np.linalg.norm(at - position)
        x = np.cross(z, [0.0, 0.0, 1.0])
        x /= np.linalg.norm(x)
        R = viser.transforms.SO3.from_matrix(np.stack([x, np.cross(z, x), z], 1))
        self.send(
            "ViewerCameraMessage", wxyz=R.wxyz.tolist(), position=position.tolist(), fov=0.8, near=0.01,
            far=1000.0, image_height=height, image_width=width, look_at=at.tolist(),
            up_direction=[0.0, 0.0, 1.0],
        )  # fmt: skip

    def click(self, origin: np.ndarray, direction: np.ndarray) -> None:
        """Clicks the scene away from its nodes; as in a browser, once the page listens."""
        self.wait(lambda: any(one["modifiers"] for one in self.of("ScenePointerEnableMessage")), "listener")
        self.send(
            "ScenePointerMessage", event_type="click", ray_origin=origin.tolist(),
            ray_direction=direction.tolist(), screen_pos=[[0.5, 0.5]], modifier=None,
        )  # fmt: skip

    def of(self, type_: str) -> list[dict[str, Any]]:
        return [one for one in list(self.messages) if one["type"] == type_]

    def control(self, label: str) -> str:
        """The uuid of the control with a label, waited for."""

        def found() -> list[str]:
            rows = [one for one in list(self.messages) if isinstance(one.get("props"), dict)]
            return [one["uuid"] for one in rows if "uuid" in one and one["props"].get("label") == label]

        self.wait(lambda: bool(found()), f"a control {label!r}")
        return found()[-1]

    def choose(self, label: str, value: Any) -> None:
        self.send("GuiUpdateMessage", uuid=self.control(label), updates={"value": value})

    def texts(self) -> str:
        """All texts that the page was sent, in their order."""
        found = []
        for one in list(self.messages):
            for part in (one.get("props"), one.get("updates")):
                found += [str(value) for value in (part or {}).values() if isinstance(value, str)]
        return "\n".join(found)

    def nodes(self) -> set[str]:
        """Names of the nodes of its scene."""
        return {one["name"] for one in list(self.messages) if isinstance(one.get("name"), str)}

    def wait(self, done: Callable[[], bool], what: str, seconds: float = WAIT_S) -> None:
        end = time.monotonic() + seconds
        while not done():
            assert time.monotonic() < end, f"no {what} within {seconds} s; got {self.texts()[-2000:]}"
            time.sleep(0.01)


def decoded(data: bytes) -> list[dict[str, Any]]:
    """The messages of a packet, arrays in place of their placeholders."""
    packed = int.from_bytes(data[8:16], "little")
    head = zstandard.ZstdDecompressor().decompress(data[16 : 16 + packed], max_output_size=1 << 28)
    found = msgspec.msgpack.decode(head)
    at, arrays = 16 + packed, []
    for length in found["binaryBufferLengths"]:
        at += -at % 8
        arrays.append(data[at : at + length])
        at += length

    def filled(value: Any) -> Any:
        if isinstance(value, dict):
            if "__binary_index" in value:
                return np.frombuffer(arrays[value["__binary_index"]], value["dtype"])
            return {key: filled(one) for key, one in value.items()}
        return [filled(one) for one in value] if isinstance(value, list) else value

    messages: list[dict[str, Any]] = filled(found["messages"])
    return messages
