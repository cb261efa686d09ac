"""The services of the plant: what an operator may request of the bench while it runs."""

from collections.abc import Callable
from functools import partial
from time import monotonic
from typing import Any

from flexslew_msgs import msg, srv
from rclpy.node import Node
from rclpy.parameter import Parameter
from std_srvs.srv import Trigger

from flexslew_plant.bench.operation.requests import Requests
from flexslew_plant.bench.operation.run_state import PAUSED, WAITING
from flexslew_plant.bench.operation.session import Session
from flexslew_plant.errors import BadInput
from flexslew_plant.graph import topics
from flexslew_plant.refusal import Reply
from flexslew_plant.ros.coroutines import PendingResult
from flexslew_plant.ros.loop import Loop
from flexslew_plant.ros.messages import seconds_of, stamp
from flexslew_plant.ros.offers import publisher
from flexslew_plant.ros.parameters import requested_text
from flexslew_plant.ros.plant.requests import add_service
from flexslew_plant.ros.plant.simulation_services import simulation_services
from flexslew_plant.ros.plant.switch_service import SwitchService
from flexslew_plant.ros.statuses import StatusMonitor

_START = 2.0  # until a client that starts the bench is answered with the missing nodes [wall s]
_STATE_PERIOD = 0.5  # between two states of the bench, if nothing changes [wall s]


