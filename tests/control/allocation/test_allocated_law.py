"""Laws whose torque is shared out turn a craft as if the drives were torques about its axes."""

from itertools import product
from typing import Any

import numpy as np
import pytest
from scipy.optimize import linprog
from scipy.spatial.transform import Rotation
from tests.representatives import representatives, seeds

from flexslew_control.allocation import joint_gains
from flexslew_control.allocation.allocation import WheelAllocation
from flexslew_control.controllers import build_controller
from flexslew_control.law import PlantDescription
from flexslew_plant.arrays import Matrix, Vector
from flexslew_plant.errors import BadInput
from flexslew_plant.hardware.sensors import exact_readings
from flexslew_plant.measurement import Measurement
from flexslew_plant.testbeds import initial_state, read_testbed
from flexslew_plant.testbeds.spacecraft.testbed import SpacecraftTestbed

PERIOD = 0.1  # [s]
GAINS = {"kp": [4.0, 5.0, 6.0], "kd": [9.0, 11.0, 13.0]}  # about x, y, z
LAWS: dict[str, dict[str, Any]] = {
    "pd_feedforward": {"gyroscopic": True},
    "collocated_pid": {"ki": [0.1], "gyroscopic": True},
}


def craft(
    rng: np.random.Generator, wheels: int = 4, jets: int = 8, **more: Any
) -> SpacecraftTestbed:
    """Return a rigid craft with drives along any axes, at any attitude."""
    while True:
        place, push = rng.uniform(-1.0, 1.0, (jets, 3)), rng.standard_normal((jets, 3))
        levers = np.cross(place, push).T
        bounds = (1.0, None)
        if linprog(np.ones(jets), A_eq=levers, b_eq=np.zeros(3), bounds=bounds).status == 0:
            break
    axes = rng.standard_normal((wheels, 3))
    axes /= np.linalg.norm(axes, axis=1)[:, None]
    turn = Rotation.random(random_state=rng).as_rotvec()
    start = {f"wheel_{k}": float(axis @ turn) for k, axis in enumerate(axes)}
    values = {
        "kind": "spacecraft",
        "platform": {"mass": 50.0, "inertia": {"xx": 10.0, "yy": 14.0, "zz": 18.0}},
        "appendages": {}, "initial": start,
        "wheels": {
            f"wheel_{k}": {"axis": axis.tolist(), "inertia": 0.02, "limit": 5.0}
            for k, axis in enumerate(axes)
        },
        "actuators": {
            f"jet_{k}": {"kind": "thruster", "place": r.tolist(), "direction": d.tolist(),
                         "limit": 500.0}
            for k, (r, d) in enumerate(zip(place, push, strict=True))
        },
        "sensors": {"speeds": {"kind": "tachometer"}},
        **more,
    }  # fmt: skip
    found = read_testbed(values, "here")
    assert isinstance(found, SpacecraftTestbed)
    return found


def flown(
    bench: SpacecraftTestbed, law: str, allocation: dict[str, Any], seconds: float, pushed: Vector
) -> Matrix:
    """Return the states of a hold about the start, pushed by a torque in its first second."""
    plant = PlantDescription(bench, PERIOD, np.array(bench.effort_limit))
    own = {**GAINS, **LAWS[law], "allocation": allocation}
    it = build_controller("it", law, own, plant, "here")
    model, x = bench.model(), initial_state(bench)
    jets = list(model.one_way)  # through which the outside pushes; wheels cannot
    torque = bench.drive_map().torque[:, jets]
    outside = np.zeros(model.joints)
    outside[jets] = np.linalg.pinv(torque) @ pushed
    effort, states = np.zeros(model.joints), [x]
    for k in range(round(seconds / PERIOD)):
        seen = exact_readings(model, x, effort, k * PERIOD)
        answer = it.observe(Measurement(k, 0, k * PERIOD, "it", *seen, effort))
        assert answer is not None
        effort = answer.command.effort
        assert (effort[list(model.one_way)] >= 0.0).all()
        assert sum(answer.terms.values()) == pytest.approx(effort, abs=1e-9)
        x = model.advance(x, effort + outside * (k * PERIOD < 1.0), PERIOD)
        states.append(x)
    return np.array(states)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("law", "seed"), representatives(product(LAWS, range(4)), (next(iter(LAWS)), 0))
)
def test_thrusters_and_wheels_of_any_geometry_hold_any_attitude_alike(law: str, seed: int) -> None:
    """Through thrusters or wheels it is one torque, so the rates in body axes are the same.

    Nothing else than that torque acts on a craft whose wheels hardly spin.
    """
    rng = np.random.default_rng(seed)
    bench = craft(rng, int(rng.integers(3, 7)), int(rng.integers(6, 13)))
    push = 1e-4 * rng.standard_normal(3)
    model = bench.model()
    by = [
        flown(bench, law, {"kind": kind}, 12.0, push)[:, model.positions + 3 : model.positions + 6]
        for kind in ("wheels", "thrusters")
    ]
    assert abs(by[0]).max() > 1e-6
    np.testing.assert_allclose(by[0], by[1], atol=2e-3 * abs(by[0]).max())


