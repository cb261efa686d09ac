"""Torques shared out among thrusters, wheels and gyros fly in a batch as on the bench."""

from collections.abc import Callable
from copy import deepcopy
from itertools import product
from typing import Any

import numpy as np
import pytest
from tests.lab.studies.batch.both_ways import CRAFT as BOOM
from tests.lab.studies.batch.both_ways import require_equal
from tests.representatives import representatives

from flexslew_lab.studies.run import prepare
from flexslew_lab.studies.study import Study

AXES = {"x": [1.0, 0.0, 0.0], "y": [0.0, 1.0, 0.0], "z": [0.0, 0.0, 1.0]}
TILTED = {  # four axes in a pyramid about z
    "one": [0.8165, 0.0, 0.5774],
    "two": [0.0, 0.8165, 0.5774],
    "three": [-0.8165, 0.0, 0.5774],
    "four": [0.0, -0.8165, 0.5774],
}
ROTORS = ([0.0, 1.0, 0.0], [-1.0, 0.0, 0.0], [0.0, -1.0, 0.0], [1.0, 0.0, 0.0])


def thrusters() -> dict[str, Any]:
    """Return pairs that turn the craft about each axis, either way, without a push."""
    found: dict[str, Any] = {}
    for (name, axis), turn, end in product(AXES.items(), (1.0, -1.0), (1.0, -1.0)):
        lever = end * np.roll(axis, 1)
        found[f"jet_{name}_{turn:+.0f}_{end:+.0f}"] = {
            "kind": "thruster",
            "place": lever.tolist(),
            "direction": (turn * np.cross(axis, lever)).tolist(),
            "limit": 2.0,
        }
    return found


CRAFT: dict[str, Any] = BOOM | {
    "actuators": thrusters(),
    "wheels": {
        f"wheel_{name}": {"axis": axis, "inertia": 0.05, "limit": 2.0, "momentum_limit": 20.0}
        for name, axis in TILTED.items()
    },
    "control_moment_gyros": {
        f"gyro_{name}": {"axis": axis, "rotor": rotor, "momentum": 5.0, "rate_limit": 1.0}
        for (name, axis), rotor in zip(TILTED.items(), ROTORS, strict=True)
    },
    "sensors": {
        "gyro": {"kind": "gyro", "angle_random_walk": 1e-5, "bias_spread": 1e-4},
        "tracker": {
            "kind": "star_tracker",
            "across": 1e-4,
            "about": 5e-4,
            "interval": 0.2,
            "delay": 0.1,
            "dropout": 0.1,
        },
        "sun": {"kind": "sun_sensor", "noise": 1e-3, "sun": [1.0, 0.2, 0.0]},
        "speeds": {"kind": "tachometer", "noise": 0.1},
        "angles": {"kind": "resolver"},
    },
}
PULSES = {name: 0.02 for name in CRAFT["actuators"]}
WHEELS = {"kind": "wheels", "null_motion": 0.1, "bias_speed": [30.0, -30.0, 30.0, -30.0]}
PD, PID = "pd_feedforward", "collocated_pid"
THRUSTERS, GYROS = {"kind": "thrusters"}, {"kind": "control_moment_gyros", "null_motion": 0.05}
FLOWN: dict[str, tuple[str, dict[str, Any], dict[str, Any]]] = {
    "pulses": (PID, {"allocation": THRUSTERS}, {"shortest_pulse": PULSES}),
    "unloaded wheels": (PD, {"allocation": WHEELS | {"unloading": 0.05}}, {}),
    "gyros": (PD, {"allocation": GYROS}, {}),
    "thrusters, filter": (PD, {"allocation": THRUSTERS, "attitude": {}}, {}),
    "wheels, filter": (PID, {"allocation": WHEELS, "attitude": {"noise_factor": 2.0}}, {}),
}


@pytest.mark.slow
@pytest.mark.parametrize("drives", representatives(FLOWN, "gyros"))
def test_a_torque_that_is_shared_out_flies_in_a_batch_as_on_the_bench(
    study_of: Callable[..., Study], drives: str
) -> None:
    law, own, actuator = FLOWN[drives]
    goal = {"axis": [1.0, -0.6, 0.4], "angle": 0.4}
    gains = {"kp": [20.0], "kd": [60.0]} | ({"ki": [1.0]} if law == "collocated_pid" else {})
    trial = {
        "duration": 4.0,
        "period": 0.05,
        "testbed": deepcopy(CRAFT),
        "plan": {"method": "reference_only", "goal": goal, "duration": 3.0},
        "controllers": {law: gains | own | {"gyroscopic": True}},
        "active": law,
        "actuator": actuator,
        "schedule": [{"at": 1.0, "until": 1.5, "disturbance": {"wheel_two": 0.1}}],
        "sensors": {"joint_velocity": {"noise": 1e-5}},
    }
    vary = {
        f"controllers.{law}.kp": {"relative": {"uniform": [-0.2, 0.2]}},
        "testbed.platform.mass": {"uniform": [140.0, 160.0]},  # each law knows its own craft
    }
    ready = prepare(study_of(flown=trial, batch=True, vary=vary))
    require_equal(ready, [0, 1, 3])


@pytest.mark.parametrize("filtered", [False, True])
def test_a_linear_law_on_body_axes_flies_in_a_batch_as_on_the_bench(
    study_of: Callable[..., Study], filtered: bool
) -> None:
    """Gains between all axes, a filter of the rates, and an integral without anti-windup."""
    rng = np.random.default_rng(3)
    gains = np.hstack((20.0 * np.eye(3), 60.0 * np.eye(3))) + rng.uniform(-1.0, 1.0, (3, 6))
    integral = np.hstack((np.eye(3), np.zeros((3, 3))))
    system = {"a": (-0.01 * np.eye(3)).tolist(), "b": integral.tolist(), "c": np.eye(3).tolist(),
              "d": gains.tolist()}  # fmt: skip
    own = {"system": system, "tracking_time": None, "allocation": WHEELS, "gyroscopic": True}
    trial = {
        "duration": 4.0, "period": 0.05, "testbed": deepcopy(CRAFT), "active": "linear",
        "plan": {"method": "reference_only", "goal": {"axis": [1.0, -0.6, 0.4], "angle": 0.2},
                 "duration": 3.0},
        "controllers": {"linear": own | ({"attitude": {}} if filtered else {})},
        "schedule": [{"at": 1.0, "until": 1.5, "disturbance": {"wheel_two": 0.1}}],
        "sensors": {"joint_velocity": {"noise": 1e-5}},
    }  # fmt: skip
    vary = {"testbed.platform.mass": {"uniform": [140.0, 160.0]}}
    require_equal(prepare(study_of(flown=trial, batch=True, vary=vary)), [0, 1, 3])
