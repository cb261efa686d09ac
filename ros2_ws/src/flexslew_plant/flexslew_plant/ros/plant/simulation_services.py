"""The bench as any simulator: the services of `simulation_interfaces`, where that is installed.

It is not among the wheels. Of its features the bench has state, pause, reset and steps.
"""

from collections.abc import Awaitable, Callable
from importlib.util import find_spec
from time import monotonic
from typing import Any, NamedTuple

from rclpy.action import CancelResponse
from rclpy.action.server import ServerGoalHandle
from rclpy.node import Node

from flexslew_plant.bench.operation.run_state import FINISHED, PAUSED
from flexslew_plant.bench.operation.session import Session
from flexslew_plant.graph import topics
from flexslew_plant.refusal import Reply
from flexslew_plant.ros.coroutines import CoroutineActionServer, PendingResult
from flexslew_plant.ros.loop import Loop
from flexslew_plant.ros.plant.requests import add_service

INSTALLED = find_spec("simulation_interfaces") is not None
_FEATURES = (
    *("SIMULATION_RESET", "SIMULATION_STATE_GETTING", "SIMULATION_STATE_SETTING"),
    *("SIMULATION_STATE_PAUSE", "STEP_SIMULATION_SINGLE", "STEP_SIMULATION_MULTIPLE"),
    "STEP_SIMULATION_ACTION",
)
_FEEDBACK = 0.1  # between two of them [wall s]


class _Steps(NamedTuple):
    """Ticks that a client waits for."""

    first: int  # tick before them
    ticks: int
    epoch: int
    goal: ServerGoalHandle | None  # that receives how many are left; None: a service
    done: PendingResult


