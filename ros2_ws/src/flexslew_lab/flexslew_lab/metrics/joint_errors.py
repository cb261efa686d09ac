"""How far the joints are from their goal, after the manoeuvre and at its end."""

from collections.abc import Mapping
from typing import Any, ClassVar, NamedTuple

import numpy as np

from flexslew_lab.metrics.metric import (
    Block,
    Ending,
    Key,
    MetricEntry,
    ReferenceManoeuvre,
    RunSetup,
    ready,
)
from flexslew_lab.metrics.settling import goal_displacement
from flexslew_plant.arrays import Vector
from flexslew_plant.testbeds.orientation.attitude import AttitudeJoints


class ErrorExtremes(NamedTuple):
    """What one or more runs have accumulated; errors are joint position - goal."""

    residual: Vector  # largest |error| after the end, (..., joints); -inf: it has not ended
    first: Vector  # error at the first tick, (..., joints); NaN: there is no goal
    final: Vector  # error at the last tick, (..., joints)
    rate: Vector  # of the joints at the last tick, (..., joints)
    terminal: Vector  # norm of errors, modes and rates at the end, (...,); NaN: it has not ended


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
        unknown = np.full(len(setup.joint_names), np.nan)
        self.extremes = ErrorExtremes(unknown - np.inf, *3 * (unknown,), np.array(np.nan))

    def add(self, block: Block) -> None:
        """Take the next ticks."""
        if block.error is None:
            return
        residual, first, _, rate, terminal = self.extremes
        if np.isnan(first).all():
            first = block.error[0].copy()
        if block.over.any():
            if not np.isfinite(residual).any():
                k = int(np.argmax(block.over))
                rest = self._modes_and_rates(block.position[k], block.velocity[k])
                terminal = np.asarray(np.linalg.norm(np.concatenate((block.error[k], rest))))
            residual = np.fmax(residual, abs(block.error[block.over]).max(axis=0))
        if self._setup.manoeuvre.rate is not None:
            rate = self._joint_rates(block.position[-1], block.velocity[-1])
        self.extremes = ErrorExtremes(residual, first, block.error[-1].copy(), rate, terminal)

    def _joint_rates(self, q: Vector, v: Vector) -> Vector:
        if self._setup.testbed is None:
            return v[: len(self._setup.joint_names)].copy()
        return self._setup.testbed.model().joint_state(np.concatenate((q, v)))[1].copy()

    def _modes_and_rates(self, q: Vector, v: Vector) -> Vector:
        """Return modal positions, joint rates and modal rates; a wheel may go on spinning."""
        if self._setup.testbed is None:
            return np.concatenate((q[len(self._setup.joint_names) :], v))
        model = self._setup.testbed.model()
        x = np.concatenate((q, v))
        modes, modal_rates = model.modal_state(x)
        return np.concatenate((modes, model.joint_state(x)[1], modal_rates))

    def result(self, ending: Ending) -> dict[str, Any]:
        """Return the four values."""
        testbed, manoeuvre = self._setup.testbed, self._setup.manoeuvre
        attitude = None if testbed is None else testbed.model().attitude
        return ready(self._setup, self.KEYS, error_values(manoeuvre, attitude, self.extremes))


def error_values(
    manoeuvre: ReferenceManoeuvre, attitude: AttitudeJoints | None, extremes: ErrorExtremes
) -> dict[str, Vector]:
    """Return the values of one or more runs by key, shapes (..., joints) and (...,).

    Args:
        manoeuvre: that they flew.
        attitude: of one run, the joints that read it; None: there is none.
        extremes: of the runs; what is not finite in them is unknown.
    """
    residual, *ends, terminal = extremes
    has_ended = np.isfinite(residual).any(axis=-1)
    return {
        "residual_attitude_error": residual,
        "final_error": extremes.final,
        "goal_error": np.where(has_ended, goal_errors(manoeuvre, attitude, *ends), np.nan),
        "terminal_error_norm": terminal,
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


JOINT_ERRORS = MetricEntry(JointErrors, needs_truth=False)
