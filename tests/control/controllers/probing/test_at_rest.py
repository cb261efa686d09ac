"""What laws that hold a rest say of plans."""

import numpy as np

from flexslew_control.controllers.probing.at_rest import plan_motion_error
from flexslew_control.plan import Plan


def to(goal: float) -> Plan:
    position, none = np.array([[1.0], [goal]]), np.zeros((1, 0))
    return Plan(
        "reference_only", ("yaw",), 0.0, 0.1, position, 0.0 * position, position[:1], none, 0.1
    )


def test_a_slew_by_an_arcsecond_moves_wherever_it_starts() -> None:
    assert plan_motion_error(None, np.ones(1)) == ""
    assert plan_motion_error(to(1.0), np.ones(1)) == ""
    assert "moving" in plan_motion_error(to(1.0 + np.deg2rad(1.0 / 3600.0)), np.ones(1))