class SimulationServices:
    """Answers them.

    Args:
        node: of the plant.
        session: what is operated.
        loop: that serves the node.
        start: starts or resumes; returns as soon as ticks pass.
    """

    def __init__(
        self,
        node: Node,
        session: Session,
        loop: Loop,
        start: Callable[[str], Awaitable[Reply]],
    ) -> None:
        from simulation_interfaces import action, msg, srv

        self._msg, self._action, self._srv = msg, action, srv
        self._session, self._loop, self._start = session, loop, start
        self._steps: list[_Steps] = []
        self._next_feedback = 0.0
        for kind, name, answer in (
            (srv.GetSimulatorFeatures, topics.GET_SIMULATOR_FEATURES, self._on_features),
            (srv.GetSimulationState, topics.GET_SIMULATION_STATE, self._on_get_state),
            (srv.SetSimulationState, topics.SET_SIMULATION_STATE, self._on_set_state),
            (srv.ResetSimulation, topics.RESET_SIMULATION, self._on_reset),
            (srv.StepSimulation, topics.STEP_SIMULATION, self._on_step),
        ):
            add_service(node, loop, kind, name, answer)
        self._server = CoroutineActionServer(
            node,
            action.SimulateSteps,
            topics.SIMULATE_STEPS,
            self._simulate,
            cancel_callback=lambda _: CancelResponse.ACCEPT,
        )

    def poll(self, now: float) -> None:
        """Send feedback to clients that wait for ticks, and answer them when these have passed."""
        if not self._steps:
            return
        if any(s.goal is not None and s.goal.is_cancel_requested for s in self._steps):
            self._session.pause(now)
        send_feedback = now >= self._next_feedback
        if send_feedback:
            self._next_feedback = now + _FEEDBACK
        for steps in list(self._steps):
            completed, lost = self._run_steps(steps), steps.epoch != self._session.bench.epoch
            over = lost or completed == steps.ticks or not self._session.run.has_steps_left
            if steps.goal is not None and (send_feedback or over):
                feedback = self._action.SimulateSteps.Feedback(
                    completed_steps=completed, remaining_steps=steps.ticks - completed
                )
                steps.goal.publish_feedback(feedback)
            if over:
                self._steps.remove(steps)
                steps.done.set_result(None)

    def _run_steps(self, steps: _Steps) -> int:
        """Return how many of them have passed; after a `start` others follow them."""
        bench = self._session.bench
        return min(bench.tick - steps.first, steps.ticks) if bench.epoch == steps.epoch else 0

    def _result(self, code: int, words: str = "") -> Any:
        return self._msg.Result(result=code, error_message=words)

    def _of(self, reply: Reply, otherwise: int) -> Any:
        """Return the result of a request; `otherwise` is the code of a refusal."""
        ok = self._msg.Result.RESULT_OK
        return self._result(ok) if reply.ok else self._result(otherwise, reply.message)

    @property
    def _state(self) -> int:
        kinds, session = self._msg.SimulationState, self._session
        if session.run.state not in (PAUSED, FINISHED):
            return int(kinds.STATE_PLAYING)
        return int(kinds.STATE_PAUSED if session.bench.tick else kinds.STATE_STOPPED)

    def _on_features(self, _: Any, reply: Any) -> Any:
        kinds = self._msg.SimulatorFeatures
        reply.features = kinds(
            features=[getattr(kinds, name) for name in _FEATURES],
            custom_info="a step is one tick of the bench; a reset is of time and state together",
        )
        return reply

    def _on_get_state(self, _: Any, reply: Any) -> Any:
        reply.state.state = self._state
        reply.result = self._result(self._msg.Result.RESULT_OK)
        return reply

    async def _on_set_state(self, request: Any, reply: Any) -> Any:
        kinds, requested_state = self._msg.SimulationState, request.state.state
        service_kind = self._srv.SetSimulationState.Response
        if requested_state == self._state:
            words = "it is so already"
            reply.result = self._result(service_kind.ALREADY_IN_TARGET_STATE, words)
        elif requested_state == kinds.STATE_PLAYING:
            reply.result = self._of(await self._start(""), service_kind.STATE_TRANSITION_ERROR)
        elif requested_state == kinds.STATE_PAUSED:
            outcome = self._session.pause(monotonic())
            reply.result = self._of(outcome, service_kind.INCORRECT_TRANSITION)
        elif requested_state == kinds.STATE_STOPPED:
            outcome = self._session.reset()
            reply.result = self._of(outcome, service_kind.STATE_TRANSITION_ERROR)
        else:
            words = "state: stopped, playing or paused; the bench ends by Ctrl-C or its duration"
            reply.result = self._result(self._msg.Result.RESULT_FEATURE_UNSUPPORTED, words)
        self._loop.hurry()
        return reply

    def _on_reset(self, request: Any, reply: Any) -> Any:
        kind = self._srv.ResetSimulation.Request
        whole = kind.SCOPE_TIME | kind.SCOPE_STATE
        if request.scope != kind.SCOPE_DEFAULT and request.scope & whole != whole:
            words = "scope: the bench resets time and state together, and spawns nothing"
            reply.result = self._result(self._msg.Result.RESULT_FEATURE_UNSUPPORTED, words)
            return reply
        outcome = self._session.reset()
        reply.result = self._of(outcome, self._msg.Result.RESULT_OPERATION_FAILED)
        self._loop.hurry()
        return reply

    async def _on_step(self, request: Any, reply: Any) -> Any:
        reply.result = await self._step_and_wait(request.steps, None)
        return reply

    async def _simulate(self, goal: ServerGoalHandle) -> Any:
        result = await self._step_and_wait(goal.request.steps, goal)
        if goal.is_cancel_requested:
            goal.canceled()
        elif result.result == self._msg.Result.RESULT_OK:
            goal.succeed()
        else:
            goal.abort()
        return self._action.SimulateSteps.Result(result=result)

    async def _step_and_wait(self, count: int, goal: ServerGoalHandle | None) -> Any:
        """Fly so many ticks of a paused bench; return what came of it when they have passed."""
        failed = self._msg.Result.RESULT_OPERATION_FAILED
        if count < 1:
            return self._result(failed, f"steps: 1 or more, not {count}")
        bench = self._session.bench
        outcome = self._session.step(count)
        self._loop.hurry()
        if not outcome.ok:
            return self._result(failed, outcome.message)
        steps = _Steps(bench.tick, count, bench.epoch, goal, self._loop.future())
        self._steps.append(steps)
        await steps.done
        completed = self._run_steps(steps)
        if completed == count:
            return self._result(self._msg.Result.RESULT_OK)
        return self._result(failed, f"{completed} of {count} ticks were flown")


def simulation_services(
    node: Node, session: Session, loop: Loop, start: Callable[[str], Awaitable[Reply]]
) -> SimulationServices | None:
    """Return what answers; None where `simulation_interfaces` is not installed."""
    return SimulationServices(node, session, loop, start) if INSTALLED else None
