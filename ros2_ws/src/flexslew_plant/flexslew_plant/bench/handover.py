"""The control of the bench: switches, their queue and results, fallbacks, the brake's latch.

Every way out of a switch is a result and an event: it happened, it was refused (its step was too
large), it was dropped (not ready when due, the brake is latched, the run was reset or is over), or
the newcomer never answered.
"""

from collections import deque
from collections.abc import Callable, Iterable
from math import isnan
from typing import NamedTuple

import numpy as np

from flexslew_plant.arrays import Vector
from flexslew_plant.bench.due_ticks import too_late
from flexslew_plant.bench.records import SwitchRequest, SwitchResult
from flexslew_plant.events import (
    AnswerMissing,
    BrakeActivated,
    BrakeLatched,
    BrakeReleased,
    BrakeRequested,
    ControllerNotReady,
    ControllerReady,
    Fact,
    FallbackActivated,
    SensorsInconsistent,
    SwitchCompleted,
    SwitchDropped,
    SwitchRejected,
    SwitchRequested,
    message_of,
)
from flexslew_plant.hardware.drive import Drive
from flexslew_plant.refusal import Cause, Refusal

_LARGEST = float(np.finfo(np.float64).max)
_LATCHED = Refusal("the brake is latched; release it first", cause=Cause.LATCHED)
RUN_OVER = Refusal("the run is over", cause=Cause.RUN_OVER)
_RESET = Refusal("the bench was reset", cause=Cause.BENCH_RESET)


class _BrakeRequest(NamedTuple):
    """The brake is to be latched, or released, from a tick on."""

    tick: int
    on: bool
    drops: tuple[SwitchRequest, ...]  # the switches that waited at the time of this request


