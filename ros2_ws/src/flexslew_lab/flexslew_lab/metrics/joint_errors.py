"""How far the joints are from their goal, after the manoeuvre and at its end."""

from collections.abc import Mapping
from typing import Any, ClassVar

import numpy as np

from flexslew_lab.metrics.metric import (
    Block,
    Ending,
    Key,
    MetricEntry,
    ReferenceManoeuvre,
    RunSetup,
    by_joint,
)
from flexslew_lab.metrics.settling import goal_displacement
from flexslew_plant.arrays import Vector
from flexslew_plant.testbeds.attitude import AttitudeJoints


class JointErrors:
    """Implements Metric; None where there is no goal, or where the log ends too early."""

    KEYS: ClassVar[Mapping[str, Key]] = {
        "residual_attitude_error": Key(
            "rad or m", True, "largest |joint position - goal| after the end of the manoeuvre"
        ),
        "final_error": Key("rad or m", True, "joint position - goal at the last tick"),
        "goal_error": Key(
            "-",
            False,
            "largest |final error| of a joint that moves, as a share of its commanded move, of an "
            "attitude its angle as a share of the commanded angle; of a plan that ends in motion "
            "the angle left in rad, or the error of the rates as a share of them, whichever is "
            "larger; null: none moves, or the manoeuvre has not ended",
        ),
        "terminal_error_norm": Key(
            "mixed SI",
            False,
            "norm of (joint errors, modal positions, their rates) at the end of the manoeuvre",
        ),
    }

    def __init__(self, setup: RunSetup) -> None:
        self._setup = setup
        self.residual = np.full(len(setup.joint_names), np.nan)
        self.first, self.final = self.residual.copy(), self.residual.copy()
        self._last_rate = self.residual.copy()
        self.terminal: float | None = None

    def add(self, block: Block) -> None:
        """Take the next ticks."""
        if block.error is None:
            return
        if np.isnan(self.first).all():
            self.first = block.error[0].copy()
        if block.over.any():
            largest = abs(block.error[block.over]).max(axis=0)
            self.residual = np.fmax(self.residual, largest)
            if self.terminal is None:
                k = int(np.argmax(block.over))
                rest = self._modes_and_rates(block.position[k], block.velocity[k])
                self.terminal = float(np.linalg.norm(np.concatenate((block.error[k], rest))))
        self.final = block.error[-1].copy()
        if self._setup.manoeuvre.rate is not None:
            self._last_rate = self._joint_rates(block.position[-1], block.velocity[-1])

    def _joint_rates(self, q: Vector, v: Vector) -> Vector:
        if self._setup.testbed is None:
            return v[: len(self.residual)].copy()
        return self._setup.testbed.model().joint_state(np.concatenate((q, v)))[1].copy()

    def _modes_and_rates(self, q: Vector, v: Vector) -> Vector:
        """Return modal positions, joint rates and modal rates; a wheel may go on spinning."""
        if self._setup.testbed is None:
            return np.concatenate((q[len(self.residual) :], v))
        model = self._setup.testbed.model()
        x = np.concatenate((q, v))
        modes, modal_rates = model.modal_state(x)
        return np.concatenate((modes, model.joint_state(x)[1], modal_rates))

    def _goal_error(self) -> float | None:
        testbed, manoeuvre = self._setup.testbed, self._setup.manoeuvre
        attitude = None if testbed is None else testbed.model().attitude
        if not np.isfinite(self.residual).any():
            return None
        error = float(goal_errors(manoeuvre, attitude, self.first, self.final, self._last_rate))
        return error if np.isfinite(error) else None

    def result(self, ending: Ending) -> dict[str, Any]:
        """Return the four values."""
        return {
            "residual_attitude_error": by_joint(self._setup, self.residual),
            "final_error": by_joint(self._setup, self.final),
            "goal_error": self._goal_error(),
            "terminal_error_norm": self.terminal,
        }


def goal_errors(
    manoeuvre: ReferenceManoeuvre,
    attitude: AttitudeJoints | None,
    first: Vector,
    final: Vector,
    rate: Vector,
) -> Vector:
    """Return the goal error of one or more runs, shape (...,) [-]; NaN: nothing moves.

    Args:
        manoeuvre: that they flew.
        attitude: of one run, the joints that read it; None: there is none.
        first: error of the joints at the start, (..., joints).
        final: at the last tick, (..., joints).
        rate: of the joints at the last tick, (..., joints).
    """
    if manoeuvre.rate is not None:
        return _in_motion(manoeuvre.rate, attitude, final, rate)
    move = goal_displacement(manoeuvre.displacement, first)
    has_move = move != 0.0
    if attitude is not None and has_move.sum() > 1:
        return np.asarray(attitude.share(final, move).max())
    share = np.where(has_move, np.abs(final / np.where(has_move, move, 1.0)), -1.0).max(axis=-1)
    return np.where(has_move.any(axis=-1), share, np.nan)


def _in_motion(
    goal: Vector, attitude: AttitudeJoints | None, final: Vector, rate: Vector
) -> Vector:
    """Return the larger share of what is left of angle and rates, where the plan ends moving.

    The share of the way means little there: after a whole turn nothing is left of any error.
    """
    rows = (final, rate - goal, goal)
    rotations = rows if attitude is None else tuple(map(attitude.rotation_vector_of, rows))
    left, off, whole = (np.linalg.norm(rotation, axis=-1) for rotation in rotations)
    return np.asarray(np.maximum(left, off / whole))


JOINT_ERRORS = MetricEntry(JointErrors)
