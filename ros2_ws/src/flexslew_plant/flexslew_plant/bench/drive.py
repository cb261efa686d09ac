"""The drive: checks every answer, holds the last good one, falls back and brakes."""

from collections import Counter
from math import isfinite

import numpy as np

from flexslew_plant.arrays import Vector
from flexslew_plant.bench.measurement import EffortCommand, Measurement


class Drive:
    """Who may command the motors, and what they do when nobody does.

    Args:
        active: the controller in charge at the start.
        fallback: who takes over in turn when answers fail to come.
        max_missed: ticks in a row without a valid answer before that happens.
        brake: viscous coefficient of each joint's own brake, shape (joints,) [N m s/rad].
    """

    def __init__(
        self, active: str, fallback: tuple[str, ...], max_missed: int, brake: Vector
    ) -> None:
        self._start = (active, fallback)
        self._max_missed, self._brake = max_missed, brake
        self.reset()

    def reset(self) -> None:
        """Return to the state of the start."""
        self.active, chain = self._start
        self._chain = list(chain)
        self.demand: Vector = np.zeros(self._brake.size)  # last good answer [N m or N]
        self.missed_in_a_row = 0
        self.missed = 0
        self.rejected: Counter[str] = Counter()

    def objection(self, question: Measurement, command: EffortCommand) -> tuple[str, str] | None:
        """Return why the command is not an answer to the question (kind, words), or None."""
        kind, words = "", ""
        if command.controller != question.controller:
            asked = question.controller or "nobody, the brake is on"
            kind, words = "sender", f"{command.controller} answered, asked was {asked}"
        elif command.epoch != question.epoch or command.tick != question.tick:
            kind = "stale"
            words = (
                f"answer to tick {command.tick} of epoch {command.epoch}, "
                f"asked was tick {question.tick} of epoch {question.epoch}"
            )
        elif command.effort.shape != self._brake.shape:
            kind = "size"
            words = f"{command.effort.size} efforts for {self._brake.size} joints"
        elif not all(map(isfinite, command.effort.tolist())):
            kind, words = "finite", f"effort {command.effort.tolist()} is not finite"
        else:
            return None
        self.rejected[kind] += 1
        return kind, words

    def take(self, effort: Vector) -> None:
        """Hold this checked effort."""
        self.demand = effort
        self.missed_in_a_row = 0

    def miss(self) -> str | None:
        """Count a tick without a valid answer.

        Returns:
            the next controller of the fallback chain ("" is the brake) if it must take over now.
        """
        if not self.active:
            return None
        self.missed += 1
        self.missed_in_a_row += 1
        if self.missed_in_a_row < self._max_missed:
            return None
        return self._chain.pop(0) if self._chain else ""

    def hand_over(self, controller: str) -> None:
        """Put a controller in charge; "" is the brake."""
        self.active = controller
        self.missed_in_a_row = 0

    def effort(self, velocity: Vector) -> Vector:
        """Return the effort to ask of the motors, shape (joints,) [N m or N]."""
        return self.demand if self.active else -self._brake * velocity
