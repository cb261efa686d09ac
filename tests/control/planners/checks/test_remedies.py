import json
import re
from typing import Any

import numpy as np
import pytest
from tests.plants import plant
from tests.present import present

from flexslew_control.planners import plan_settings
from flexslew_control.planners.checks.remedies import suggest_duration
from flexslew_control.planners.slew import ExcessTorque, Slew, slew_of
from flexslew_plant.errors import PlanFailed


@pytest.mark.parametrize("limit", [9000.0, 2000.0, 1.0])
def test_a_feedback_that_is_too_stiff_at_any_duration_is_told_with_one_that_is_not(
    limit: float,
) -> None:
    """A slew that fails above a gain is refused with gains below it, unless none is soft enough."""
    values = {"method": "optimized_feedforward", "goal": {"base_yaw": 1.0}}
    stiff = {"kp": [1e5, 1e5], "kd": [1e5, 1e5]}
    settings = plan_settings({**values, "feedback": stiff}, "trial")
    tried: list[Slew] = []

    def plan(section: Any, slew: Slew, progress: Any) -> Any:
        tried.append(slew)
        if slew.kp.max() > limit:
            raise ExcessTorque("too stiff")
        return None

    slew = slew_of(settings, plant(0.05, (150.0, 150.0)), None)
    told = suggest_duration(plan, settings, slew)
    if limit < 10.0:
        assert told.endswith("is enough; use a higher effort_limit")
        return
    found = present(re.search(r"; kp (\[[^]]*\]) and kd (\[[^]]*\]) are", told))
    kp, kd = (np.array(json.loads(part)) for part in found.groups())
    assert np.array_equal(kp, tried[-1].kp)
    assert np.array_equal(kd, tried[-1].kd)
    assert kp.max() <= limit
    softer = plan_settings({**values, "feedback": {"kp": list(kp), "kd": list(kd)}}, "trial")
    plan(softer, slew_of(softer, plant(0.05, (150.0, 150.0)), None), None)
    with pytest.raises(PlanFailed):
        plan(settings, slew, None)
