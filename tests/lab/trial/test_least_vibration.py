"""The shipped turn in three axes with the least vibration keeps its promise between its members."""

from collections.abc import Callable
from dataclasses import replace
from typing import Any, cast

import numpy as np
import pytest
from tests.present import present

from flexslew_control.law import PlantDescription
from flexslew_control.plan import Plan
from flexslew_control.planners.residual.whole_bench import simulate_on_bench
from flexslew_lab.reproduce.scole_flights import example_values
from flexslew_lab.trial.trial import law_in_charge, trial_of_values


@pytest.mark.slow
def test_the_shipped_turn_leaves_what_it_promises_on_stiffnesses_between_its_members(
    shipped_plan: Callable[[str], Plan | None],
) -> None:
    """10 % more, and 1e-5 m, which counts as none."""
    trial = trial_of_values(example_values("least_vibration", {}), "here")
    testbed = cast(Any, trial.testbed)
    limit = np.array([wheel.limit for wheel in testbed.wheels.values()])
    bench, law = PlantDescription(trial.testbed, trial.period, limit), law_in_charge(trial)
    plan = present(shipped_plan("least_vibration"))
    members = [member["errors"]["stiffness"] for member in plan.summary["members"]]
    between = np.linspace(-0.2, 0.2, 17)[1::2]
    assert not np.isclose(between[:, None], members).any()
    left = []
    for error in between:
        other = replace(bench, testbed=testbed.scaled(stiffness=1.0 + error))
        left.append(present(simulate_on_bench(plan, other, law)).tip_deflection)
    assert max(left) < 1.1 * plan.summary["worst_residual"] + 1e-5
    assert (abs(plan.effort) <= limit).all()
    assert abs(plan.effort).max() > 0.9 * limit.max()
