"""A state that leaves the finite numbers: when, where first, and why most likely."""

from math import hypot

import numpy as np

from flexslew_plant.arrays import Vector
from flexslew_plant.events import TurnsFar
from flexslew_plant.testbeds.model import Model

FARTHEST = 1e15  # an angle beyond it has not even its first digit left
STABLE_TURN = 5.96  # largest period times frequency that the integration of order 8 can follow


def too_fast(model: Model, q: Vector, period: float) -> TurnsFar | None:
    """Return that a mode turns by more than half a turn in a tick; None: none does.

    At half a turn every step of the integration of order 8 loses 0.24 % of its vibration.

    Args:
        model: equations of motion.
        q: at rest, shape (positions,).
        period: one tick [s].
    """
    fastest = float(max(model.linearise(q).frequencies, default=0.0))
    if period * fastest <= np.pi:
        return None
    return TurnsFar(fastest, period * fastest, 3.0 / fastest)


def is_lost(x: Vector) -> bool:
    """Return whether a state is not finite, or so far away that it says nothing."""
    return not hypot(*x.tolist()) < FARTHEST


def diagnosis(
    model: Model,
    before: Vector,
    after: Vector,
    disturbance: Vector,
    limit: Vector,
    active: str,
    period: float,
) -> tuple[str, str]:
    """Return the coordinate that is lost and the likely cause.

    Args:
        model: equations of motion.
        before: the last state, [q, v], shape (2 n,).
        after: the state a tick later, lost.
        disturbance: on each joint over that tick, shape (joints,) [N m or N].
        limit: of each drive, shape (joints,) [N m or N].
        active: controller in charge; empty: the brake.
        period: one tick [s].
    """
    names = model.state_names
    lost = ~(np.abs(after) < FARTHEST)
    # where one is lost, soon all are: then the one that was largest is told
    first = int(np.argmax(np.abs(before) if lost.all() else lost))
    where = f"{names[first]} was {before[first]:.3g} before"
    q, modes = model.split(before)[0], model.modes
    rest = np.concatenate((q[: q.size - modes], np.zeros(modes)))
    fastest = max(model.linearise(rest).frequencies, default=0.0)
    if period * fastest > STABLE_TURN:
        return where, (
            f"a period of {period:.6g} s is too long for its fastest mode of {fastest:.4g} rad/s; "
            f"take at most {STABLE_TURN / fastest:.2g} s, or fewer modes"
        )
    beyond = ~(np.abs(disturbance) <= limit)
    if beyond.any():
        joint = int(np.argmax(beyond))
        return where, (
            f"a disturbance of {disturbance[joint]:.3g} on {model.joint_names[joint]}, "
            f"whose limit is {limit[joint]:.3g}"
        )
    return where, f"{active or 'the brake'} does not stabilise it"
