"""What clients of the `live` node begin to listen to, and their parameters."""

from collections import deque
from typing import Any, Protocol

from flexslew_lab.ros.live.parameters import LiveParameters

READ_ONLY = "this server is read-only; start ./flexslew live --operate to command the bench"


class ServerNode(Protocol):
    """The node, as far as its server's threads may use it."""

    new_subscriptions: deque[str]  # topics with a new subscriber
    parameters: LiveParameters
    operate: bool  # clients may set parameters

    def library_parameters(self, values: dict[str, Any]) -> list[Any]:
        """Return parameters as the server's library takes them."""

    def refuse(self, words: str) -> None:
        """Send all clients the reason why a parameter was not set."""


class LiveListener:
    """Answers for a server; called from its threads.

    Args:
        live: the node that the server belongs to.
    """

    def __init__(self, live: ServerNode) -> None:
        self._live = live

    def on_subscribe(self, client: Any, channel: Any) -> None:
        """Take the topic of the channel."""
        self._live.new_subscriptions.append(channel.topic)

    def on_unsubscribe(self, client: Any, channel: Any) -> None:
        """Nothing to do."""

    def on_get_parameters(self, client: Any, names: list[str], request: str | None) -> list[Any]:
        """Return parameters by name; no names: all."""
        return self._live.library_parameters(self._live.parameters.values(names))

    def on_set_parameters(
        self, client: Any, requested: list[Any], request: str | None
    ) -> list[Any]:
        """Set parameters; report refusals as a status, and return the values that hold."""
        for parameter in requested:
            if not self._live.operate:
                self._live.refuse(READ_ONLY)
                break
            reason = self._live.parameters.set(parameter.name, parameter.get_value())
            if reason:
                self._live.refuse(reason)
        return self._live.library_parameters(
            self._live.parameters.values([p.name for p in requested])
        )

    def on_parameters_subscribe(self, names: list[str]) -> None:
        """Do nothing: changes are sent to all clients."""

    def on_parameters_unsubscribe(self, names: list[str]) -> None:
        """Nothing to do."""
