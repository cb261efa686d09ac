"""Thrusters push one way: plans ask them for nothing else, and laws that would are refused."""

from dataclasses import replace
from itertools import product
from typing import Any

import numpy as np
import pytest
from scipy.optimize import linprog
from scipy.spatial.transform import Rotation
from tests.representatives import representatives

from flexslew_control.controllers import CONTROLLERS, build_controller
from flexslew_control.law import ActiveLaw, PlantDescription
from flexslew_control.planners import make_plan, plan_settings
from flexslew_control.planners.checks.one_way import require_one_way
from flexslew_control.planners.residual.whole_bench import simulate_on_bench
from flexslew_plant.errors import BadInput, PlanFailed
from flexslew_plant.testbeds import Testbed, read_testbed

PERIOD = 0.1  # [s]
LAW = ActiveLaw(
    "pd_feedforward",
    {"kp": [4.0], "kd": [9.0], "gyroscopic": True, "allocation": {"kind": "thrusters"}},
)


def craft(rng: np.random.Generator, limit: float, **more: Any) -> Testbed:
    """Return a rigid craft with seven to eleven thrusters anywhere, which give every torque."""
    jets = int(rng.integers(7, 12))
    while True:
        place, push = rng.uniform(-1.0, 1.0, (jets, 3)), rng.standard_normal((jets, 3))
        push /= np.linalg.norm(push, axis=1)[:, None]
        levers = np.cross(place, push).T
        bounds = (1.0, None)
        balanced = linprog(np.ones(jets), A_eq=levers, b_eq=np.zeros(3), bounds=bounds).status == 0
        if balanced and np.linalg.svd(levers)[1][-1] > 0.8:
            break
    values = {
        "kind": "spacecraft",
        "platform": {"mass": 50.0, "inertia": {"xx": 10.0, "yy": 14.0, "zz": 18.0}},
        "appendages": {},
        "actuators": {
            f"jet_{k}": {"kind": "thruster", "place": r.tolist(), "direction": d.tolist(),
                         "limit": limit}
            for k, (r, d) in enumerate(zip(place, push, strict=True))
        },
        **more,
    }  # fmt: skip
    return read_testbed(values, "here")


def plant_of(bench: Testbed) -> PlantDescription:
    return PlantDescription(bench, PERIOD, np.array(bench.effort_limit))


def turn_to(rng: np.random.Generator, angle: float, **more: Any) -> Any:
    axis = rng.standard_normal(3)
    quaternion = Rotation.from_rotvec(angle * axis / np.linalg.norm(axis)).as_quat()
    return plan_settings({"goal": {"quaternion": quaternion.tolist()}, **more}, "here")


@pytest.mark.parametrize(
    ("method", "seed"),
    representatives(
        product(["input_shaping", "time_optimal"], range(4)),
        ("input_shaping", 0),
        ("time_optimal", 1),
    ),
)
def test_a_plan_for_thrusters_is_within_what_they_give_and_flies(seed: int, method: str) -> None:
    """Any geometry, 30 deg about any axis: no pull, no push beyond the limit, and it ends there.

    A plan that counted the thrusters both ways would ask for twice what they have.
    """
    rng = np.random.default_rng(seed)
    plant = plant_of(craft(rng, 0.5))
    own = {"duration": 30.0} if method == "input_shaping" else {"reserve": 0.2}
    settings = turn_to(rng, np.radians(30.0), method=method, **own)
    plan = make_plan(settings, plant, None, law=LAW)
    assert plan.effort.any()
    assert plan.effort.min() >= 0.0
    assert (plan.effort <= plant.effort_limit * (1.0 + 1e-9)).all()
    assert plan.summary["peak_effort"] == plan.effort.max(axis=0).tolist()
    found = simulate_on_bench(plan, plant, LAW)
    assert found is not None
    assert found.attitude_error.max() < 1e-4  # the hold of a tick


def test_a_slew_that_thrusters_cannot_make_both_ways_takes_longer() -> None:
    """The fastest slew about an axis, by four thrusters of which two push at a time.

    A pair of levers r gives the torque 2 r F one way; counted both ways it would be 4 r F. From
    rest to rest over the angle A it takes 2 sqrt(J A / (2 r F)).
    """
    ahead, aside = [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]
    places = {
        "z": (ahead, aside), "x": ([0.0, 1.0, 0.0], [0.0, 0.0, 1.0]),
        "y": ([0.0, 0.0, 1.0], ahead),
    }  # fmt: skip
    actuators = {
        f"{name}_{sign:+d}_{side:+d}": {
            "kind": "thruster", "limit": 0.5, "place": (side * np.array(place)).tolist(),
            "direction": (sign * side * np.array(push)).tolist(),
        }
        for name, (place, push) in places.items() for sign in (1, -1) for side in (1, -1)
    }  # fmt: skip
    plant = plant_of(craft(np.random.default_rng(0), 1.0, actuators=actuators))
    settings = plan_settings(
        {"method": "time_optimal", "goal": {"axis": [0.0, 0.0, 1.0], "angle": 0.8}}, "here"
    )
    plan = make_plan(settings, plant, None, law=LAW)
    shortest = 2.0 * np.sqrt(18.0 * 0.8 / (2 * 0.5))
    assert shortest <= plan.duration < 1.02 * shortest + 2 * PERIOD


@pytest.mark.parametrize("law", CONTROLLERS)
def test_a_law_that_asks_thrusters_for_both_ways_is_refused_with_the_remedy(law: str) -> None:
    plant = plant_of(craft(np.random.default_rng(1), 0.5))
    with pytest.raises(BadInput, match=r"jet_0 is a thruster, which pushes one way.*allocation"):
        build_controller("it", law, {}, plant, "here")


def test_what_counts_thrusters_both_ways_is_refused() -> None:
    rng = np.random.default_rng(2)
    plant = plant_of(craft(rng, 0.5))
    both = ActiveLaw("pd_feedforward", {"kp": [4.0], "kd": [9.0]})
    with pytest.raises(BadInput, match=r"jet_0 is a thruster.*`allocation`"):
        make_plan(turn_to(rng, 0.5, method="input_shaping", duration=20.0), plant, None, law=both)
    with pytest.raises(BadInput, match=r"jet_0 is a thruster.*take moving"):
        make_plan(turn_to(rng, 0.5, method="time_optimal", drives="all"), plant, None, law=LAW)
    plan = make_plan(turn_to(rng, 0.5, method="input_shaping", duration=20.0), plant, law=LAW)
    require_one_way(plan, plant)
    with pytest.raises(PlanFailed, match=r"jet_\d+ is a thruster, .* input_shaping asks it for -"):
        require_one_way(replace(plan, effort=-plan.effort), plant)
