"""The drive: checks every answer, holds the last effort, and brakes without a controller."""

from collections import Counter, deque
from math import isfinite

import numpy as np

from flexslew_plant.arrays import Vector
from flexslew_plant.events.run import RejectionReason
from flexslew_plant.measurement import EffortCommand, Measurement

_HISTORY_SIZE = 64  # answers; a question that was repeated is answered more than once


class Drive:
    """Checks the commands to the motors; holds the last effort or brakes without a valid one.

    Args:
        active: the controller in charge at the start.
        max_missed: ticks in a row without a valid answer before another controller must take over.
        brake: viscous coefficient of each joint's own brake, shape (joints,) [N m s/rad].
    """

    def __init__(self, active: str, max_missed: int, brake: Vector) -> None:
        self._start = active
        self._max_missed, self._brake = max_missed, brake
        self.reset()

    def reset(self) -> None:
        """Return to the state of the start."""
        self.active = self._start
        self.demand: Vector = np.zeros(self._brake.size)  # last requested effort [N m or N]
        self.missing_ticks = 0
        self.missed = 0
        self.rejected: Counter[RejectionReason] = Counter()
        self._accepted: deque[EffortCommand] = deque(maxlen=_HISTORY_SIZE)

    def is_repeat(self, command: EffortCommand) -> bool:
        """Return whether this very answer was given already: the question had been repeated."""
        return any(
            command[:3] == other[:3] and np.array_equal(command.effort, other.effort)
            for other in self._accepted
        )

    def objection(
        self, question: Measurement, command: EffortCommand
    ) -> tuple[RejectionReason, str] | None:
        """Return why the command is not an answer to the question, also in words, or None."""
        if command.controller != question.controller:
            expected = question.controller or "none, the brake is on"
            kind, words = (
                RejectionReason.SENDER,
                f"{command.controller} answered, expected {expected}",
            )
        elif command.epoch != question.epoch or command.tick != question.tick:
            kind = RejectionReason.STALE
            words = (
                f"answer to tick {command.tick} of epoch {command.epoch}, "
                f"expected tick {question.tick} of epoch {question.epoch}"
            )
        elif command.effort.shape != self._brake.shape:
            kind = RejectionReason.SIZE
            words = f"{command.effort.size} efforts for {self._brake.size} joints"
        elif not all(map(isfinite, command.effort.tolist())):
            kind, words = RejectionReason.FINITE, f"effort {command.effort.tolist()} is not finite"
        else:
            self._accepted.append(command)
            return None
        return kind, words

    def take(self, effort: Vector) -> None:
        """Hold this checked effort."""
        self.demand = effort
        self.missing_ticks = 0

    def miss(self) -> bool:
        """Count a tick without a valid answer; return whether another one must take over now."""
        over = self.one_miss_left
        self.missed += 1
        self.missing_ticks += 1
        return over

    @property
    def one_miss_left(self) -> bool:
        """Whether another controller must take over if this tick is missed too."""
        return self.missing_ticks + 1 >= self._max_missed

    def set_active(self, controller: str) -> None:
        """Put a controller in charge; "" is the brake."""
        self.active = controller
        self.missing_ticks = 0

    def effort(self, velocity: Vector) -> Vector:
        """Return the demanded effort of the motors, shape (joints,) [N m or N].

        That of the brake is held, too, until a newcomer has answered: the last demand of the
        controller before the brake is long out of date.
        """
        if not self.active:
            self.demand = -self._brake * velocity
        return self.demand
