"""A viewer of the live page that draws nothing: implements a browser's side of the protocol."""

from __future__ import annotations

import time
from collections.abc import Mapping
from typing import Any, Self

import msgspec
import viser
import zstandard
from websockets.sync.client import connect
from websockets.typing import Subprotocol

from tests.patience import PATIENCE_S

CAMERA: Mapping[str, Any] = {
    "type": "ViewerCameraMessage",
    "wxyz": (1.0, 0.0, 0.0, 0.0),
    "position": (1.0, 1.0, 1.0),
    "fov": 1.0,
    "near": 0.01,
    "far": 100.0,
    "image_height": 900,
    "image_width": 1440,
    "look_at": (0.0, 0.0, 0.0),
    "up_direction": (0.0, 0.0, 1.0),
}


class Viewer:
    """One connection.

    Args:
        url: of the page, as it is printed.
        headers: further ones, such as a foreign Origin.
    """

    def __init__(self, url: str, **headers: str) -> None:
        self._socket = connect(
            url.replace("http", "ws", 1),
            subprotocols=[Subprotocol(f"viser-v{viser.__version__}")],
            additional_headers=headers,
            compression=None,
            max_size=None,
            open_timeout=PATIENCE_S,
        )
        self.labels: dict[str, str] = {}
        """Labels of the known controls, by uuid."""
        self.say(CAMERA)

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self._socket.close()

    def say(self, message: Mapping[str, Any] | bytes | str) -> None:
        """Sends anything."""
        if isinstance(message, Mapping):
            message = msgspec.msgpack.encode(message)
        self._socket.send(message)

    def set(self, uuid: str, **properties: object) -> None:
        """What a control says when it is used, and what it never says."""
        self.say({"type": "GuiUpdateMessage", "uuid": uuid, "updates": properties})

    def press(self, label: str) -> None:
        """A button, once it is there."""
        self.set(self.control(label), value=True)

    def control(self, label: str) -> str:
        """Its uuid, once it is there under this label."""
        deadline_s = time.monotonic() + PATIENCE_S
        while label not in self.labels.values():
            assert time.monotonic() < deadline_s, f"{label} is not among {self.labels}"
            self.hear()
        return next(uuid for uuid, one in self.labels.items() if one == label)

    def receive(self) -> bytes:
        """What the page sends next, as it comes."""
        data = self._socket.recv(timeout=PATIENCE_S)
        assert isinstance(data, bytes)
        return data

    def hear(self) -> None:
        """Take in what the page sends next."""
        data = self.receive()
        length, packed = (int.from_bytes(data[i : i + 8], "little") for i in (0, 8))
        plain = zstandard.ZstdDecompressor().decompress(data[16 : 16 + packed], length)
        for message in msgspec.msgpack.decode(plain)["messages"]:
            properties = message.get("props", {}) | message.get("updates", {})
            if "label" in properties:
                self.labels[message["uuid"]] = properties["label"]