class Services:
    """Answers the operator and shows the state of the bench.

    Args:
        node: of the plant.
        session: what is operated.
        status_monitor: of the controllers.
        loop: that serves the node.
        refresh: displays the state of a paused bench to new subscriptions.
    """

    def __init__(
        self,
        node: Node,
        session: Session,
        status_monitor: StatusMonitor,
        loop: Loop,
        refresh: Callable[[], None],
    ) -> None:
        self._refresh = refresh
        self._node, self._loop, self._session = node, loop, session
        self._status_monitor, self._bench = status_monitor, session.bench
        self._switch_service = SwitchService(node, session, loop)
        self._state = publisher(node, topics.BENCH_STATE)
        self._last_state: tuple[Any, ...] = ()
        self._next_state = 0.0
        # those that a fault may silence have ever sent a status
        self._requests = Requests(session, lambda: status_monitor.counted)
        self._simulation = simulation_services(node, session, loop, self._started)
        self._starts = list[tuple[float, PendingResult]]()  # clients, with deadlines [wall s]
        for name, act in self._requests.actions.items():
            answer = self._on_start if name == topics.START else self._trigger(act)
            self._add_service(Trigger, name, answer)
        for kind, name, answer in (
            (srv.Operate, topics.OPERATE, self._on_operate),
            (srv.Step, topics.STEP, partial(self._on_request, topics.STEP)),
            (srv.SetRate, topics.SET_RATE, self._on_rate),
            (srv.Note, topics.NOTE, partial(self._on_request, topics.NOTE)),
            (srv.ListControllers, topics.LIST_CONTROLLERS, self._on_list),
            (srv.InjectFault, topics.INJECT_FAULT, self._on_inject),
            (srv.EndFault, topics.END_FAULT, partial(self._on_request, topics.END_FAULT)),
            (srv.Retarget, topics.RETARGET, partial(self._on_request, topics.RETARGET)),
        ):
            self._add_service(kind, name, answer)

    def _add_service(self, kind: Any, name: str, answer: Callable[[Any, Any], Any]) -> None:
        for at in [name, f"~/{name}"][: 1 + (name in topics.OFFERED_PRIVATELY)]:
            add_service(self._node, self._loop, kind, at, answer)

    def poll(self, now: float) -> float:
        """Answer waiting clients, show the state; return the time until the next call [wall s]."""
        self._status_monitor.poll(now)
        self._show(now)
        if self._session.run.state == PAUSED:
            self._refresh()
        self._answer_starts(now)
        if self._simulation is not None:
            self._simulation.poll(now)
        return min(_STATE_PERIOD, self._switch_service.poll(now))

    def _show(self, now: float) -> None:
        session, bench = self._session, self._bench
        faults = bench.active_faults()
        new_state = (
            session.run.state, tuple(session.waiting_for), bench.epoch, bench.drive.active,
            bench.handover.latched, session.tick_timer.rate_factor, len(faults),
        )  # fmt: skip
        if new_state == self._last_state and now < self._next_state:
            return
        self._last_state, self._next_state = new_state, now + _STATE_PERIOD
        self._state.publish(
            msg.BenchState(
                stamp=stamp(bench.time),
                state=session.run.state,
                waiting_for=session.waiting_for,
                tick=bench.tick,
                last_tick=bench.last_tick or 0,
                epoch=bench.epoch,
                rate_factor=session.tick_timer.rate_factor,
                wall_time=session.run.wall_time(now),
                active=bench.drive.active,
                brake_latched=bench.handover.latched,
                missed_ticks=bench.drive.missed,
                fault_numbers=[fault.number for fault in faults],
                faults=[fault.words for fault in faults],
            )
        )

    def _trigger(self, act: Callable[[str], Reply]) -> Callable[[Any, Any], Any]:
        def answer(_: Trigger.Request, reply: Trigger.Response) -> Trigger.Response:
            outcome = act("")
            self._loop.hurry()
            reply.success, reply.message = outcome.ok, outcome.message
            return reply

        return answer

    async def _on_start(self, _: Trigger.Request, reply: Trigger.Response) -> Trigger.Response:
        outcome = await self._started("")
        reply.success, reply.message = outcome.ok, outcome.message
        return reply

    async def _started(self, who: str) -> Reply:
        """Start or resume; return as soon as ticks pass, or with the names of missing nodes."""
        outcome = self._session.start(who)
        self._loop.hurry()
        if not outcome.ok:
            return outcome
        future = self._loop.future()
        self._starts.append((monotonic() + _START, future))
        await future
        return self._requests.with_missing(outcome)

    def _answer_starts(self, now: float) -> None:
        """Answer clients of a start that has happened, or that have waited long enough."""
        is_waiting = self._session.run.state == WAITING
        for start in [s for s in self._starts if not is_waiting or now >= s[0]]:
            self._starts.remove(start)
            start[1].set_result(None)

    def _done(self, reply: Any, outcome: Reply) -> Any:
        """Fill in the fields that most replies have."""
        reply.ok, reply.message = outcome.ok, outcome.message
        reply.tick = outcome.tick or self._bench.tick
        self._loop.hurry()
        return reply

    async def _on_operate(self, request: Any, reply: Any) -> Any:
        if request.action == topics.START:
            return self._done(reply, await self._started(request.who))
        return self._on_request(topics.OPERATE, request, reply)

    def _on_request(self, name: str, request: Any, reply: Any) -> Any:
        """Answer at once; see Requests."""
        fields = {key: getattr(request, key) for key in request.get_fields_and_field_types()}
        if "at" in fields:
            fields["at"] = seconds_of(request.at)
        return self._done(reply, self._requests.services[name](**fields))

    def _on_rate(self, request: Any, reply: Any) -> Any:
        self._on_request(topics.SET_RATE, request, reply)
        if reply.ok:  # the parameter follows
            rate = Parameter("rate_factor", value=request.rate_factor)
            self._node.set_parameters([rate])
        return reply

    def _on_list(self, _: Any, reply: Any) -> Any:
        for name, status in sorted(self._status_monitor.counted.items()):
            reason = self._session.reason(name, monotonic())
            status.ready, status.reason = reason is None, str(reason or "")
            reply.controllers.append(status)
        reply.active = self._bench.drive.active
        return reply

    def _on_inject(self, request: Any, reply: Any) -> Any:
        try:
            text = requested_text(self._node, "fault", request.fault, request.values)
        except BadInput as error:
            outcome = Reply(refused=error.refusal)
        else:
            at = seconds_of(request.at)
            outcome = self._requests.services[topics.INJECT_FAULT](text, at, request.who)
        reply.number = outcome.number
        return self._done(reply, outcome)
