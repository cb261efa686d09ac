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
        hangs: reads nothing of what it is sent.
    """

    def __init__(self, address: str, hangs: bool = False) -> None:
        self.socket = connect(
            address.replace("http", "ws", 1),
            origin=Origin(address.split("/?")[0]),
            subprotocols=[Subprotocol(f"viser-v{viser.__version__}")],
            max_size=None,
            max_queue=1 if hangs else None,
            ping_interval=None,
        )
        self._lock = Lock()
        self._elements: dict[str, dict[str, Any]] = {}  # what each shows, by its id
        if not hangs:
            Thread(target=self._hear, daemon=True).start()
        zero = (0.0, 0.0, 0.0)
        camera = _messages.ViewerCameraMessage(
            (1.0, 0.0, 0.0, 0.0), zero, 1.0, 0.1, 10.0, 100, 100, zero, (0.0, 0.0, 1.0)
        )
        self.send(camera.as_serializable_dict([]))

    @property
    def elements(self) -> dict[str, dict[str, Any]]:
        """What stands on the page by its ids: type, value where it has one, and properties."""
        with self._lock:
            return {uuid: dict(element) for uuid, element in self._elements.items()}

    @property
    def inputs(self) -> dict[str, dict[str, Any]]:
        """Those of the elements that have a value: fields and buttons."""
        return {uuid: e for uuid, e in self.elements.items() if "value" in e and "label" in e}

    @property
    def text(self) -> str:
        """Everything that stands on the page as HTML."""
        return "\n".join(str(e["content"]) for e in self.elements.values() if "content" in e)

    def send(self, message: dict[str, Any]) -> None:
        self.socket.send(msgspec.msgpack.encode(message))

    def set(self, uuid: str, value: Any) -> None:
        self.send({"type": "GuiUpdateMessage", "uuid": uuid, "updates": {"value": value}})

    def named(self, label: str) -> str:
        """Return the id of what has a label."""
        return next(uuid for uuid, e in self.inputs.items() if e["label"] == label)

    def reach(self) -> None:
        """Wait for the server to answer a ping: it has read what was sent before.

        Raises:
            ConnectionClosed: it has ended the connection instead; with its reason.
            TimeoutError: it does not answer.
        """
        answered = self.socket.ping(ack_on_close=True).wait(60.0)
        self.socket.ping()  # raises where the connection is closed
        if not answered:
            raise TimeoutError("the server of the page has not answered a ping for a minute")

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
        uuid, kind = message.get("uuid"), message["type"]
        if not isinstance(uuid, str) or not kind.startswith("Gui"):
            return
        with self._lock:
            if "props" in message:
                value = {"value": message["value"]} if "value" in message else {}
                self._elements[uuid] = {"type": kind, **message["props"], **value}
            elif kind == "GuiUpdateMessage" and uuid in self._elements:
                self._elements[uuid] |= message["updates"]
            elif kind == "GuiRemoveMessage":
                self._elements.pop(uuid, None)