@pytest.mark.parametrize(
    ("law", "seed"), representatives(product(LAWS, range(3)), *zip(LAWS, range(3), strict=False))
)
def test_null_motion_brings_wheels_to_their_bias_and_turns_nothing(law: str, seed: int) -> None:
    rng = np.random.default_rng(seed)
    wheels = 4 + seed
    bench = craft(rng, wheels)
    bias = (10.0 * rng.standard_normal(wheels)).tolist()
    push = 0.05 * rng.standard_normal(3)
    plain = flown(bench, law, {"kind": "wheels"}, 60.0, push)
    own = {"kind": "wheels", "null_motion": 0.3, "bias_speed": bias}
    moved = flown(bench, law, own, 60.0, push)
    np.testing.assert_allclose(moved[:, 3:7], plain[:, 3:7], atol=1e-9)
    axes = bench.drive_map().torque[:, list(bench.drive_map().wheels)]
    idle = np.eye(wheels) - np.linalg.pinv(axes) @ axes
    speeds = moved[-1, bench.model().positions + 6 :]
    np.testing.assert_allclose(idle @ speeds, idle @ np.array(bias), atol=1e-4)


@pytest.mark.parametrize("seed", seeds(3))
def test_unloading_empties_the_wheels_while_they_hold_the_attitude(seed: int) -> None:
    rng = np.random.default_rng(seed)
    bench = craft(rng, 4)
    push = 0.2 * rng.standard_normal(3)
    states = {
        rate: flown(bench, "collocated_pid", {"kind": "wheels", "unloading": rate}, 100.0, push)
        for rate in (0.0, 0.1)
    }
    stored = {
        rate: np.linalg.norm(bench.spins(x[:, bench.model().positions :]).stored, axis=1)
        for rate, x in states.items()
    }
    assert stored[0.0][-1] == pytest.approx(np.linalg.norm(push), rel=0.05)  # for a second
    assert stored[0.1][-1] < 2e-3 * stored[0.0][-1]
    start = Rotation.from_quat(states[0.1][0, 3:7])
    turned = np.array((start.inv() * Rotation.from_quat(states[0.1][:, 3:7])).magnitude())
    assert turned[-1] < 0.05 * turned.max()  # the integral's tail: exp(-100 s * ki / kp) is .08


def test_planners_count_with_joint_gains_of_the_same_torque() -> None:
    rng = np.random.default_rng(1)
    axes, wanted = rng.standard_normal((40, 3)), rng.uniform(1.0, 2.0, 3)
    allocation = WheelAllocation(kind="wheels")
    found = np.array(joint_gains(allocation, "kp", tuple(wanted), axes))
    assert (found >= 0.0).all()
    np.testing.assert_allclose((axes.T * found) @ axes, np.diag(wanted), atol=1e-9)
    assert joint_gains(None, "kp", (3.0,), axes) == (3.0,)


@pytest.mark.parametrize(
    ("allocation", "more", "words"),
    [
        ({"kind": "thrusters", "drives": ["wheel_0"]}, {}, "drives.*names of thrusters"),
        ({"kind": "thrusters", "drives": ["jet_0", "jet_1"]}, {}, "no torque along .*; add"),
        ({"kind": "wheels", "drives": ["wheel_0", "wheel_1"]}, {}, "lie in a plane"),
        ({"kind": "wheels", "null_motion": 0.1}, {"sensors": {}}, "null_motion.*tachometer"),
        ({"kind": "wheels", "unloading": 0.1}, {"sensors": {}}, "unloading.*tachometer"),
        ({"kind": "wheels", "bias_speed": [1.0, 2.0]}, {}, "bias_speed.*give 1 or 4 numbers"),
        ({"kind": "wheels", "bias_speed": [1.0]}, {}, "bias_speed.*no effect without null_motion"),
        (
            {"kind": "wheels", "null_motion": 0.1, "unloading": 0.1, "bias_speed": [9.0, 0, 0, 0]},
            {}, r"bias_speed.*stores a momentum of \(.*the nearest bias that stores none is \[",
        ),
        ({"kind": "wheels"}, {"platform": {"motion": "held"}, "sensors": {}}, "three axes"),
    ],
)  # fmt: skip
def test_an_allocation_that_cannot_be_is_refused_in_a_line(
    allocation: dict[str, Any], more: dict[str, Any], words: str
) -> None:
    bench = craft(np.random.default_rng(0), **more)
    plant = PlantDescription(bench, PERIOD, np.array(bench.effort_limit))
    own = {**GAINS, "allocation": allocation}
    with pytest.raises(BadInput, match=words):
        build_controller("it", "pd_feedforward", own, plant, "here")
