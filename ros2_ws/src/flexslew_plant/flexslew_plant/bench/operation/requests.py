"""What an operator may request of a bench by name, in whichever way the request comes."""

from collections.abc import Callable, Iterable
from functools import partial
from time import monotonic

from flexslew_plant.bench.due_ticks import requested_tick
from flexslew_plant.bench.operation.run_state import WAITING
from flexslew_plant.bench.operation.session import Session
from flexslew_plant.graph import topics
from flexslew_plant.refusal import Refusal, Reply


class Requests:
    """The requests that a bench answers at once.

    Args:
        session: of the bench.
        controllers: returns the controllers that a fault may silence.

    Attributes:
        actions: of `operate` by name; each takes the operator's name.
        services: by the name of the ROS service; each takes the fields of its request, simulated
            times in seconds.
    """

    def __init__(self, session: Session, controllers: Callable[[], Iterable[str]]) -> None:
        self._session, self._bench, self._controllers = session, session.bench, controllers
        self.actions: dict[str, Callable[[str], Reply]] = {
            topics.START: session.start,
            topics.PAUSE: lambda who: session.pause(monotonic(), who),
            topics.RESET: session.reset,
            topics.BRAKE: partial(session.brake, True),
            topics.RELEASE_BRAKE: partial(session.brake, False),
        }
        self.services: dict[str, Callable[..., Reply]] = {
            topics.OPERATE: self._operate,
            topics.STEP: self._step,
            topics.SET_RATE: self._set_rate,
            topics.NOTE: session.note,
            topics.INJECT_FAULT: self._inject,
            topics.END_FAULT: self._bench.end_fault,
            topics.RETARGET: self._retarget,
        }

    def with_missing(self, started: Reply) -> Reply:
        """Return the reply to a start, with the nodes that the bench still waits for."""
        missing = ", ".join(self._session.waiting_for)
        if not started.ok or self._session.run.state != WAITING or not missing:
            return started
        return Reply(f"{started.done} as soon as they are there: waiting for {missing}")

    def _operate(self, action: str, who: str) -> Reply:
        if action not in self.actions:
            return Reply(refused=Refusal(", ".join(self.actions), "action", action))
        return self.actions[action](who)

    def _step(self, ticks: int, who: str) -> Reply:
        reply = self._session.step(ticks, who)
        return reply._replace(tick=self._bench.tick + max(1, ticks)) if reply.ok else reply

    def _set_rate(self, rate_factor: float, who: str) -> Reply:
        return self._session.set_rate(rate_factor, monotonic(), who)

    def _inject(self, fault: str, at: float, who: str) -> Reply:
        return self._bench.inject(fault, self._tick(at), who, sorted(self._controllers()))

    def _retarget(self, target: str, at: float, who: str) -> Reply:
        return self._bench.retarget(target, self._tick(at), who)

    def _tick(self, at: float) -> int:
        return requested_tick(at, self._bench.settings.period, self._bench.tick)
