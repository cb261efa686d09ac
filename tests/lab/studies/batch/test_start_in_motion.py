"""Members of a batch that start in motion fly as on the bench."""

from collections.abc import Callable

import pytest
from tests.lab.studies.batch.both_ways import CRAFT, require_equal

from flexslew_lab.studies.run import prepare
from flexslew_lab.studies.study import Study

WHEELS = {
    name: {"axis": [float(k == i) for i in range(3)], "inertia": 0.05, "limit": 20.0}
    for k, name in enumerate(("roll", "pitch", "yaw"))
}


@pytest.mark.parametrize(
    "vary",
    [
        {
            "testbed.initial_motion.rates.roll": {"uniform": [-0.1, 0.1]},
            "testbed.initial_motion.wheel_speeds.yaw": {"uniform": [-20.0, 20.0]},
        },
        {"testbed.platform.mass": {"uniform": [140.0, 160.0]}},  # the motion is the same
    ],
)
def test_they_fly_as_on_the_bench(study_of: Callable[..., Study], vary: dict[str, object]) -> None:
    motion = {
        "rates": {"roll": 0.05, "pitch": -0.02},
        "wheel_speeds": {"yaw": 10.0},
        "plucked": {"boom_x": 0.5},
        "deflection_rates": {"mode_2": 0.01},
    }
    trial = {
        "duration": 3.0,
        "period": 0.05,
        "testbed": CRAFT | {"wheels": WHEELS, "initial_motion": motion},
        "plan": {"method": "none", "goal": {"roll": 0.0}},
        "controllers": {"pd_feedforward": {"kp": [12.0], "kd": [60.0], "gyroscopic": True}},
    }
    require_equal(prepare(study_of(flown=trial, batch=True, vary=vary)), [0, 1, 3])
