from typing import Any

import numpy as np
import pytest

from flexslew_control.planners.time_optimal.bang_bang import BangBang
from flexslew_control.planners.time_optimal.switching import linear_durations
from flexslew_lab.reproduce.switch_time_gradient import (
    gradients,
    switch_time_optimisation,
)
from flexslew_plant.errors import PlanFailed
from flexslew_plant.testbeds.csa import CsaTestbed
from flexslew_plant.testbeds.hub_with_appendages import FOOT_POUND, HubTestbed
from flexslew_plant.testbeds.oscillators.floating_oscillator import FloatingOscillatorTestbed

# testbed, distance, amplitude, robust, published switch times and t_f
PUBLISHED = [
    (FloatingOscillatorTestbed(), 1.0, False, (1.00267843, 2.10893326, 3.21518808, 4.21786651)),
    (
        FloatingOscillatorTestbed(),
        1.0,
        True,
        (0.71239863, 1.65634513, 2.93297922, 4.20961331, 5.15355981, 5.86595844),
    ),
    (HubTestbed(), 2.0 * FOOT_POUND, False, (2.93665982, 3.00993354, 3.08320725, 6.01986708)),
    (
        HubTestbed(),
        2.0 * FOOT_POUND,
        True,
        (2.02038900, 2.29428977, 3.19079123, 4.08729269, 4.36119346, 6.38158246),
    ),
    (CsaTestbed(modes=1), 100.0, False, (7.110356, 9.595312, 12.080268, 19.190624)),
]


def slew(testbed: Any, amplitude: Any, robust: Any, distance: float = 1.0) -> BangBang:
    model = testbed.model()
    return BangBang(model, 0, np.zeros(2 * model.coordinates), distance, amplitude, robust)


@pytest.mark.parametrize(("testbed", "amplitude", "robust", "times"), PUBLISHED)
def test_it_finds_the_published_switch_times_from_elsewhere(
    testbed: Any, amplitude: Any, robust: Any, times: Any
) -> None:
    of = slew(testbed, amplitude, robust)
    wrong = 1.0 + 0.03 * np.cos(np.arange(len(times)))
    found = switch_time_optimisation(of, linear_durations(of) * wrong)
    assert np.cumsum(found.durations) == pytest.approx(times, abs=1e-6)
    assert found.residual <= 1e-9


def five_switches(of: Any) -> Any:
    return of.rigid_duration / 2.0 * np.array([0.6, 0.02, 0.4, 0.4, 0.02, 0.6])


def test_it_shortens_a_slew_with_more_switches_than_end_conditions() -> None:
    of = slew(HubTestbed(), 10.0 * FOOT_POUND, False, 2.0)
    found = switch_time_optimisation(of, five_switches(of))
    assert found.durations.sum() == pytest.approx(3.80453683, abs=1e-6)
    assert found.iterations > 0


@pytest.mark.parametrize("robust", [False, True])
def test_gradients_by_costates_are_those_by_forward_sensitivities(robust: bool) -> None:
    of = slew(HubTestbed(), 2.0 * FOOT_POUND, robust)
    d = linear_durations(of)
    by_duration = of.residual_jacobian(d)[1]
    # t_k is the end of arc k and the beginning of arc k + 1
    by_switch = by_duration - np.column_stack((by_duration[:, 1:], np.zeros(len(by_duration))))
    assert gradients(of, d) == pytest.approx(by_switch, abs=1e-5)


def test_what_it_cannot_do_is_said_in_one_line() -> None:
    of = slew(HubTestbed(), 2.0 * FOOT_POUND, False)
    with pytest.raises(PlanFailed, match="no arcs that end at the goal"):
        switch_time_optimisation(of, np.array([0.5, 0.5]))
    five = slew(HubTestbed(), 10.0 * FOOT_POUND, False, 2.0)
    with pytest.raises(PlanFailed, match="use another number of switches than 5"):
        switch_time_optimisation(five, five_switches(five), max_iterations=1)
