"""The service switch_controller: answered when the switch has happened, or cannot any more."""

from math import inf
from time import monotonic
from typing import Any, NamedTuple

from flexslew_msgs import srv
from rclpy.node import Node

from flexslew_plant.bench.operation.session import Session
from flexslew_plant.bench.records import SwitchRequest, SwitchResult
from flexslew_plant.graph import topics
from flexslew_plant.ros.coroutines import PendingResult
from flexslew_plant.ros.loop import Loop
from flexslew_plant.ros.messages import doubles, seconds_of
from flexslew_plant.ros.plant.requests import add_service


class _Pending(NamedTuple):
    """A switch that a client waits for."""

    request: SwitchRequest
    deadline: float  # [wall s]
    future: PendingResult


class SwitchService:
    """Queues switches and answers with their results.

    Args:
        node: node that offers the service.
        session: session that operates the bench.
        loop: loop that serves the node.
    """

    def __init__(self, node: Node, session: Session, loop: Loop) -> None:
        self._session, self._loop = session, loop
        self._pending: list[_Pending] = []
        add_service(node, loop, srv.SwitchController, topics.SWITCH_CONTROLLER, self._on_switch)

    def poll(self, now: float) -> float:
        """Answer clients that need not wait longer; return the time to the next call [wall s]."""
        results = self._session.bench.handover.results
        while results:
            result = results.popleft()
            for pending in [p for p in self._pending if p.request == result.request]:
                self._resolve(pending, result)
        for pending in [p for p in self._pending if now >= p.deadline]:
            self._resolve(pending, None)
        return min((p.deadline - now for p in self._pending), default=inf)

    def _resolve(self, pending: _Pending, result: SwitchResult | None) -> None:
        self._pending.remove(pending)
        pending.future.set_result(result)

    async def _on_switch(self, request: Any, reply: Any) -> Any:
        bench = self._session.bench
        reply.effort_step = doubles(0.0 * bench.limit)
        switch_request, rejection = self._session.requested_switch(
            request.controller, seconds_of(request.at), request.strict, request.max_effort_step,
            request.who, monotonic(),
        )  # fmt: skip
        tick = switch_request.tick
        reply.tick = max(0, tick)
        self._loop.hurry()
        if rejection is not None:
            reply.message = str(rejection)
        else:
            future = self._loop.future()
            deadline = monotonic() + (request.timeout if request.timeout > 0.0 else inf)
            self._pending.append(_Pending(switch_request, deadline, future))
            result = await future
            if result is None:
                reply.scheduled = True
                reply.message = (
                    f"switch to {request.controller} is due at tick {tick} and stays in the queue: "
                    f"it has not happened within {request.timeout:g} s"
                )
            else:
                reply.ok, reply.message, reply.tick = result.ok, result.message, result.tick
                reply.effort_step = doubles(result.effort_step)
        reply.active = bench.drive.active
        return reply
