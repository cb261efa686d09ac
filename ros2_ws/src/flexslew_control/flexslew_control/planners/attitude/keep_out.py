"""Whether a plan keeps out of the cones in the sky that axes of the platform must not look into."""

import numpy as np

from flexslew_control.plan import Plan
from flexslew_plant.errors import PlanFailed
from flexslew_plant.testbeds import Testbed
from flexslew_plant.testbeds.contract import HasSky

_TOLERANCE = 1e-9  # rounding [rad]


def require_clear(plan: Plan, testbed: Testbed) -> None:
    """Refuse a plan with a reference that turns a boresight into a cone.

    Args:
        plan: the plan for the joints of the testbed.
        testbed: the testbed that flies it; only a free platform has cones.

    Raises:
        PlanFailed: if a boresight enters a cone; the message gives the time and the angle.
    """
    sky = testbed.sky() if isinstance(testbed, HasSky) else None
    joints = testbed.model().attitude
    if sky is None or joints is None or not sky.cones or not len(plan.position):
        return
    attitude = joints.orientation(plan.position)
    for cone in sky.cones:
        margin = cone.margin(attitude)
        ticks = np.flatnonzero(margin < -_TOLERANCE)
        if ticks.size:
            begin = plan.start + plan.period * ticks[0]
            raise PlanFailed(
                f"the plan looks into keep_out {cone.name} from {begin:g} s on, by "
                f"{-margin.min():.3g} rad at most; time_optimal and minimax_feedforward with "
                "drives: all go round it"
            )
