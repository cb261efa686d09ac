"""Plans whose efforts end at the goal are refused where springs or loads push it away."""

import re

import numpy as np
import pytest
from tests.plants import plant
from tests.present import present

from flexslew_control.planners import make_plan, plan_settings
from flexslew_plant.errors import BadInput
from flexslew_plant.testbeds import read_testbed


@pytest.mark.parametrize("goal", [0.25, 1.0])
@pytest.mark.parametrize("method", ["minimax_feedforward", "robust_feedforward", "time_optimal"])
def test_a_goal_at_which_nothing_rests_without_an_effort_is_refused(
    method: str, goal: float
) -> None:
    """A load of 100 N against a spring of 100 + 10 sin(2 pi t) N/m, seen in part."""
    force = np.abs(np.array([90.0, 110.0]) * goal - 100.0).max()
    testbed = read_testbed({"kind": "varying_oscillator"}, "t")
    section = plan_settings({"method": method, "goal": {"mass": goal}}, "t")
    with pytest.raises(BadInput, match="use method reference_only") as caught:
        make_plan(section, plant(0.05, testbed.effort_limit, testbed))
    said = re.search(r"goal: .*\(up to mass ([\d.]+) \[N", str(caught.value))
    assert 0.3 * force < float(present(said)[1]) <= 1.001 * force
    assert "\n" not in str(caught.value)
