"""More wheels than axes: plans and laws leave their null motion alone, and reach the goal."""

from typing import Any

import numpy as np
import pytest
from scipy.linalg import null_space
from scipy.spatial.transform import Rotation
from tests.representatives import representatives

from flexslew_control.controllers import build_controller
from flexslew_control.law import PlantDescription
from flexslew_control.planners import make_plan, plan_settings
from flexslew_plant.arrays import Matrix
from flexslew_plant.hardware.sensors import exact_readings
from flexslew_plant.measurement import Measurement
from flexslew_plant.testbeds import read_testbed

PERIOD, LASTING = 0.1, 40.0  # [s]
LAWS: dict[str, dict[str, Any]] = {
    "pd_feedforward": {"kp": [4.0], "kd": [9.0]},
    "collocated_pid": {"kp": [4.0], "kd": [9.0], "ki": [0.1]},
}


def with_wheels(axes: Matrix) -> PlantDescription:
    """Return a rigid craft with a wheel along each axis, shape (wheels, 3)."""
    wheels = {
        f"wheel_{k}": {"axis": axis.tolist(), "inertia": 0.02, "limit": 0.5}
        for k, axis in enumerate(axes, start=1)
    }
    values = {
        "kind": "spacecraft", "platform": {"inertia": {"xx": 10.0, "yy": 14.0, "zz": 18.0}},
        "appendages": {}, "actuators": {}, "wheels": wheels,
    }  # fmt: skip
    return PlantDescription(read_testbed(values, "here"), PERIOD, np.full(len(axes), 0.5))


@pytest.mark.slow
@pytest.mark.parametrize(
    ("wheels", "seed", "law"),
    representatives(
        [(*case, law) for case in ((4, 0), (5, 1), (6, 2)) for law in LAWS],
        (4, 0, "pd_feedforward"),
        (6, 2, "collocated_pid"),
    ),
)
def test_wheels_along_any_axes_turn_a_craft_without_null_motion(
    wheels: int, seed: int, law: str
) -> None:
    rng = np.random.default_rng(seed)
    axes = rng.standard_normal((wheels, 3))
    axes /= np.linalg.norm(axes, axis=1)[:, None]
    bench, goal = with_wheels(axes), Rotation.from_rotvec(0.8 * rng.standard_normal(3))
    section = {"method": "input_shaping", "goal": {"quaternion": goal.as_quat().tolist()}}
    plan = make_plan(plan_settings({**section, "duration": 20.0}, "here"), bench)
    idle = null_space(axes.T)
    assert abs(plan.effort @ idle).max() < 1e-12
    assert abs(plan.effort).max() > 0.05
    it = build_controller("it", law, LAWS[law], bench, "here")
    assert it.adopt(plan) is None
    model = bench.testbed.model()
    x = np.concatenate((model.rest({}), np.zeros(model.coordinates)))
    effort, pushed = np.zeros(wheels), 0.05 * rng.standard_normal(wheels)
    for k in range(round(LASTING / PERIOD)):
        seen = exact_readings(model, x, effort, k * PERIOD)
        answer = it.observe(Measurement(k, 0, k * PERIOD, "it", *seen, effort))
        assert answer is not None
        effort = answer.command.effort
        assert abs(effort @ idle).max() < 1e-9
        push = pushed if 5.0 <= k * PERIOD < 6.0 else 0.0  # a disturbance that the law must end
        x = model.advance(x, effort + push, PERIOD)
    assert (Rotation.from_quat(x[3:7]).inv() * goal).magnitude() < 2e-3
