"""The objection of a law that only holds a rest to a plan that moves."""

import numpy as np

from flexslew_control.plan import Plan
from flexslew_plant.arrays import Vector


def plan_motion_error(plan: Plan | None, rest: Vector) -> str:
    """Return why a law that holds a rest does not fly a plan, or an empty text.

    Args:
        plan: None: none, so nothing moves.
        rest: joint positions, shape (m,) [rad or m].
    """
    if plan is None or np.allclose(plan.position_range, rest, rtol=0.0):
        return ""
    return "it cannot follow a moving reference: it holds the testbed at rest"
