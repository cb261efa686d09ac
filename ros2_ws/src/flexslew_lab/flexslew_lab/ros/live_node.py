"""The `live` node: a Foxglove WebSocket server on this machine that shows the bench as it runs."""

from collections import deque
from collections.abc import Callable
from functools import partial
from time import monotonic
from typing import Annotated, Any

from pydantic import Field

from flexslew_lab.log.bag_layout import TOPICS
from flexslew_lab.log.messages.cdr import stamp_of
from flexslew_lab.log.messages.schemas import schema_text
from flexslew_lab.ros.live_services import LiveServices
from flexslew_plant.errors import BadInput
from flexslew_plant.ros.loop import Loop, run_node, within
from flexslew_plant.ros.offers import SEVERAL, message_class, qos
from flexslew_plant.ros.parameters import new_node, settings_of
from flexslew_plant.settings import section

_REFRESH = 0.05  # how often clients hear the simulated time [wall s]
_CLOCKS = {"/clock", "/measurement", "/truth"}  # the plant's own: each rises until a reset
HOST = "127.0.0.1"  # never another one: nobody is asked for a password


@section
class LiveSettings:
    """The parameters of the node."""

    port: Annotated[int, Field(ge=0, le=65535)] = 8765  # 0: any free one


class _Listener:
    """Notes the topics that a client begins to listen to; called from the server's threads."""

    def __init__(self, newcomers: deque[str]) -> None:
        self._newcomers = newcomers

    def on_subscribe(self, client: Any, channel: Any) -> None:
        """Take the topic of the channel."""
        self._newcomers.append(channel.topic)

    def on_unsubscribe(self, client: Any, channel: Any) -> None:
        """Nothing to do."""


class LiveNode:
    """Forwards the serialised messages with their schemas; reads none of them but for the time.

    Args:
        settings: None: the parameters of the node.
        say: told where the server listens.
        loop: that serves the node.

    Raises:
        BadInput: the server's library is not installed, or the port is taken.
    """

    def __init__(
        self, settings: LiveSettings | None, say: Callable[[str], None], loop: Loop
    ) -> None:
        try:
            import foxglove
        except ImportError:
            raise BadInput("live: needs the package foxglove-sdk; pip install it") from None
        self.node = node = new_node("live")
        loop.add(node)
        chosen: LiveSettings = settings or settings_of(node, LiveSettings)
        self._newcomers: deque[str] = deque()  # topics that somebody has begun to listen to
        self._latched: dict[str, deque[tuple[bytes, int]]] = {}  # with log times
        self._channels: dict[str, Any] = {}
        self._services = LiveServices(node)
        self._context = context = foxglove.Context()  # its channels close with it
        offers = foxglove.websocket.Capability
        try:
            self._server = foxglove.start_server(
                name="flexslew",
                host=HOST,
                port=chosen.port,
                capabilities=[offers.Time, offers.Services],
                supported_encodings=["json"],
                services=self._services.offered(foxglove),
                context=context,
                server_listener=_Listener(self._newcomers),
            )
        except Exception as error:  # a type of its own below the binding
            raise BadInput(f"live: port {chosen.port} cannot be opened: {error}") from None
        self._last = 0  # simulated time of the last message [ns]
        self._stamps = dict.fromkeys(_CLOCKS, 0)  # of their last messages [ns]
        self._now, self._told = 0, -1  # simulated time: of the bench, as clients know it [ns]
        for topic, known in TOPICS.items():
            text = schema_text(known.type).encode()
            self._channels[topic] = foxglove.Channel(
                topic,
                schema=foxglove.Schema(name=known.type, encoding="ros2msg", data=text),
                message_encoding="cdr",
                context=context,
            )
            if known.latched:
                self._latched[topic] = deque(maxlen=max(known.depth, SEVERAL))
            node.create_subscription(
                message_class(known.type),
                known.name,
                partial(self._forward, topic, known.type),
                qos(known, SEVERAL if known.latched else 0),
                raw=True,
            )
        say(f"open ws://{HOST}:{self._server.port} in Foxglove; Ctrl-C ends it")

    def poll(self) -> float:
        """Tell the time, and newcomers what is latched; return when to look again [wall s]."""
        self._services.poll(monotonic())
        if self._newcomers or self._now != self._told:
            self._told = self._now
            self._server.broadcast_time(self._now)  # else a client plots over its own clock
        while self._newcomers:
            topic = self._newcomers.popleft()
            for data, time in self._latched.get(topic, ()):
                self._channels[topic].log(data, log_time=time)
        return _REFRESH

    def close(self) -> None:
        """End the server."""
        self._server.stop()
        self._services.close()

    def _forward(self, topic: str, kind: str, data: bytes) -> None:
        self._last = stamp_of(kind, data, self._last)
        self._channels[topic].log(data, log_time=self._last)
        if topic in self._latched:
            self._latched[topic].append((data, self._last))
        elif topic in _CLOCKS:
            if self._last > self._now or self._last < self._stamps[topic]:
                self._now = self._last
            self._stamps[topic] = self._last


def live(port: int, say: Callable[[str], None], namespace: str = "") -> None:
    """Serve the bench of a namespace from this process until it is interrupted, then exit."""
    run_node(partial(LiveNode, LiveSettings(port=port), say), args=within(namespace))


def main() -> None:
    """Run the node with the parameters of LiveSettings."""
    run_node(partial(LiveNode, None, print))


if __name__ == "__main__":
    main()
