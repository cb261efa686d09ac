"""A page without a browser: it speaks the protocol of NiceGUI over its own connection."""

import html
import json
import re
from http.client import HTTPConnection
from threading import Condition, Thread
from typing import Any
from urllib.parse import urlencode, urlsplit

from websockets.exceptions import ConnectionClosed
from websockets.sync.client import connect
from websockets.typing import Origin

_VALUES = ("value", "model-value")
_EVENTS = ("update:modelValue", "update:value", "click")


class PageClient:
    """Sends what a page may send, and knows the fields and buttons that it was told of.

    Args:
        address: of the page, with its token.
        hangs: reads nothing of what it is sent.
    """

    def __init__(self, address: str, hangs: bool = False) -> None:
        url = urlsplit(address)
        connection = HTTPConnection(url.netloc, timeout=60.0)
        connection.request("GET", f"/?{url.query}")
        answer = connection.getresponse()
        page, cookie = answer.read().decode(), answer.headers["Set-Cookie"].partition(";")[0]
        connection.close()
        whole = re.search(r"parseElements\(String\.raw`(.*?)`\)", page, re.DOTALL)
        number = re.search(r"'client_id': '([^']+)'", page)
        assert whole is not None
        assert number is not None
        self._client = number[1]
        self._elements: dict[str, dict[str, Any]] = json.loads(html.unescape(whole[1]))
        query = urlencode(
            {
                "client_id": self._client, "next_message_id": 0, "implicit_handshake": "true",
                "document_id": self._client, "tab_id": self._client, "EIO": 4,
                "transport": "websocket",
            }
        )  # fmt: skip
        self.socket = connect(
            f"ws://{url.netloc}/_nicegui_ws/socket.io/?{query}",
            origin=Origin(f"http://{url.netloc}"), additional_headers={"Cookie": cookie},
            max_size=None, max_queue=1 if hangs else None, ping_interval=None,
        )  # fmt: skip
        self._news = Condition()
        assert str(self.socket.recv(60.0)).startswith("0")  # the server opens
        self.socket.send("40")
        if not hangs:
            Thread(target=self._hear, daemon=True).start()

    @property
    def elements(self) -> dict[str, dict[str, Any]]:
        """What stands on the page by its ids."""
        with self._news:
            return dict(self._elements)

    @property
    def inputs(self) -> dict[str, dict[str, Any]]:
        """Fields and buttons: label, kind, value and, of a list, options."""
        return {uuid: found for uuid, e in self.elements.items() if (found := _input(e))}

    @property
    def text(self) -> str:
        """Everything that stands on the page as HTML."""
        return "\n".join(
            str(e.get("props", {}).get("innerHTML", "")) for e in self.elements.values()
        )

    def emit(self, event: str, values: Any) -> None:
        """Send an event of the protocol."""
        self.socket.send(f"42{json.dumps([event, values])}")

    def set(self, uuid: str, value: Any) -> None:
        """Press a button, or write into a field; into a list the text of its option."""
        element = self.elements.get(uuid, {})
        found = _input(element) or {"listener": "nobody", "kind": "text", "options": ()}
        arguments: Any = value
        if found["kind"] == "choice":
            names = list(found["options"])
            number = names.index(value) if value in names else 99
            arguments = {"value": number, "label": str(value)}
        sent = [] if found["kind"] == "button" else [json.dumps(arguments)]
        self.emit(
            "event",
            {"id": int(uuid) if uuid.isdigit() else -1, "client_id": self._client,
             "listener_id": found["listener"], "args": sent},
        )  # fmt: skip

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
        try:
            for data in self.socket:
                if data == "2":  # a ping
                    self.socket.send("3")
                elif str(data).startswith("42"):
                    self._take(*json.loads(str(data)[2:])[:2])
        except ConnectionClosed:
            return

    def _take(self, event: str, values: Any) -> None:
        with self._news:
            if event == "update":
                for uuid, element in values.items():
                    if uuid == "_id":
                        continue
                    if element is None:
                        self._elements.pop(uuid, None)
                    else:
                        self._elements[uuid] = element


def _input(element: dict[str, Any]) -> dict[str, Any] | None:
    """Return a field or a button as label, kind, value, options and the listener of its event."""
    props, tag = element.get("props", {}), element.get("tag", "")
    listeners = [e["listener_id"] for e in element.get("events", ()) if e["type"] in _EVENTS]
    label = props.get("aria-label") or props.get("label") or element.get("text")
    if not listeners or not isinstance(label, str) or tag in ("q-tabs", "q-tab-panels"):
        return None
    kind = {"q-btn": "button", "nicegui-select": "choice"}.get(tag, "text")
    value = next((props[name] for name in _VALUES if name in props), None)
    options = [one["label"] for one in props.get("options", ())] if kind == "choice" else []
    shown = "hidden" not in element.get("class", ())
    value = value["label"] if isinstance(value, dict) and "label" in value else value
    return {"label": label, "kind": kind, "value": value, "options": options, "visible": shown,
            "listener": listeners[0]}  # fmt: skip
