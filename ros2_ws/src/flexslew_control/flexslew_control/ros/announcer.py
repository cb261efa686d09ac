"""The status of a controller that its node announces: its identity and its readiness."""

from collections.abc import Sequence
from math import inf
from time import monotonic

from flexslew_msgs import msg
from rclpy.duration import Duration
from rclpy.node import Node

from flexslew_control.controllers import settings_text
from flexslew_control.controllers.host import ControllerHost
from flexslew_control.message_fields import status_fields
from flexslew_control.ros.answering import AnswerServer
from flexslew_control.ros.turn import INACTIVE
from flexslew_plant.graph import topics
from flexslew_plant.refusal import Cause, Refusal
from flexslew_plant.ros.alive import Alive
from flexslew_plant.ros.graph import missing_listeners, publishers_of
from flexslew_plant.ros.messages import stamp
from flexslew_plant.ros.offers import publisher

_STATUS_PERIOD = 100  # ticks between two statuses
_ACKNOWLEDGE_TIMEOUT = 5.0  # for a listener that takes nothing [wall s]


class StatusPublisher:
    """Publishes a status whenever it changes, and while the controller works.

    Args:
        node: node of the controller.
        host: host of the controller.
        law: name of its law.
        alive: heartbeats, to detect other nodes of its name.
        answering: publishes the commands and states, which must have listeners.
        listeners: nodes that must receive what is sent, in addition to the plant.
    """

    def __init__(
        self,
        node: Node,
        host: ControllerHost,
        law: str,
        alive: Alive,
        answering: AnswerServer,
        listeners: Sequence[str],
    ) -> None:
        self._node, self._host, self._law, self._alive = node, host, law, alive
        self._answering, self._listeners = answering, listeners
        self._status = publisher(node, topics.CONTROLLER_STATUS)
        self.previous: Refusal | None = None  # why this one is silent for another one of its name
        self.has_status = False
        self.reason: Refusal | None = None  # as announced
        self._is_connected = False
        self._acknowledge_until = inf  # then the status counts as received [wall s]
        self._settings, self._pending = "", host.due
        self._tick = 0  # of the last status

    def look(self) -> None:
        """Check the graph and announce what has changed.

        While an older node of the same name is alive this one publishes nothing: the bench could
        not distinguish the two.
        """
        before, self.previous = self.previous, self._alive.previous
        if self.previous and not before:
            self._node.get_logger().error(f"{self.previous}; {INACTIVE}")
        self.notify(always=bool(before and not self.previous))

    def describe(self, new_bench: bool = False) -> None:
        """Announce what is computed from the settings that hold now."""
        host = self._host
        self._is_connected = self._is_connected and not new_bench
        if host.controller is not None:
            self._pending = host.due
            self._settings = settings_text(host.controller, self._law, host.values, host.due)
        self.notify(always=True)

    def seen(self, tick: int) -> None:
        """Announce at intervals that it keeps up."""
        if self._host.due != self._pending:  # those of a flight that is over are dropped
            self.describe()
        elif tick >= self._tick + _STATUS_PERIOD or tick == 0:
            self.notify(always=True)

    def notify(self, always: bool = False) -> None:
        """Publish the status if it is another one than the last, or always."""
        reason = self._reason()
        if (self.has_status and reason == self.reason and not always) or self.previous:
            return
        host = self._host
        self.has_status, self.reason, self._tick = True, reason, host.last_tick
        period = host.controller.period if host.controller else 0.0
        self._status.publish(
            msg.ControllerStatus(
                stamp=stamp(host.last_tick * period),
                instance=self._alive.heartbeat.instance,
                **status_fields(host, self._law, reason, self._settings),
            )
        )

    def _reason(self) -> Refusal | None:
        """Return why the controller could not become active now, by the data of its node."""
        why = self.previous or self._host.reason
        if why is not None or not (missing := self.missing_listeners()):
            return why
        return Refusal(f"not received by {', '.join(missing)}", cause=Cause.NOT_HEARD)

    def missing_listeners(self) -> list[str]:
        """Return the nodes that must receive its messages, and do not yet."""
        if self._is_connected:
            return []
        subscription = self._answering.received  # None: questions come another way
        plant = publishers_of(self._node, subscription) if subscription else set()
        # a publisher there that is not a plant, as a bag that is played, takes no answers
        plant = plant & set(self._alive.heartbeats.of_role("plant")) or plant
        commands, states = (channel.publisher for channel in self._answering.publishers)
        missing = missing_listeners(self._node, [commands], [*plant, *self._listeners])
        missing += missing_listeners(self._node, [states, self._status], self._listeners)
        if not missing and self._listeners and not self._is_acknowledged():
            missing = [f"a subscriber of {self._status.topic_name}"]
        self._is_connected = bool(plant or subscription is None) and not missing
        if self._is_connected:
            self._acknowledge_until = inf
        return [] if self._is_connected else sorted(set(missing)) or ["a plant"]

    def _is_acknowledged(self) -> bool:
        """Return whether the listeners have acknowledged the status.

        A publisher knows a listener before the listener knows the publisher, on a busy machine
        long before: what a process sends meanwhile is lost if it is killed. Fast DDS announces the
        publishers of a process in the order in which they were made, and that of the status is
        the last one: whoever acknowledges a status receives the answers, too.
        """
        now = monotonic()
        self._acknowledge_until = min(self._acknowledge_until, now + _ACKNOWLEDGE_TIMEOUT)
        acknowledged = self.has_status and self._status.wait_for_all_acked(Duration())
        return acknowledged or now >= self._acknowledge_until
