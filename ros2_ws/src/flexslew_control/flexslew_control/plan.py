"""A Plan: the manoeuvre on the ticks of the bench, with what it came from."""

from dataclasses import dataclass, field, fields, replace
from functools import cached_property
from typing import Any

import numpy as np

from flexslew_control.law import Reference
from flexslew_plant.arrays import EMPTY, Matrix, Vector, read_only, read_only_view
from flexslew_plant.notebook_table import in_notebook


@dataclass(frozen=True, eq=False, repr=False)  # as an array, two are the same by plan_hash
class Plan:
    """Reference and feedforward at every tick from start to end; at rest before and after.

    Args:
        method: the planner that made it, a key of PLANNERS.
        joint_names: names of the columns that follow.
        start: first tick's simulated time [s].
        period: one tick [s].
        position: joint references at the ticks, shape (ticks + 1, joints) [rad or m].
        velocity: shape (ticks + 1, joints) [rad/s or m/s].
        effort: feedforward, its mean over each tick, shape (ticks, joints) [N m or N].
        state: nominal state of the planner's model, shape (ticks + 1, 2 n); or (ticks + 1, 0).
        duration: length of the manoeuvre [s]; the last tick may end after it.
        gains: of a law, row by row for each tick and then for all after the end, shape
            (ticks + 1, k); or (0, 0): the plan has none.
        request: the `plan` section it was made from, with model and manoeuvre, as plain data.
        summary: objective, iterations, switch_times, ... as plain data; what --json prints.
        versions: versions of the software that made it.
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
    gains: Matrix = field(default_factory=lambda: np.zeros((0, 0)))
    request: dict[str, Any] = field(default_factory=dict)
    summary: dict[str, Any] = field(default_factory=dict)
    versions: dict[str, str] = field(default_factory=dict)

    def __post_init__(self) -> None:
        """Make the arrays read-only."""
        for item in fields(self):
            value = getattr(self, item.name)
            if isinstance(value, np.ndarray):
                object.__setattr__(self, item.name, read_only_view(value))

    def __setstate__(self, state: dict[str, Any]) -> None:
        """Restore a plan from another process, with arrays that are writable when they arrive."""
        self.__dict__.update(state)
        self.__post_init__()

    def __repr__(self) -> str:
        """Return one line: what moves, when."""
        joints = ", ".join(self.joint_names)
        return f"<Plan {self.method} of {joints}: {self.duration:g} s from {self.start:g} s on>"

    def _repr_html_(self) -> str:
        """Return the motion of each joint, for notebooks."""
        columns = ("joint", "from", "to", "largest rate", "largest effort")
        parts = (self.position[0], self.position[-1], *map(_largest, (self.velocity, self.effort)))
        numbers = ((f"{value:.4g}" for value in row) for row in zip(*parts, strict=True))
        rows = ((name, *row) for name, row in zip(self.joint_names, numbers, strict=True))
        return in_notebook(repr(self), columns, rows)

    @property
    def ticks(self) -> int:
        """How many ticks the manoeuvre takes."""
        return len(self.effort)

    @property
    def end(self) -> float:
        """Simulated time at which the manoeuvre is over [s]."""
        return self.start + self.duration

    @cached_property
    def position_range(self) -> Matrix:
        """Smallest and largest reference of each joint, shape (2, joints) [rad or m]."""
        return read_only(np.array((self.position.min(axis=0), self.position.max(axis=0))))

    def reference(self, tick: int) -> Reference:
        """Return the reference of the bench's tick (counted from simulated time zero)."""
        k = tick - self.first_tick
        if k < 0:
            return self._before
        if k >= len(self.effort):
            return self._after
        return Reference(
            self.position[k],
            self.velocity[k],
            self.effort[k],
            self.state[k],
            self.state[k + 1],
            self._gains(k),
        )

    @cached_property
    def first_tick(self) -> int:
        """The tick of the bench at which it starts."""
        return round(self.start / self.period)

    @cached_property
    def _before(self) -> Reference:
        return self._at_rest(self.position[0], self.state[0], 0)

    @cached_property
    def _after(self) -> Reference:
        """The last position, its nominal state with straight appendages at rest."""
        final = np.zeros(self.state.shape[1])
        if final.size and (self._single_joint or final.size < 2 * len(self.joint_names)):
            final[0] = self.state[-1, 0]
        elif final.size:
            final[: len(self.joint_names)] = self.position[-1]
        return self._at_rest(self.position[-1], final, -1)

    @property
    def _single_joint(self) -> bool:
        """Whether the nominal states are those of a turn about one of many joints."""
        goal = self.request.get("goal")
        return isinstance(goal, dict) and 0 < len(goal) < len(self.joint_names)

    def _at_rest(self, position: Vector, state: Vector, row: int) -> Reference:
        rest = read_only(np.zeros(len(self.joint_names)))
        return Reference(
            position, rest, rest, read_only_view(state), read_only_view(state), self._gains(row)
        )

    def _gains(self, row: int) -> Vector:
        return self.gains[row] if len(self.gains) else EMPTY


def with_warning(plan: Plan, words: str) -> Plan:
    """Return the plan with a warning in its summary, after those that it has."""
    every = "; ".join(filter(None, (plan.summary.get("warning"), words)))
    return replace(plan, summary={**plan.summary, "warning": every})


def _largest(rows: Matrix) -> Vector:
    """Return the largest size in each column."""
    return np.asarray(np.abs(rows).max(axis=0, initial=0.0))
