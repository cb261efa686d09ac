"""The services of the plant: what an operator may ask of the bench while it runs."""

from collections.abc import Callable
from time import monotonic
from typing import TYPE_CHECKING, NamedTuple

from flexslew_msgs import srv
from rclpy.task import Future
from std_srvs.srv import Trigger

from flexslew_plant import topics
from flexslew_plant.bench.bench import SwitchRequest, SwitchResult
from flexslew_plant.ros.node import Loop, doubles

if TYPE_CHECKING:
    from flexslew_plant.ros.plant_node import Plant


class _Pending(NamedTuple):
    """A switch that somebody waits for."""

    request: SwitchRequest
    epoch: int
    deadline: float  # [wall s]
    future: Future


class Services:
    """Answers the operator; a switch is answered when it has happened.

    Args:
        plant: whose bench it is.
        loop: that serves it.
    """

    def __init__(self, plant: "Plant", loop: Loop) -> None:
        self._plant, self._loop = plant, loop
        self._pending: list[_Pending] = []
        node = plant.node
        node.create_service(Trigger, topics.START, _trigger(plant.start))
        node.create_service(Trigger, topics.PAUSE, _trigger(plant.pause))
        node.create_service(Trigger, topics.RESET, _trigger(plant.reset))
        node.create_service(srv.Step, topics.STEP, self._on_step)
        node.create_service(srv.SwitchController, topics.SWITCH_CONTROLLER, self._on_switch)
        node.create_service(srv.ListControllers, topics.LIST_CONTROLLERS, self._on_list)
        node.create_service(srv.InjectFault, topics.INJECT_FAULT, self._on_inject)

    def poll(self) -> None:
        """Tell those who wait for a switch what became of it."""
        results = self._plant.bench.switch_results
        while results:
            result = results.popleft()
            for pending in [p for p in self._pending if p.request == result.request]:
                self._resolve(pending, result)
        now, epoch = monotonic(), self._plant.bench.epoch
        for pending in [p for p in self._pending if now >= p.deadline or p.epoch != epoch]:
            self._resolve(pending, None)

    def _resolve(self, pending: _Pending, result: SwitchResult | None) -> None:
        self._pending.remove(pending)
        pending.future.set_result(result)

    def _on_step(self, request: srv.Step.Request, reply: srv.Step.Response) -> srv.Step.Response:
        tick = self._plant.bench.tick
        reply.ok, reply.message = self._plant.step(request.ticks)
        reply.tick = tick + max(1, request.ticks) if reply.ok else tick
        return reply

    async def _on_switch(
        self, request: srv.SwitchController.Request, reply: srv.SwitchController.Response
    ) -> srv.SwitchController.Response:
        bench = self._plant.bench
        reply.effort_step = doubles(0.0 * bench.limit)
        reply.message = self._objection(request.controller)
        if reply.message:
            return reply
        at = request.at.sec + request.at.nanosec * 1e-9
        wanted = round(at / bench.settings.period)
        tick = wanted if 0 < wanted < bench.tick else max(wanted, bench.tick + 1)
        limit = request.max_effort_step or float("inf")
        wish = SwitchRequest(request.controller, tick, request.strict, limit)
        reply.message = bench.request_switch(wish) or ""
        reply.tick = tick
        if reply.message:
            return reply
        reply.ok = True
        reply.message = f"switch to {request.controller} at tick {tick}"
        if self._plant.state != "running":
            return reply  # it will happen, but nobody knows when
        deadline = monotonic() + (request.timeout or float("inf"))
        future = self._loop.future()
        self._pending.append(_Pending(wish, bench.epoch, deadline, future))
        result = await future
        if result is not None:
            reply.ok, reply.message, reply.tick = result.ok, result.message, result.tick
            reply.effort_step = doubles(result.effort_step)
        return reply

    def _objection(self, controller: str) -> str:
        """Return why the bench cannot be given to this controller, or an empty text."""
        plant, bench = self._plant, self._plant.bench
        status = plant.controllers.get(controller)
        if status is None:
            known = ", ".join(sorted(plant.controllers)) or "none"
            return f"unknown controller {controller}; on the graph: {known}"
        reason = status.reason or plant.standby.reason(controller, bench.tick, bench.epoch)
        return f"{controller} is not ready: {reason}" if reason else ""

    def _on_list(
        self, _: srv.ListControllers.Request, reply: srv.ListControllers.Response
    ) -> srv.ListControllers.Response:
        controllers = self._plant.controllers
        reply.controllers = [controllers[name] for name in sorted(controllers)]
        reply.active = self._plant.bench.drive.active
        return reply

    def _on_inject(
        self, request: srv.InjectFault.Request, reply: srv.InjectFault.Response
    ) -> srv.InjectFault.Response:
        at = request.at.sec + request.at.nanosec * 1e-9
        bench = self._plant.bench
        tick = round(at / bench.settings.period)
        reply.ok, reply.message, reply.tick = bench.inject(request.fault, tick)
        return reply


def _trigger(
    act: Callable[[], tuple[bool, str]],
) -> Callable[[Trigger.Request, Trigger.Response], Trigger.Response]:
    def answer(_: Trigger.Request, reply: Trigger.Response) -> Trigger.Response:
        reply.success, reply.message = act()
        return reply

    return answer
