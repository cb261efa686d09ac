"""Who is in charge of the bench: switches, their queue and results, fallbacks, the brake's latch.

Every way out of a switch is a result and an event: it happened, it was refused (its step was too
large), it was dropped (not ready when due, the brake is latched, the run was reset or is over), or
the newcomer never answered.
"""

from collections import deque
from collections.abc import Callable, Iterable
from math import isnan
from typing import Any

import numpy as np

from flexslew_plant.arrays import Vector
from flexslew_plant.bench.events import Level
from flexslew_plant.bench.hardware.drive import Drive
from flexslew_plant.bench.records import SwitchRequest, SwitchResult

Say = Callable[[Level, str, str, dict[str, Any]], None]  # level, kind, message, data

_LARGEST = float(np.finfo(np.float64).max)
LATCHED = "the brake is latched; release it first"


class Charge:
    """Hands the drive from one controller to the next.

    Args:
        drive: that obeys the one in charge.
        fallback: who takes over in turn when answers fail to come.
        say: takes what becomes of everything as an event of the present tick.
    """

    def __init__(self, drive: Drive, fallback: tuple[str, ...], say: Say) -> None:
        self._drive, self._fallback, self._say = drive, fallback, say
        self.results: deque[SwitchResult] = deque()
        self._tick = 0  # that has begun
        self.latched = False  # the brake, until it is released on purpose; a reset keeps it
        self.faulted = False  # a controller had to be replaced
        self._queue: list[SwitchRequest] = []
        self._handover: tuple[SwitchRequest, str] | None = None  # under way, with the predecessor
        self._brake_wanted: list[tuple[int, bool]] = []  # from which tick on, and whether
        self._unready: dict[str, str] = {}
        self._fallen: set[str] = set()  # fell silent since the last valid answer of anybody
        self._misled: set[str] = set()  # lost the bench to implausible sensors in this epoch

    def reset(self, scheduled: Iterable[SwitchRequest]) -> None:
        """Begin an epoch with the switches of the schedule; those that wait are dropped."""
        self.drop_all("the bench was reset")
        self._drive.reset()
        self.faulted = False
        self._queue, self._handover, self._brake_wanted = list(scheduled), None, []
        self._fallen.clear()
        self._misled.clear()
        if self.latched:
            self._drive.hand_over("")

    def drop_all(self, why: str) -> None:
        """Give up every switch that has not happened."""
        waiting = [self._handover[0]] if self._handover else []
        self._handover = None
        for request in waiting + self._queue:
            self._drop(request, self._tick, why)
        self._queue = []

    def request(self, request: SwitchRequest, tick: int, last_tick: int | None) -> str | None:
        """Queue a switch; return why it is refused, or None.

        Args:
            request: with a tick in the future.
            tick: of the bench.
            last_tick: of the run; None: no end.
        """
        if isnan(request.max_effort_step):
            return "max_effort_step: nan is not allowed: 0 or more"
        if self.latched:
            return LATCHED
        if last_tick is not None and request.tick >= last_tick:
            return f"tick {request.tick} is too late: the run ends at tick {last_tick}"
        if any(other.tick == request.tick for other in self._queue):
            return f"another switch is already due at tick {request.tick}"
        earlier = any(other.tick < request.tick for other in self._queue)
        if request.controller == self._drive.active and not earlier:
            return f"{request.controller} is already in charge"
        self._queue.append(request)
        data = request._asdict()
        data["max_effort_step"] = min(request.max_effort_step, _LARGEST)  # JSON has no infinity
        words = f"{request.controller} requested from tick {request.tick} on"
        self._say(Level.INFO, "switch_requested", words, data)
        return None

    def brake(self, on: bool, tick: int, who: str) -> str | None:
        """Latch or release the brake from this tick on; return why not, or None."""
        wanted = self._brake_wanted[-1][1] if self._brake_wanted else self.latched
        if wanted == on:
            return "the brake is latched already" if on else "the brake is not latched"
        self._brake_wanted.append((tick, on))
        words = f"{'brake' if on else 'release of the brake'} requested from tick {tick} on"
        self._say(Level.INFO, "brake_requested", words, {"on": on, "tick": tick, "who": who})
        return None

    def due(self, tick: int) -> list[str]:
        """Return who takes over at this tick, if all goes well."""
        return [request.controller for request in self._queue if request.tick <= tick]

    def begin(self, tick: int) -> None:
        """Let happen what is due at the tick that begins."""
        self._tick = tick
        while self._brake_wanted and self._brake_wanted[0][0] <= tick:
            self._latch(self._brake_wanted.pop(0)[1])  # one that is released at once acts, too
        if not self._queue:
            return
        due = [request for request in self._queue if request.tick <= tick]
        for request in sorted(due, key=lambda request: request.tick):
            self._queue.remove(request)
            why = LATCHED if self.latched else self._unready.get(request.controller, "")
            if request.controller == self._drive.active:
                why = f"{request.controller} is already in charge"
            elif why and not self.latched:
                why = f"{request.controller} is not ready: {why}"
            if why:
                self._drop(request, tick, why)
            else:
                before = self._drive.active
                if self._handover is not None:
                    mute, before = self._handover
                    self._drop(mute, tick, f"{request.controller} took over before it answered")
                self._handover = request, before
                self._drive.hand_over(request.controller)

    def answered(self, effort: Vector, applied: Vector) -> bool:
        """Take a valid answer; return False if it ends a handover whose step is too large.

        Args:
            effort: of the answer, (joints,) [N m or N].
            applied: during the last tick, (joints,) [N m or N].
        """
        self._fallen.clear()
        if self._handover is None:
            return True
        (request, outgoing), self._handover = self._handover, None
        step = effort - applied
        largest = float(np.abs(step).max())
        data = {"from": outgoing, "to": request.controller, "effort_step": step.tolist()}
        ok = not (request.strict and largest > request.max_effort_step)
        if ok:
            words = f"{outgoing or 'brake'} -> {request.controller}, effort step {largest:.3g}"
            self._say(Level.INFO, "switched", words, data)
        else:
            words = (
                f"switch to {request.controller} refused: its effort would step by {largest:.3g}, "
                f"max_effort_step is {request.max_effort_step:.3g}; "
                f"{outgoing or 'the brake'} stays in charge"
            )
            self._say(Level.WARNING, "switch_refused", words, data)
            self._drive.hand_over(outgoing)
            step = np.zeros_like(step)
        self.results.append(SwitchResult(request, ok, words, self._tick, step))
        return ok

    def missed(self) -> None:
        """Take a tick without a valid answer; somebody else takes over when it is one too many.

        A newcomer that never answered gives the bench back to the one before it; then the fallbacks
        follow in order, each as often as it is ready; then the brake.
        """
        silent = self._drive.active
        over = self._drive.miss()
        row = self._drive.missed_in_a_row
        words = f"no valid answer from {silent}, last effort held ({row} in a row)"
        self._say(Level.WARNING, "missed", words, {"controller": silent, "in_a_row": row})
        if over:
            self._replace(silent, "is silent")

    def distrusted(self, words: str, data: dict[str, Any]) -> None:
        """Take the bench from the one in charge, who flies on sensors that cannot be right.

        Args:
            words: what is wrong with them.
            data: the same for programs.
        """
        misled = self._drive.active
        self._misled.add(misled)
        self._say(Level.FAULT, "implausible", words, {"controller": misled, **data})
        self._replace(misled, "uses implausible sensors")

    def _replace(self, controller: str, why: str) -> None:
        """Let the next one take over: the predecessor of a newcomer, a fallback, or the brake."""
        self._fallen.add(controller)
        chain = list(self._fallback)
        request = None
        if self._handover is not None:
            (request, before), self._handover = self._handover, None
            chain.insert(0, before)
        unfit = self._fallen | self._misled | self._unready.keys()
        successor = next((name for name in chain if name not in unfit), "")
        self._drive.hand_over(successor)
        self.faulted = True
        words = f"{controller} {why}: {successor or 'the brake'} takes over"
        data = {"from": controller, "to": successor}
        self._say(Level.FAULT, "fallback" if successor else "brake", words, data)
        if request is not None:
            words = f"{controller} never answered; {successor or 'the brake'} is in charge"
            self._result(request, self._tick, words)

    def note_readiness(self, controller: str, reason: str) -> None:
        """Say it as an event when a controller can no longer take charge, or can again.

        Args:
            controller: whose.
            reason: why it could not; empty if it could.
        """
        before = self._unready.get(controller, "")
        if before == reason:
            return
        data: dict[str, object] = {"controller": controller, "reason": reason}
        if reason:
            self._unready[controller] = reason
            self._say(Level.WARNING, "not_ready", f"{controller} is not ready: {reason}", data)
        else:
            del self._unready[controller]
            self._say(Level.INFO, "ready", f"{controller} is ready again", data)

    def _latch(self, on: bool) -> None:
        self.latched = on
        outgoing = self._drive.active
        if on:
            self.drop_all(LATCHED)
            self._drive.hand_over("")
            words = f"brake latched; {outgoing or 'nobody'} was in charge"
            self._say(Level.WARNING, "brake_latched", words, {"from": outgoing, "to": ""})
        else:
            words = "brake released; it stays on until somebody is switched in"
            self._say(Level.INFO, "brake_released", words, {})

    def _drop(self, request: SwitchRequest, tick: int, why: str) -> None:
        words = f"switch to {request.controller} dropped: {why}"
        data = {"controller": request.controller, "reason": why, "due": request.tick}
        self._say(Level.WARNING, "switch_dropped", words, data)
        self._result(request, tick, words)

    def _result(self, request: SwitchRequest, tick: int, words: str) -> None:
        nothing = np.zeros(self._drive.demand.size)
        self.results.append(SwitchResult(request, False, words, tick, nothing))
