"""The curves of an earlier run: drawn beside those of now, compared by their own names."""

import numpy as np

from flexslew_lab.console.history import Curve
from flexslew_lab.console.panels import compare


def test_curves_are_compared_by_their_own_names_on_common_ticks() -> None:
    now = {"position": [Curve("yaw", np.array([0.0, 0.1, 0.2]), np.array([0.0, 1.0, 2.0]))]}
    earlier = {"position": [Curve("yaw", np.array([0.1, 0.2, 0.3]), np.array([1.5, 2.0, 9.0]))]}
    assert compare.largest_difference(now, earlier) == "largest difference: position 0.5 (yaw)"
    assert "no common tick" in compare.largest_difference(now, {})


def test_a_run_whose_joint_is_called_earlier_is_compared_too() -> None:
    curve = Curve("earlier yaw", np.array([0.0]), np.array([1.0]))
    same = {"position": [curve]}
    assert compare.largest_difference(same, same) == "largest difference: position 0 (earlier yaw)"
    beside = compare.beside(curve)
    assert (beside.label, beside.dashed) == ("earlier earlier yaw", True)