class Handover:
    """Hands the drive from one controller to the next.

    Args:
        drive: the drive that obeys the active controller.
        fallback: controllers that take over in this order when answers fail to come.
        report: takes every outcome as an event of the present tick.
    """

    def __init__(
        self, drive: Drive, fallback: tuple[str, ...], report: Callable[[Fact], None]
    ) -> None:
        self._drive, self._fallback, self._report = drive, fallback, report
        self.results: deque[SwitchResult] = deque()
        self._tick = 0  # the present tick
        self.latched = False  # the brake, until it is released on purpose; a reset keeps it
        self.faulted = False  # a controller had to be replaced
        self._queue: list[SwitchRequest] = []
        self._handover: tuple[SwitchRequest, str] | None = None  # under way, with the predecessor
        self._brake_requests: list[_BrakeRequest] = []
        self._not_ready: dict[str, Refusal] = {}
        self._failed: set[str] = set()  # fell silent since the last valid answer of anybody
        self._excluded: set[str] = set()  # lost the bench to implausible sensors in this epoch

    def reset(self, requests: Iterable[SwitchRequest]) -> None:
        """Begin an epoch with the switches of the schedule; those that wait are dropped.

        A brake that was to be latched or released with the next tick is so from tick 0 on.
        """
        self.drop_all(_RESET)
        self._drive.reset()
        self.faulted = False
        self._queue, self._handover = list(requests), None
        self._brake_requests = [
            _BrakeRequest(0, brake_request.on, ()) for brake_request in self._brake_requests
        ]
        self._failed.clear()
        self._excluded.clear()
        if self.latched:
            self._drive.set_active("")

    def drop_all(self, why: Refusal, kept: Iterable[SwitchRequest] = ()) -> None:
        """Give up every switch that has not happened, but those that are kept."""
        waiting = [self._handover[0]] if self._handover else []
        given_up, self._queue = self._queue, [r for r in self._queue if r in kept]
        self._handover = None
        for request in waiting + [r for r in given_up if r not in kept]:
            self._drop(request, self._tick, why)

    def request(self, request: SwitchRequest, tick: int, last_tick: int | None) -> Refusal | None:
        """Queue a switch; return why it is refused, or None.

        Args:
            request: with a tick in the future.
            tick: of the bench.
            last_tick: of the run; None: no end.
        """
        if isnan(request.max_effort_step):
            return Refusal("0 or more", "max_effort_step", request.max_effort_step)
        if self._brake_on_next:
            return _LATCHED
        if late := too_late(request.tick, last_tick):
            return late
        if any(other.tick == request.tick for other in self._queue):
            words = f"another switch is already due at tick {request.tick}"
            return Refusal(words, cause=Cause.ALREADY_DUE)
        has_previous = any(other.tick < request.tick for other in self._queue)
        is_active = not (has_previous or self._brake_requests)
        if request.controller == self._drive.active and is_active:
            return _in_charge(request.controller)
        self._queue.append(request)
        step = min(request.max_effort_step, _LARGEST)  # JSON has no infinity
        self._report(SwitchRequested(**{**request._asdict(), "max_effort_step": step}))
        return None

    def brake(self, on: bool, tick: int, who: str) -> Refusal | None:
        """Latch or release the brake from this tick on; return why not, or None."""
        if self._brake_on_next == on:
            if on:
                return Refusal("the brake is latched already", cause=Cause.LATCHED)
            return Refusal("the brake is not latched", cause=Cause.NOT_LATCHED)
        self._brake_requests.append(_BrakeRequest(tick, on, tuple(self._queue)))
        self._report(BrakeRequested(on, tick, who))
        return None

    @property
    def _brake_on_next(self) -> bool:
        """The brake is latched from the next tick on, which may be far on a bench that rests."""
        return self._brake_requests[-1].on if self._brake_requests else self.latched

    @property
    def waiting(self) -> bool:
        """Switches are due, at this tick or a later one."""
        return bool(self._queue)

    def due(self, tick: int) -> list[str]:
        """Return the controllers that take over at this tick if their switches succeed."""
        return [request.controller for request in self._queue if request.tick <= tick]

    def has_replacement(self, tick: int) -> bool:
        """Return whether the brake or a switch takes the bench from its controller by this tick."""
        brake_requests = (
            brake_request for brake_request in self._brake_requests if brake_request.on
        )
        return bool(self.due(tick)) or any(
            brake_request.tick <= tick for brake_request in brake_requests
        )

    def next_controllers(self) -> list[str]:
        """Return the next controllers if the active one misses one answer too many, best first.

        All but the last are not ready; without one that is ready the brake follows.
        """
        candidates: list[str] = []
        for name in self._chain():
            if not name:  # a newcomer came after the brake, which is always ready
                break
            if name != self._drive.active and name not in self._failed | self._excluded:
                candidates.append(name)
                if name not in self._not_ready:
                    break
        return candidates

    def begin(self, tick: int) -> None:
        """Let happen what is due at the tick that begins."""
        self._tick = tick
        while self._brake_requests and self._brake_requests[0].tick <= tick:
            self._set_brake(self._brake_requests.pop(0))  # one that is released at once acts, too
        if not self._queue:
            return
        pending = [request for request in self._queue if request.tick <= tick]
        for request in sorted(pending, key=lambda request: request.tick):
            self._queue.remove(request)
            why = self._rejection(request.controller)
            if why is not None:
                self._drop(request, tick, why)
                continue
            before = self._drive.active
            if self._handover is not None:
                previous_request, before = self._handover
                words = f"{request.controller} took over before it answered"
                self._drop(previous_request, tick, Refusal(words, cause=Cause.TOOK_OVER))
            self._handover = request, before
            self._drive.set_active(request.controller)

    def _rejection(self, controller: str) -> Refusal | None:
        """Return why this one cannot take over at the tick that begins, or None."""
        if controller == self._drive.active:
            return _in_charge(controller)
        if self.latched:
            return _LATCHED
        why = self._not_ready.get(controller)
        return why and Refusal(f"{controller} is not ready: {why}", cause=Cause.NOT_READY)

    def answered(self, effort: Vector, applied: Vector) -> bool:
        """Take a valid answer; return False if it ends a handover because its step is too large.

        Args:
            effort: effort of the answer, (joints,) [N m or N].
            applied: effort applied during the last tick, (joints,) [N m or N].
        """
        self._failed.clear()
        if self._handover is None:
            return True
        (request, outgoing), self._handover = self._handover, None
        step = effort - applied
        limit = request.max_effort_step
        ok = not (request.strict and float(np.abs(step).max()) > limit)
        if ok:
            done = SwitchCompleted(outgoing, request.controller, step.tolist())
            self._report(done)
            self.results.append(SwitchResult(request, self._tick, step, message_of(done)))
            return True
        rejected = SwitchRejected(outgoing, request.controller, step.tolist(), limit)
        self._report(rejected)
        self._drive.set_active(outgoing)
        self._fail(request, self._tick, Refusal(message_of(rejected), cause=Cause.STEP_TOO_LARGE))
        return False

    def count_missing_answer(self) -> None:
        """Take a tick without a valid answer; the controller is replaced after one too many.

        A newcomer that never answered gives the bench back to the one before it; then the fallbacks
        follow in order, each as often as it is ready; then the brake.
        """
        controller = self._drive.active
        over = self._drive.miss()
        self._report(AnswerMissing(controller, self._drive.missing_ticks))
        if over:
            self._replace(controller, Cause.NO_ANSWER)

    def reject_sensors(self, joint: str, difference: float) -> None:
        """Replace the active controller, because the sensors that it uses are implausible.

        Args:
            joint: the joint with contradictory sensors.
            difference: between its motion and its rate sensor [rad/s or m/s].
        """
        controller = self._drive.active
        self._excluded.add(controller)
        self._report(SensorsInconsistent(controller, joint, difference))
        self._replace(controller, Cause.DOUBTED)

    def _replace(self, controller: str, cause: Cause) -> None:
        """Let the next one take over: the predecessor of a newcomer, a fallback, or the brake."""
        self._failed.add(controller)
        excluded = self._failed | self._excluded | self._not_ready.keys()
        replacement = next((name for name in self._chain() if name not in excluded), "")
        request = self._handover and self._handover[0]
        self._handover = None
        self._drive.set_active(replacement)
        self.faulted = True
        self._report(
            (FallbackActivated if replacement else BrakeActivated)(replacement, controller, cause)
        )
        if request is not None:
            words = f"{controller} never answered; {replacement or 'the brake'} is in charge"
            self._fail(request, self._tick, Refusal(words, cause=Cause.NO_ANSWER))

    def _chain(self) -> list[str]:
        """Return the controllers that may take over, in order, ready or not."""
        before = [self._handover[1]] if self._handover is not None else []
        return before + list(self._fallback)

    def set_ready_status(self, controller: str, why: Refusal | None) -> None:
        """Record an event when a controller becomes unready, or ready again.

        Args:
            controller: name of the controller.
            why: reason why it is not ready; None if it is.
        """
        before = self._not_ready.get(controller)
        if before == why:
            return
        if why is not None:
            self._not_ready[controller] = why
            if before is not None and before.cause is why.cause is Cause.BEHIND:
                return  # by how much is no news
            self._report(ControllerNotReady(controller, str(why), why.cause))
        else:
            del self._not_ready[controller]
            self._report(ControllerReady(controller))

    def _set_brake(self, brake_request: _BrakeRequest) -> None:
        """Latch or release the brake; switches requested after its release still take place."""
        self.latched = brake_request.on
        outgoing = self._drive.active
        if brake_request.on:
            self.drop_all(_LATCHED, [r for r in self._queue if r not in brake_request.drops])
            self._drive.set_active("")
            self._report(BrakeLatched(outgoing))
        else:
            self._report(BrakeReleased())

    def _drop(self, request: SwitchRequest, tick: int, why: Refusal) -> None:
        what = SwitchDropped(request.controller, why.cause, str(why), request.tick)
        self._report(what)
        self._fail(request, tick, Refusal(message_of(what), cause=why.cause))

    def _fail(self, request: SwitchRequest, tick: int, why: Refusal) -> None:
        zero_step = np.zeros(self._drive.demand.size)
        self.results.append(SwitchResult(request, tick, zero_step, refused=why))


def _in_charge(controller: str) -> Refusal:
    return Refusal(f"{controller} is already in charge", cause=Cause.ALREADY_IN_CHARGE)
