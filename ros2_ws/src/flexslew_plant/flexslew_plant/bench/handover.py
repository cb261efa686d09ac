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
    AnswerMissed,
    BecameReady,
    BecameUnready,
    BrakeLatched,
    BrakeReleased,
    BrakeRequested,
    BrakeTookOver,
    Fact,
    FallbackTookOver,
    SensorsImplausible,
    SwitchDropped,
    Switched,
    SwitchRefused,
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
        tell: takes every outcome as an event of the present tick.
    """

    def __init__(
        self, drive: Drive, fallback: tuple[str, ...], tell: Callable[[Fact], None]
    ) -> None:
        self._drive, self._fallback, self._tell = drive, fallback, tell
        self.results: deque[SwitchResult] = deque()
        self._tick = 0  # the present tick
        self.latched = False  # the brake, until it is released on purpose; a reset keeps it
        self.faulted = False  # a controller had to be replaced
        self._queue: list[SwitchRequest] = []
        self._handover: tuple[SwitchRequest, str] | None = None  # under way, with the predecessor
        self._brake_requests: list[_BrakeRequest] = []
        self._unready: dict[str, Refusal] = {}
        self._fallen: set[str] = set()  # fell silent since the last valid answer of anybody
        self._misled: set[str] = set()  # lost the bench to implausible sensors in this epoch

    def reset(self, scheduled: Iterable[SwitchRequest]) -> None:
        """Begin an epoch with the switches of the schedule; those that wait are dropped.

        A brake that was to be latched or released with the next tick is so from tick 0 on.
        """
        self.drop_all(_RESET)
        self._drive.reset()
        self.faulted = False
        self._queue, self._handover = list(scheduled), None
        self._brake_requests = [_BrakeRequest(0, asked.on, ()) for asked in self._brake_requests]
        self._fallen.clear()
        self._misled.clear()
        if self.latched:
            self._drive.hand_over("")

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
        if self._to_be_latched:
            return _LATCHED
        if late := too_late(request.tick, last_tick):
            return late
        if any(other.tick == request.tick for other in self._queue):
            words = f"another switch is already due at tick {request.tick}"
            return Refusal(words, cause=Cause.ALREADY_DUE)
        earlier = any(other.tick < request.tick for other in self._queue)
        stays = not (earlier or self._brake_requests)
        if request.controller == self._drive.active and stays:
            return _in_charge(request.controller)
        self._queue.append(request)
        step = min(request.max_effort_step, _LARGEST)  # JSON has no infinity
        self._tell(SwitchRequested(**{**request._asdict(), "max_effort_step": step}))
        return None

    def brake(self, on: bool, tick: int, who: str) -> Refusal | None:
        """Latch or release the brake from this tick on; return why not, or None."""
        if self._to_be_latched == on:
            if on:
                return Refusal("the brake is latched already", cause=Cause.LATCHED)
            return Refusal("the brake is not latched", cause=Cause.NOT_LATCHED)
        self._brake_requests.append(_BrakeRequest(tick, on, tuple(self._queue)))
        self._tell(BrakeRequested(on, tick, who))
        return None

    @property
    def _to_be_latched(self) -> bool:
        """The brake is latched from the next tick on, which may be far on a bench that rests."""
        return self._brake_requests[-1].on if self._brake_requests else self.latched

    @property
    def waiting(self) -> bool:
        """Switches are due, at this tick or a later one."""
        return bool(self._queue)

    def due(self, tick: int) -> list[str]:
        """Return the controllers that take over at this tick if their switches succeed."""
        return [request.controller for request in self._queue if request.tick <= tick]

    def relieves(self, tick: int) -> bool:
        """Return whether the brake or a switch takes the bench from its controller by this tick."""
        brakes = (asked for asked in self._brake_requests if asked.on)
        return bool(self.due(tick)) or any(asked.tick <= tick for asked in brakes)

    def heirs(self) -> list[str]:
        """Return the next controllers if the active one misses one answer too many, best first.

        All but the last are not ready; without one that is ready the brake follows.
        """
        heirs: list[str] = []
        for name in self._chain():
            if not name:  # a newcomer came after the brake, which is always ready
                break
            if name != self._drive.active and name not in self._fallen | self._misled:
                heirs.append(name)
                if name not in self._unready:
                    break
        return heirs

    def begin(self, tick: int) -> None:
        """Let happen what is due at the tick that begins."""
        self._tick = tick
        while self._brake_requests and self._brake_requests[0].tick <= tick:
            self._latch(self._brake_requests.pop(0))  # one that is released at once acts, too
        if not self._queue:
            return
        due = [request for request in self._queue if request.tick <= tick]
        for request in sorted(due, key=lambda request: request.tick):
            self._queue.remove(request)
            why = self._objection(request.controller)
            if why is not None:
                self._drop(request, tick, why)
                continue
            before = self._drive.active
            if self._handover is not None:
                mute, before = self._handover
                words = f"{request.controller} took over before it answered"
                self._drop(mute, tick, Refusal(words, cause=Cause.TOOK_OVER))
            self._handover = request, before
            self._drive.hand_over(request.controller)

    def _objection(self, controller: str) -> Refusal | None:
        """Return why this one cannot take over at the tick that begins, or None."""
        if controller == self._drive.active:
            return _in_charge(controller)
        if self.latched:
            return _LATCHED
        why = self._unready.get(controller)
        return why and Refusal(f"{controller} is not ready: {why}", cause=Cause.NOT_READY)

    def answered(self, effort: Vector, applied: Vector) -> bool:
        """Take a valid answer; return False if it ends a handover because its step is too large.

        Args:
            effort: effort of the answer, (joints,) [N m or N].
            applied: effort applied during the last tick, (joints,) [N m or N].
        """
        self._fallen.clear()
        if self._handover is None:
            return True
        (request, outgoing), self._handover = self._handover, None
        step = effort - applied
        limit = request.max_effort_step
        ok = not (request.strict and float(np.abs(step).max()) > limit)
        if ok:
            done = Switched(outgoing, request.controller, step.tolist())
            self._tell(done)
            self.results.append(SwitchResult(request, self._tick, step, message_of(done)))
            return True
        refused = SwitchRefused(outgoing, request.controller, step.tolist(), limit)
        self._tell(refused)
        self._drive.hand_over(outgoing)
        self._fail(request, self._tick, Refusal(message_of(refused), cause=Cause.STEP_TOO_LARGE))
        return False

    def missed(self) -> None:
        """Take a tick without a valid answer; the controller is replaced after one too many.

        A newcomer that never answered gives the bench back to the one before it; then the fallbacks
        follow in order, each as often as it is ready; then the brake.
        """
        silent = self._drive.active
        over = self._drive.miss()
        self._tell(AnswerMissed(silent, self._drive.missed_in_a_row))
        if over:
            self._replace(silent, Cause.NO_ANSWER)

    def distrust(self, joint: str, difference: float) -> None:
        """Replace the active controller, because the sensors that it uses are implausible.

        Args:
            joint: the joint with contradictory sensors.
            difference: between its motion and its rate sensor [rad/s or m/s].
        """
        misled = self._drive.active
        self._misled.add(misled)
        self._tell(SensorsImplausible(misled, joint, difference))
        self._replace(misled, Cause.DOUBTED)

    def _replace(self, controller: str, cause: Cause) -> None:
        """Let the next one take over: the predecessor of a newcomer, a fallback, or the brake."""
        self._fallen.add(controller)
        unfit = self._fallen | self._misled | self._unready.keys()
        successor = next((name for name in self._chain() if name not in unfit), "")
        request = self._handover and self._handover[0]
        self._handover = None
        self._drive.hand_over(successor)
        self.faulted = True
        self._tell((FallbackTookOver if successor else BrakeTookOver)(successor, controller, cause))
        if request is not None:
            words = f"{controller} never answered; {successor or 'the brake'} is in charge"
            self._fail(request, self._tick, Refusal(words, cause=Cause.NO_ANSWER))

    def _chain(self) -> list[str]:
        """Return the controllers that may take over, in order, ready or not."""
        before = [self._handover[1]] if self._handover is not None else []
        return before + list(self._fallback)

    def note_readiness(self, controller: str, why: Refusal | None) -> None:
        """Record an event when a controller becomes unready, or ready again.

        Args:
            controller: name of the controller.
            why: reason why it is not ready; None if it is.
        """
        before = self._unready.get(controller)
        if before == why:
            return
        if why is not None:
            self._unready[controller] = why
            if before is not None and before.cause is why.cause is Cause.BEHIND:
                return  # by how much is no news
            self._tell(BecameUnready(controller, str(why), why.cause))
        else:
            del self._unready[controller]
            self._tell(BecameReady(controller))

    def _latch(self, asked: _BrakeRequest) -> None:
        """Latch or release the brake; switches requested after its release still take place."""
        self.latched = asked.on
        outgoing = self._drive.active
        if asked.on:
            self.drop_all(_LATCHED, [r for r in self._queue if r not in asked.drops])
            self._drive.hand_over("")
            self._tell(BrakeLatched(outgoing))
        else:
            self._tell(BrakeReleased())

    def _drop(self, request: SwitchRequest, tick: int, why: Refusal) -> None:
        what = SwitchDropped(request.controller, why.cause, str(why), request.tick)
        self._tell(what)
        self._fail(request, tick, Refusal(message_of(what), cause=why.cause))

    def _fail(self, request: SwitchRequest, tick: int, why: Refusal) -> None:
        nothing = np.zeros(self._drive.demand.size)
        self.results.append(SwitchResult(request, tick, nothing, refused=why))


def _in_charge(controller: str) -> Refusal:
    return Refusal(f"{controller} is already in charge", cause=Cause.ALREADY_IN_CHARGE)
