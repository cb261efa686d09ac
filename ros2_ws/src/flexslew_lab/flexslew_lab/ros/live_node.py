"""The `live` node: a Foxglove WebSocket server on this machine that shows the bench as it runs."""

from collections import deque
from collections.abc import Callable
from functools import partial
from time import monotonic
from typing import Annotated, Any

from pydantic import Field

from flexslew_lab.ros.live_channels import LiveChannels
from flexslew_lab.ros.live_parameters import LiveParameters
from flexslew_lab.ros.live_services import LiveServices
from flexslew_plant.errors import BadInput
from flexslew_plant.ros.loop import Loop
from flexslew_plant.ros.node_process import run_node, within
from flexslew_plant.ros.parameters import new_node, settings_of
from flexslew_plant.settings import section

_REFRESH = 0.05  # how often clients hear the simulated time [wall s]
HOST = "127.0.0.1"  # never another one: nobody is asked for a password


@section
class LiveSettings:
    """The parameters of the node."""

    port: Annotated[int, Field(ge=0, le=65535)] = 8765  # 0: any free one


class _Listener:
    """What clients begin to listen to, and their parameters; called from the server's threads."""

    def __init__(self, live: "LiveNode") -> None:
        self._live = live

    def on_subscribe(self, client: Any, channel: Any) -> None:
        """Take the topic of the channel."""
        self._live.newcomers.append(channel.topic)

    def on_unsubscribe(self, client: Any, channel: Any) -> None:
        """Nothing to do."""

    def on_get_parameters(self, client: Any, names: list[str], request: str | None) -> list[Any]:
        """Return parameters by name; no names: all."""
        return self._live.shown(self._live.parameters.values(names))

    def on_set_parameters(self, client: Any, wanted: list[Any], request: str | None) -> list[Any]:
        """Set parameters; what is refused is told as a status, and what holds is returned."""
        for parameter in wanted:
            refused = self._live.parameters.set(parameter.name, parameter.get_value())
            if refused:
                self._live.refuse(refused)
        return self._live.shown(self._live.parameters.values([p.name for p in wanted]))

    def on_parameters_subscribe(self, names: list[str]) -> None:
        """Nothing to do: changes are told to all."""

    def on_parameters_unsubscribe(self, names: list[str]) -> None:
        """Nothing to do."""


class LiveNode:
    """Topics, services and parameters of the bench for the clients of the server.

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
        loop.live(node, "live")
        chosen: LiveSettings = settings or settings_of(node, LiveSettings)
        self._websocket = foxglove.websocket
        self._context = context = foxglove.Context()  # its channels close with it
        self.newcomers: deque[str] = deque()  # topics that somebody has begun to listen to
        self.parameters = LiveParameters(node)
        self._services = LiveServices(node, foxglove)
        capability = self._websocket.Capability
        try:
            self._server = foxglove.start_server(
                name="flexslew",
                host=HOST,
                port=chosen.port,
                capabilities=[capability.Time, capability.Services, capability.Parameters],
                supported_encodings=["json"],
                services=self._services.offered(),
                context=context,
                server_listener=_Listener(self),
            )
        except Exception as error:  # a type of its own below the binding
            raise BadInput(f"live: port {chosen.port} cannot be opened: {error}") from None
        self._channels = LiveChannels(node, foxglove, context)
        self._told = -1  # what the clients think the simulated time is [ns]
        say(f"open ws://{HOST}:{self._server.port} in Foxglove; Ctrl-C ends it")

    def poll(self) -> float:
        """Tell the time and what has changed; return when to look again [wall s]."""
        now = monotonic()
        self._services.poll(now, self._server.add_services)
        changed = self.parameters.poll(now)
        if changed:
            self._server.publish_parameter_values(self.shown(changed))
        if self.newcomers or self._channels.now != self._told:
            self._told = self._channels.now
            self._server.broadcast_time(self._told)  # else a client plots over its own clock
        while self.newcomers:
            self._channels.welcome(self.newcomers.popleft())
        return _REFRESH

    def close(self) -> None:
        """End the server."""
        self._server.stop()
        self._services.close()

    def shown(self, values: dict[str, Any]) -> list[Any]:
        """Return parameters as the server's library takes them."""
        return [self._websocket.Parameter(name, value=value) for name, value in values.items()]

    def refuse(self, words: str) -> None:
        """Tell all clients why a parameter was not set."""
        self._server.publish_status(words, self._websocket.StatusLevel.Error, "parameters")


def live(port: int, say: Callable[[str], None], namespace: str = "") -> None:
    """Serve the bench of a namespace from this process until it is interrupted, then exit."""
    run_node(partial(LiveNode, LiveSettings(port=port), say), args=within(namespace))


def main() -> None:
    """Run the node with the parameters of LiveSettings."""
    run_node(partial(LiveNode, None, print))


if __name__ == "__main__":
    main()
