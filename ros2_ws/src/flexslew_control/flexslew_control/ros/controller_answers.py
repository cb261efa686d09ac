"""The answers of the controllers to the plans that they receive, for waiting clients."""

import json
from collections.abc import Callable
from time import monotonic
from typing import NamedTuple

from flexslew_msgs import msg
from rclpy.node import Node

from flexslew_control.active_laws import ActiveLaws
from flexslew_control.plans.planned_course import PATIENCE, PlanResponse, PlanResponses
from flexslew_plant.bench.operation.presence import Heartbeats
from flexslew_plant.errors import BadInput
from flexslew_plant.events import PlanRejected, fact_of
from flexslew_plant.graph import topics
from flexslew_plant.ros.coroutines import PendingResult
from flexslew_plant.ros.loop import Loop
from flexslew_plant.ros.offers import subscription
from flexslew_plant.ros.statuses import StatusMonitor


class _Pending(NamedTuple):
    """A plan with answers that a client waits for."""

    digest: str
    deadline: float  # [wall s]
    future: PendingResult


class ControllerResponses:
    """Listens to the controllers' statuses and refusals.

    Args:
        node: node of the planner.
        loop: loop that serves the node.
        presence: heartbeats of the controllers.
        on_refusal: called with the hash of a plan that one of them refuses.
        laws: receive statuses and events.
    """

    def __init__(
        self,
        node: Node,
        loop: Loop,
        presence: Heartbeats,
        on_refusal: Callable[[str], None],
        laws: ActiveLaws,
    ) -> None:
        self._node, self._loop, self._presence = node, loop, presence
        self._on_refusal, self._laws = on_refusal, laws
        self._responses, self._pending = PlanResponses(), list[_Pending]()
        self._statuses = StatusMonitor(presence, self._on_status)
        subscription(node, topics.CONTROLLER_STATUS, self._statuses.receive)
        subscription(node, topics.EVENTS, self._on_event)

    @property
    def active_hash_set(self) -> set[str]:
        """The hashes of the plans that are followed."""
        return self._responses.active_hash_set

    def expect(self, digest: str) -> None:
        """Forget the answers to an earlier plan with this hash: it is published again."""
        self._responses.expect(digest)

    def of(self, digest: str) -> PlanResponse:
        """Return what has come so far on a plan with this hash from those that are there."""
        now, known = monotonic(), self._responses.controller_names
        return self._responses.of(digest, [n for n in known if self._presence.inactive(n, now)])

    def response_future(self, digest: str) -> PendingResult:
        """Return a future of the controllers' answers to the plan with this hash."""
        future = self._loop.future()
        self._pending.append(_Pending(digest, monotonic() + PATIENCE, future))
        self._loop.hurry()
        return future

    def poll(self, now: float) -> bool:
        """Answer waiting clients; return whether any still waits."""
        self._statuses.poll(now)
        for pending in list(self._pending):
            found = self.of(pending.digest)
            complete = not found.inactive and self.all_known
            if complete or now >= pending.deadline:
                self._pending.remove(pending)
                pending.future.set_result(found)
        return bool(self._pending)

    @property
    def all_known(self) -> bool:
        """Whether all controllers on the graph have sent a status; DDS may list them before."""
        publisher_count: int = self._node.count_publishers(topics.CONTROLLER_STATUS)
        return publisher_count <= len(self._responses.controller_names)

    def end(self) -> None:
        """Resolve every future with the answers so far: the node ends."""
        for pending in self._pending:
            pending.future.set_result(self.of(pending.digest))
        self._pending.clear()

    def _on_status(self, status: msg.ControllerStatus) -> None:
        self._responses.status(status)
        self._laws.take_status(status)

    def _on_event(self, event: msg.Event) -> None:
        try:
            what = fact_of(event.kind, json.loads(event.data))
        except (BadInput, ValueError):  # an event in another format than this release's
            return
        self._laws.take_event(what, event.tick, event.epoch)
        if isinstance(what, PlanRejected) and what.controller is not None:
            self._responses.refusal(what.controller, what.hash, what.reason or "")
            self._on_refusal(what.hash)
