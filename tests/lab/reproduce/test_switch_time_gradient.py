from typing import Any

import numpy as np
import pytest

from flexslew_control.planners.time_optimal.switching import linear_durations
from flexslew_lab.reproduce.switch_time_gradient import gradients, switch_time_optimisation
from flexslew_lab.reproduce.time_optimal import _SLEWS, _slew
from flexslew_plant.errors import PlanFailed
from flexslew_plant.testbeds.hub_with_appendages import FOOT_POUND, HubTestbed

NAMES = [name for name in _SLEWS if name != "CSA yaw, robust"]


@pytest.mark.parametrize("name", NAMES)
def test_it_finds_the_published_switch_times_from_elsewhere(name: str) -> None:
    testbed, distance, amplitude, robust, _, times = _SLEWS[name]
    of = _slew(testbed, distance, amplitude, robust)
    wrong = 1.0 + 0.03 * np.cos(np.arange(len(times)))
    found = switch_time_optimisation(of, linear_durations(of) * wrong)
    assert np.cumsum(found.durations) == pytest.approx(times, abs=1e-6)
    assert found.residual <= 1e-9


def five_switches(of: Any) -> Any:
    return of.rigid_duration / 2.0 * np.array([0.6, 0.02, 0.4, 0.4, 0.02, 0.6])


def test_it_shortens_a_slew_with_more_switches_than_end_conditions() -> None:
    of = _slew(HubTestbed(), 2.0, 10.0 * FOOT_POUND, False)
    found = switch_time_optimisation(of, five_switches(of))
    assert found.durations.sum() == pytest.approx(3.80453683, abs=1e-6)
    assert found.iterations > 0


@pytest.mark.parametrize("robust", [False, True])
def test_gradients_by_costates_are_those_by_forward_sensitivities(robust: bool) -> None:
    of = _slew(HubTestbed(), 1.0, 2.0 * FOOT_POUND, robust)
    d = linear_durations(of)
    by_duration = of.residual_jacobian(d)[1]
    # t_k is the end of arc k and the beginning of arc k + 1
    by_switch = by_duration - np.column_stack((by_duration[:, 1:], np.zeros(len(by_duration))))
    assert gradients(of, d) == pytest.approx(by_switch, abs=1e-5)


def test_what_it_cannot_do_is_said_in_one_line() -> None:
    of = _slew(HubTestbed(), 1.0, 2.0 * FOOT_POUND, False)
    with pytest.raises(PlanFailed, match="no arcs that end at the goal"):
        switch_time_optimisation(of, np.array([0.5, 0.5]))
    five = _slew(HubTestbed(), 2.0, 10.0 * FOOT_POUND, False)
    with pytest.raises(PlanFailed, match="use another number of switches than 5"):
        switch_time_optimisation(five, five_switches(five), max_iterations=1)
