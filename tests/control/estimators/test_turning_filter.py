"""The filter of a craft about its plan is as good as it says: NIS of flights under its noises."""

from typing import Any

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from scipy.stats import chi2
from tests.representatives import representatives

from flexslew_control.controllers import build_controller
from flexslew_control.law import PlantDescription
from flexslew_control.plan import Plan
from flexslew_plant.arrays import Vector
from flexslew_plant.hardware.sensors import exact_readings
from flexslew_plant.measurement import Measurement
from flexslew_plant.testbeds import read_testbed

NAMES, TICKS, SEEDS, INERTIA = ("roll", "pitch", "yaw"), 120, 6, (10.0, 14.0, 18.0)
NOISES = {
    "effort_noise": 1e-5, "disturbance_walk": 1e-3, "initial_disturbance": 1e-2,
    "angle_sigma": 1e-4, "rate_sigma": 3e-4, "initial_deflection": 0.0,
}  # fmt: skip
BEAM = {
    "kind": "beam", "length": 4.0, "linear_density": 0.6, "bending_stiffness": 60.0, "modes": 2,
    "along": [1.0, 0.0, 0.0], "across": [0.0, 0.0, 1.0],
}  # fmt: skip


def craft(drives: str, bends: bool) -> Any:
    """Return a craft whose drives stand askew to its body axes, or wheels along them."""
    axes = np.linalg.qr(np.random.default_rng(4).standard_normal((3, 3)))[0]
    one: dict[str, Any] = {"kind": "torque", "limit": 1.0}
    if drives == "wheels":
        one, axes = {"inertia": 0.05, "limit": 1.0}, np.eye(3)
    key = {"torque": "direction", "wheels": "axis"}[drives]
    driven = {name: {**one, key: axis.tolist()} for name, axis in zip(NAMES, axes, strict=True)}
    values: dict[str, Any] = {
        "kind": "spacecraft",
        "platform": {
            "mass": 50.0,
            "inertia": dict(zip(("xx", "yy", "zz"), INERTIA, strict=True)),
        },
        "actuators": {},
    }
    values["actuators" if drives == "torque" else "wheels"] = driven
    if bends:
        values["appendages"] = {"boom": {"hinge": {"place": [0.4, 0.0, 0.0]}, "shape": BEAM}}
    return read_testbed(values, "here")


def innovations(testbed: Any, period: float, spin: float, seed: int) -> Vector:
    """Return NIS tick by tick of a spin about z that lqr holds."""
    model, rng = testbed.model(), np.random.default_rng(seed)
    plant = PlantDescription(testbed, period, np.full(3, 1.0))
    it = build_controller("it", "lqr", {"filter": NOISES}, plant, "here")
    axes, rate, first = model.attitude.axes, np.array([0.0, 0.0, spin]), model.positions
    position = period * np.arange(TICKS + 2)[:, None] * (axes @ rate)
    still, none = np.zeros((TICKS + 1, 3)), np.zeros((TICKS + 2, 0))
    velocity = np.tile(axes @ rate, (TICKS + 2, 1))
    end = period * (TICKS + 1)
    method = "reference_only"
    plan = Plan(method, NAMES, 0.0, period, position, velocity, still, none, end)
    assert it.adopt(plan) is None
    x = np.zeros(first + model.coordinates)
    x[6], x[first + 3 : first + 6] = 1.0, rate
    if testbed.wheels:  # no momentum altogether, as from rest
        x[first + 6 : first + 9] = -np.array(INERTIA) * rate / 0.05
    effort, found = np.zeros(3), []
    disturbance = NOISES["initial_disturbance"] * rng.standard_normal(3)
    for k in range(TICKS):
        seen = exact_readings(model, x, effort, k * period)
        off = np.linalg.solve(axes, NOISES["angle_sigma"] * rng.standard_normal(3))
        turn = (Rotation.from_quat(x[3:7]) * Rotation.from_rotvec(off)).as_rotvec()
        rates = seen.joint_velocity + NOISES["rate_sigma"] * rng.standard_normal(3)
        said = it.observe(
            Measurement(k, 0, k * period, "it", axes @ turn, rates, *seen[2:], effort)
        )
        assert said is not None
        found.append(said.estimate.nis)
        effort = said.command.effort
        walk = NOISES["disturbance_walk"] * np.sqrt(period) * rng.standard_normal((2, 3))
        for _ in range(4):  # white noise on efforts, held for quarters of a tick
            white = np.sqrt(NOISES["effort_noise"] / (period / 4)) * rng.standard_normal(3)
            mean = disturbance + 0.5 * walk[0] + walk[1] / np.sqrt(12.0)
            x = model.advance(x, effort + mean + white, period / 4)
        disturbance = disturbance + walk[0]
    return np.array(found)[1:]


@pytest.mark.parametrize(
    ("drives", "bends", "period", "spin"),
    representatives(
        [
            ("torque", False, 0.3, 0.5),
            ("torque", True, 0.1, 0.15),
            ("wheels", False, 0.3, 0.15),
            ("wheels", True, 0.02, 0.0),
            ("wheels", True, 0.3, 0.0),
        ],
        ("torque", True, 0.1, 0.15),
        ("wheels", False, 0.3, 0.15),
    ),
)
def test_innovations_are_as_large_as_the_filter_says(
    drives: str, bends: bool, period: float, spin: float
) -> None:
    testbed = craft(drives, bends)
    nis = np.array([innovations(testbed, period, spin, seed) for seed in range(SEEDS)])
    low, high = np.divide(chi2.ppf([0.0005, 0.9995], 6 * nis.size), nis.size)
    assert low < nis.mean() < high
