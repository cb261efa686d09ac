"""Whether a testbed rests at the goal of a slew by itself, for plans without effort afterwards."""

import numpy as np

from flexslew_control.planners.slew import Slew
from flexslew_plant.errors import BadInput

_NO_FORCE = 1e-3  # of a drive's limit, that feedback holds at the goal, as a gravity gradient [-]
_SAMPLE_TIMES = 0.618034 * np.arange(32) % 1.0  # in step with no period [-]
_AFTER = 0.02  # of a slew's duration, in which forces that vary with time are looked at [-]


def require_rest(slew: Slew, end: float) -> None:
    """Check that the testbed rests at the goal by itself: efforts end when the slew does.

    Args:
        slew: the requested slew.
        end: end of the slew after its start [s].

    Raises:
        BadInput: if springs or loads move it from there.
    """
    goal = slew.model.rest(slew.named(slew.goal))
    zero_rates, joints = np.zeros(slew.model.coordinates), slew.goal.size
    bias = [
        slew.model.bias(goal, zero_rates, t)[:joints] for t in end * (1.0 + _AFTER * _SAMPLE_TIMES)
    ]
    force = np.abs(bias).max(axis=0)
    if (force > _NO_FORCE * slew.effort_limit).any():
        forces = ", ".join(f"{name} {value:.3g}" for name, value in slew.named(force).items())
        raise BadInput(
            f"efforts end with the slew, but springs or loads push the joints away from there "
            f"(up to {forces} [N or N m]); use method reference_only, whose controller holds them",
            "plan",
            "goal",
            slew.named(slew.goal),
        )
