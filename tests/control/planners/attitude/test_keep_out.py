"""Plans past cones in the sky: refused if and only if an axis looks into one, by any planner."""

from typing import Any

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from tests.plants import torques

from flexslew_control.law import PlantDescription
from flexslew_control.planners import make_plan, plan_settings
from flexslew_plant.errors import PlanFailed
from flexslew_plant.testbeds import read_testbed

LIMIT = np.ones(3)


def craft(cone: dict[str, Any]) -> PlantDescription:
    values = {
        "kind": "spacecraft",
        "actuators": torques(1.0),
        "keep_out": {"sun": cone},
    }
    return PlantDescription(read_testbed(values, "here"), 0.1, LIMIT)


@pytest.mark.slow
def test_a_slew_is_refused_where_it_looks_into_a_cone_and_nowhere_else() -> None:
    """Random slews by 0.5 to 2 rad beside random cones, on a fine grid of the eigenaxis."""
    rng, refused = np.random.default_rng(3), 0
    for case in range(24):
        axis, boresight, aside = (v / np.linalg.norm(v) for v in rng.standard_normal((3, 3)))
        angle, half = float(rng.uniform(0.5, 2.0)), float(rng.uniform(0.1, 0.8))
        along = Rotation.from_rotvec(np.linspace(0.0, angle, 2000)[:, None] * axis)
        direction = along[1000].apply(boresight) + aside  # near the middle of the way
        direction /= np.linalg.norm(direction)
        closest = float(np.arccos(along.apply(boresight) @ direction).min()) - half
        if abs(closest) < 0.01:  # a plan's ticks are not this grid
            continue
        cone = {"boresight": boresight.tolist(), "direction": direction.tolist(),
                "half_angle": half}  # fmt: skip
        goal = {"axis": axis.tolist(), "angle": angle}
        keys = ({"method": "input_shaping", "duration": 60.0}, {"method": "time_optimal"})
        settings = plan_settings({**keys[case % 2], "goal": goal}, "here")
        if closest > 0.0:
            make_plan(settings, craft(cone))
            continue
        refused += 1
        with pytest.raises(PlanFailed, match="looks into keep_out sun") as error:
            make_plan(settings, craft(cone))
        depth = float(str(error.value).split(" by ")[1].split(" rad")[0])
        assert depth == pytest.approx(-closest, abs=2e-3)
    assert 6 < refused < 18
