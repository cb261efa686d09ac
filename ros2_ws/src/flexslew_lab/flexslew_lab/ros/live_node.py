"""The `live` node: a Foxglove WebSocket server on this machine that shows the bench as it runs."""

from collections import deque
from collections.abc import Callable
from functools import partial
from time import monotonic
from typing import Annotated, Any

from pydantic import Field

from flexslew_lab.console.live_gate import LiveGate
from flexslew_lab.ros.live.channels import LiveChannels
from flexslew_lab.ros.live.listener import LiveListener
from flexslew_lab.ros.live.parameters import LiveParameters
from flexslew_lab.ros.live.services import LiveServices
from flexslew_plant.errors import BadInput
from flexslew_plant.extras import install_command
from flexslew_plant.ros.loop import Loop
from flexslew_plant.ros.node_process import namespace_arguments, run_node
from flexslew_plant.ros.parameters import new_node, settings_of
from flexslew_plant.settings import section

_REFRESH = 0.05  # period at which clients receive the simulated time [wall s]


@section
class LiveSettings:
    """The parameters of the node."""

    port: Annotated[int, Field(ge=0, le=65535)] = 8765  # 0: any free one
    operate: bool = False  # clients may command the bench, else they only watch
    origins: tuple[str, ...] = ()  # of pages that may connect, besides Foxglove's own


class LiveNode:
    """Topics, services and parameters of the bench for the clients of the server.

    Args:
        settings: None: the parameters of the node.
        notify: called with the address of the server.
        loop: loop that serves the node.

    Raises:
        BadInput: the server's library is not installed, or the port is taken.
    """

    def __init__(
        self, settings: LiveSettings | None, notify: Callable[[str], None], loop: Loop
    ) -> None:
        try:
            import foxglove
        except ImportError:
            needed = f"live needs the package foxglove-sdk: {install_command('foxglove')}"
            raise BadInput(needed) from None
        self.node = node = new_node("live")
        loop.live(node, "live")
        options: LiveSettings = settings or settings_of(node, LiveSettings)
        self._notify, self.operate = notify, options.operate
        self._gate = LiveGate(options.port, options.origins)
        self._websocket = foxglove.websocket
        self._context = context = foxglove.Context()  # its channels close with it
        self.new_subscriptions: deque[str] = deque()  # topics with a new subscriber
        self.parameters = LiveParameters(node)
        self._services = LiveServices(node, foxglove)
        capability = self._websocket.Capability
        try:
            self._server = foxglove.start_server(
                name="flexslew",
                host=self._gate.server_host,
                port=0,
                capabilities=[capability.Time, capability.Parameters]
                + [capability.Services] * options.operate,
                supported_encodings=["json"],
                services=self._services.all_services() if options.operate else [],
                context=context,
                server_listener=LiveListener(self),
            )
        except Exception as error:  # a type of its own below the binding
            raise BadInput(f"live: the server does not start: {error}") from None
        self._channels = LiveChannels(node, foxglove, context)
        self._last_time = -1  # what the clients think the simulated time is [ns]
        self._gate.open(self._server.port)
        access = "watches and commands" if options.operate else "watches"
        notify(f"open {self._gate.address} in Foxglove, which {access} the bench; Ctrl-C ends it")

    def poll(self) -> float:
        """Send the time and all changes; return when to poll again [wall s]."""
        now = monotonic()
        self._services.poll(now, self._server.add_services if self.operate else None)
        for origin in self._gate.rejected_origins():
            self._notify(f"refused a page of {origin!r:.100}; --origin lets its origin in")
        changed = self.parameters.poll(now)
        if changed:
            self._server.publish_parameter_values(self.library_parameters(changed))
        if self.new_subscriptions or self._channels.now != self._last_time:
            self._last_time = self._channels.now
            self._server.broadcast_time(self._last_time)  # else a client plots over its own clock
        while self.new_subscriptions:
            self._channels.send_stored(self.new_subscriptions.popleft())
        return _REFRESH

    def close(self) -> None:
        """End the server."""
        self._gate.close()
        self._server.stop()

    def leave(self) -> None:
        """Leave the graph."""
        self._services.close()

    def library_parameters(self, values: dict[str, Any]) -> list[Any]:
        """Return parameters as the server's library takes them."""
        return [self._websocket.Parameter(name, value=value) for name, value in values.items()]

    def refuse(self, words: str) -> None:
        """Send all clients the reason why a parameter was not set."""
        self._server.publish_status(words, self._websocket.StatusLevel.Error, "parameters")


def live(settings: LiveSettings, notify: Callable[[str], None], namespace: str = "") -> None:
    """Serve the bench of a namespace from this process until it is interrupted, then exit."""
    run_node(partial(LiveNode, settings, notify), args=namespace_arguments(namespace))


def main() -> None:
    """Run the node with the parameters of LiveSettings."""
    run_node(partial(LiveNode, None, partial(print, flush=True)))


if __name__ == "__main__":
    main()
