"""The steps of a tick, and a state that leaves the finite numbers: where, and the likely cause."""

from math import hypot
from typing import NamedTuple

import numpy as np

from flexslew_plant.arrays import Vector
from flexslew_plant.events import FastMode
from flexslew_plant.testbeds.integration_error import (
    COARSE,
    UNBOUNDED_TICKS,
    rounded_down,
    run_error,
    steps_per_tick,
)
from flexslew_plant.testbeds.model import Model

STATE_LIMIT = 1e15  # an angle beyond it has not even its first digit left
STABLE_STEP = 5.96  # largest step times frequency at which the integration of order 8 is stable


class TickSteps(NamedTuple):
    """How a tick is integrated."""

    steps: int  # equal ones
    warning: FastMode | None  # None: no mode turns far in a tick


def integration_of(
    model: Model, q: Vector, period: float, duration: float, given: int | None = None
) -> TickSteps:
    """Return how ticks are integrated, the same on the bench and in batches.

    Args:
        model: equations of motion.
        q: at rest, shape (positions,).
        period: one tick [s].
        duration: of the run [s]; 0: without an end.
        given: steps in a tick; None: as many as keep the error small.

    Raises:
        BadInput: the period is too long for the fastest mode.
    """
    poles = model.integrated_poles(q)
    steps = steps_per_tick(poles, period, duration) if given is None else given
    max_frequency = float(abs(poles).max(initial=0.0))
    if max_frequency * period <= COARSE * (1.0 + 1e-9):
        return TickSteps(steps, None)
    run_time = duration or UNBOUNDED_TICKS * period
    error = run_error(poles, period / steps, run_time)
    max_period = rounded_down(COARSE / max_frequency)
    return TickSteps(
        steps, FastMode(max_frequency, max_frequency * period, max_period, steps, error)
    )


def is_lost(x: Vector) -> bool:
    """Return whether a state is not finite, or too far away to mean anything."""
    return not hypot(*x.tolist()) < STATE_LIMIT


def diagnosis(
    model: Model,
    before: Vector,
    after: Vector,
    disturbance: Vector,
    limit: Vector,
    active: str,
    step: float,
) -> tuple[str, str]:
    """Return the coordinate that is lost and the likely cause.

    Args:
        model: equations of motion.
        before: the last state, [q, v], shape (2 n,).
        after: the state a tick later, lost.
        disturbance: on each joint over that tick, shape (joints,) [N m or N].
        limit: of each drive, shape (joints,) [N m or N].
        active: controller in charge; empty: the brake.
        step: of the integration [s].
    """
    names = model.state_names
    lost = ~(np.abs(after) < STATE_LIMIT)
    # one lost state soon makes all lost: then the largest one before is reported
    first = int(np.argmax(np.abs(before) if lost.all() else lost))
    where = f"{names[first]} was {before[first]:.3g} before"
    max_frequency = _max_frequency(model, before)
    if step * max_frequency > STABLE_STEP:
        return where, (
            f"an integration step of {step:.6g} s is too long for the fastest mode of "
            f"{max_frequency:.4g} rad/s; take at most {rounded_down(COARSE / max_frequency):g} s: "
            "more "
            "integration_steps, a shorter period or fewer modes"
        )
    above_limit = ~(np.abs(disturbance) <= limit)
    if above_limit.any():
        joint = int(np.argmax(above_limit))
        return where, (
            f"a disturbance of {disturbance[joint]:.3g} on {model.joint_names[joint]}, "
            f"whose limit is {limit[joint]:.3g}"
        )
    return where, f"{active or 'the brake'} does not stabilise it"


def _max_frequency(model: Model, x: Vector) -> float:
    """Return the fastest frequency of small motions near a state [rad/s]; 0 of a black box."""
    if not model.has_equations:
        return 0.0
    q, modes = model.split(x)[0], model.modes
    rest = np.concatenate((q[: q.size - modes], np.zeros(modes)))
    return max(model.linearise(rest).frequencies, default=0.0)
