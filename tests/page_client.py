"""A page without a browser: it speaks the protocol of viser over its own connection."""

from threading import Lock, Thread
from typing import Any

import msgspec
import viser
import zstandard
from viser import _messages
from websockets.exceptions import ConnectionClosed
from websockets.sync.client import connect
from websockets.typing import Origin, Subprotocol


class PageClient:
    """Sends what a page may send, and knows the fields and buttons that it was told of.

    Args:
        address: of the page, with its token.
    """

    def __init__(self, address: str) -> None:
        self.socket = connect(
            address.replace("http", "ws", 1),
            origin=Origin(address.split("/?")[0]),
            subprotocols=[Subprotocol(f"viser-v{viser.__version__}")],
            max_size=None,
            max_queue=None,
        )
        self._lock = Lock()
        self._inputs: dict[str, tuple[str, str]] = {}  # uuid to kind and label
        Thread(target=self._hear, daemon=True).start()
        zero = (0.0, 0.0, 0.0)
        camera = _messages.ViewerCameraMessage(
            (1.0, 0.0, 0.0, 0.0), zero, 1.0, 0.1, 10.0, 100, 100, zero, (0.0, 0.0, 1.0)
        )
        self.send(camera.as_serializable_dict([]))

    @property
    def inputs(self) -> dict[str, tuple[str, str]]:
        """Fields and buttons of the page: kind and label by their ids."""
        with self._lock:
            return dict(self._inputs)

    def send(self, message: dict[str, Any]) -> None:
        self.socket.send(msgspec.msgpack.encode(message))

    def set(self, uuid: str, value: Any) -> None:
        self.send({"type": "GuiUpdateMessage", "uuid": uuid, "updates": {"value": value}})

    def named(self, label: str) -> str:
        """Return the id of what has a label."""
        return next(uuid for uuid, (_, name) in self.inputs.items() if name == label)

    def reach(self) -> None:
        """Wait for the server to answer a ping: it has read what was sent before."""
        assert self.socket.ping().wait(60.0)

    def _hear(self) -> None:
        decompress = zstandard.ZstdDecompressor().decompress
        try:
            for data in self.socket:
                assert isinstance(data, bytes)
                size = int.from_bytes(data[8:16], "little")
                for message in msgspec.msgpack.decode(decompress(data[16 : 16 + size]))["messages"]:
                    self._take(message)
        except ConnectionClosed:
            return

    def _take(self, message: dict[str, Any]) -> None:
        label = (message.get("props") or {}).get("label")
        with self._lock:
            if label is not None and "value" in message:
                self._inputs[message["uuid"]] = message["type"], str(label)
            elif message["type"] == "GuiRemoveMessage":
                self._inputs.pop(message["uuid"], None)
