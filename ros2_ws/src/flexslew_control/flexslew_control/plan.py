"""A Plan: the manoeuvre on the ticks of the bench, with what it came from."""

from dataclasses import dataclass, field
from typing import Any

import numpy as np

from flexslew_control.law import Reference
from flexslew_plant.arrays import Matrix, Vector


@dataclass(frozen=True)
class Plan:
    """Reference and feedforward at every tick from start to end; at rest before and after.

    Args:
        method: the planner that made it, a key of PLANNERS.
        joint_names: whose columns follow.
        start: first tick's simulated time [s].
        period: one tick [s].
        position: joint references at the ticks, shape (ticks + 1, joints) [rad or m].
        velocity: shape (ticks + 1, joints) [rad/s or m/s].
        effort: feedforward, its mean over each tick, shape (ticks, joints) [N m or N].
        state: nominal state of the planner's model, shape (ticks + 1, 2 n); or (ticks + 1, 0).
        duration: length of the manoeuvre [s]; the last tick may end after it.
        request: the `plan` section that asked for it, with model and manoeuvre, as plain data.
        summary: objective, iterations, switch_times, ... as plain data; what --json prints.
        versions: of the software that made it.
    """

    method: str
    joint_names: tuple[str, ...]
    start: float
    period: float
    position: Matrix
    velocity: Matrix
    effort: Matrix
    state: Matrix
    duration: float
    request: dict[str, Any] = field(default_factory=dict)
    summary: dict[str, Any] = field(default_factory=dict)
    versions: dict[str, str] = field(default_factory=dict)

    @property
    def ticks(self) -> int:
        """How many ticks the manoeuvre takes."""
        return len(self.effort)

    @property
    def end(self) -> float:
        """Simulated time at which the manoeuvre is over [s]."""
        return self.start + self.duration

    def reference(self, tick: int) -> Reference:
        """Return the reference of the bench's tick (counted from simulated time zero)."""
        k = tick - round(self.start / self.period)
        if 0 <= k < self.ticks:
            return Reference(
                self.position[k], self.velocity[k], self.effort[k], self.state[k], self.state[k + 1]
            )
        k = 0 if k < 0 else self.ticks
        rest = np.zeros(len(self.joint_names))
        state = self.state[k] if k == 0 else self._final
        return Reference(self.position[k], rest, rest, state, state)

    @property
    def _final(self) -> Vector:
        """The nominal state after the end: the last one with straight appendages at rest."""
        final = np.zeros(self.state.shape[1])
        joints = len(self.joint_names) if final.size else 0
        final[:joints] = self.position[-1]
        return final
