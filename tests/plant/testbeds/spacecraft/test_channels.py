"""Sensors on appendages and on the platform read what the motion is."""

from typing import Any

import numpy as np
import pytest
from tests.plant.testbeds.spacecraft.crafts import attitude

from flexslew_plant.bench.bench import Bench
from flexslew_plant.bench.records import BenchSettings
from flexslew_plant.errors import BadInput
from flexslew_plant.hardware.sensors import exact_readings
from flexslew_plant.testbeds import read_testbed
from flexslew_plant.testbeds.spacecraft.assembly.bodies import rotation_matrix
from flexslew_plant.testbeds.spacecraft.equations import layout

BOOM = {
    "kind": "beam",
    "length": 2.0,
    "linear_density": 0.5,
    "bending_stiffness": 9.0,
    "modes": 3,
    "along": [0.0, 1.0, 0.0],
    "across": [0.0, 0.0, 1.0],
}
AXES = [[0.0, 0.0, 1.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]]
SENSORS: dict[str, Any] = {
    "middle": {"kind": "displacement", "appendage": "boom", "at": 1.0, "direction": [0, 0, 1]},
    "middle_rate": {"kind": "rate", "appendage": "boom", "at": 1.0, "direction": [0, 0, 1]},
    "root": {"kind": "strain", "appendage": "boom", "at": 0.3, "fibre": [0.01, 0.0, 0.02]},
    "hub": {"kind": "accelerometer", "place": [0.4, -0.2, 0.1], "direction": [1, 2, 0]},
    "tip": {"kind": "accelerometer", "appendage": "boom", "direction": [0.0, 0.0, 1.0]},
}


HINGES: dict[str, dict[str, Any]] = {
    "fixed": {},
    "driven": {"kind": "driven", "axis": [1.0, 2.0, 0.5], "spring": 2.0},
    "prescribed": {
        "kind": "prescribed",
        "axis": [1.0, 2.0, 0.5],
        "motion": {"to": 1.2, "duration": 2.0, "profile": "smooth"},
    },
}


def craft(motion: str = "free", turning: str = "fixed", **sensors: Any) -> Any:
    hinge = {"place": [0.3, 0, 0.2], "axes": AXES} | HINGES[turning]
    values = {
        "kind": "spacecraft",
        "platform": {
            "motion": motion,
            "mass": 40.0,
            "inertia": {"xx": 9.0, "yy": 8.0, "zz": 7.0, "xy": 0.5},
            "place": [0.1, 0.2, 0.0],
            "axis": [1.0, 1.0, 0.5],
        },
        "appendages": {"boom": {"shape": BOOM, "hinge": hinge}},
        "sensors": sensors or SENSORS,
    }
    return read_testbed(values, "here")


def moving(model: Any, seed: int = 3) -> Any:
    rng = np.random.default_rng(seed)
    q = model.rest({})
    q[q.size - model.modes :] = 0.05 * rng.standard_normal(model.modes)
    return np.concatenate((q, 0.4 * rng.standard_normal(model.coordinates)))


def place_of(model: Any, testbed: Any, x: Any, name: str, t: float) -> Any:
    """Return where a sensor is in inertial space, and its axes there."""
    body, own = testbed.craft, model.positions - model.modes
    place, turned = np.zeros(3), np.eye(3)
    if body.motion == layout.FREE:
        place, turned = x[:3], attitude(x[3:7])
    if body.motion == layout.PIVOT:
        turned = rotation_matrix(body.pivot_axis, x[0]).T
        place = body.pivot_place - turned @ body.pivot_place
    if name == "hub":
        return place + turned @ np.array(SENSORS["hub"]["place"]), turned
    a = body.appendages[0]
    axes = a.axes
    if a.hinge == layout.DRIVEN:
        axes = rotation_matrix(a.axis, x[own - 1]) @ axes
    for m in a.manoeuvres:  # smooth, from t = 0 on
        s = t / m.duration
        axes = (
            rotation_matrix(m.axis, m.angle * (s - np.sin(2.0 * np.pi * s) / (2.0 * np.pi))) @ axes
        )
    moved = a.shape.tip.place + a.shape.tip.displacement @ x[own : model.positions]
    return place + turned @ (a.place + axes.T @ moved), turned @ axes.T


@pytest.mark.first(6)
@pytest.mark.parametrize("motion", ["free", "held", "pivot"])
@pytest.mark.parametrize("turning", HINGES)
@pytest.mark.parametrize("name", ["hub", "tip"])
def test_an_accelerometer_reads_the_second_derivative_of_its_place(
    name: str, turning: str, motion: str
) -> None:
    testbed = craft(motion, turning)
    model = testbed.model()
    x, h, t = moving(model), 1e-4, 0.7
    effort = np.random.default_rng(2).standard_normal(model.efforts)
    tips = model.appendages
    read = tips.exact_reading(x, model.derivative(x, effort, t), t)[tips.names.index(name)]
    ahead, behind = (model.advance(x, effort, dt, t=t) for dt in (h, -h))
    places = [
        place_of(model, testbed, at, name, t + dt)
        for at, dt in ((behind, -h), (x, 0.0), (ahead, h))
    ]
    acceleration = (places[2][0] - 2.0 * places[1][0] + places[0][0]) / h**2
    direction = np.array(SENSORS[name]["direction"], dtype=float)
    direction /= np.linalg.norm(direction)
    felt = direction @ places[1][1].T @ acceleration
    assert read == pytest.approx(felt, rel=1e-5, abs=1e-6)


def test_displacement_rate_and_strain_are_those_of_the_bent_beam() -> None:
    testbed = craft()
    model = testbed.model()
    x = moving(model)
    q, v = model.modal_state(x)
    tip = exact_readings(model, x, np.zeros(model.efforts), 0.0).tip_deflection
    found = dict(zip(model.appendages.names, tip, strict=True))
    line = testbed.craft.appendages[0].shape.along

    def bent(s: float, modes: Any) -> Any:
        return line.point(s).displacement @ modes

    assert found["middle"] == pytest.approx(bent(1.0, q)[2])
    assert found["middle_rate"] == pytest.approx(bent(1.0, v)[2])
    h = 1e-3
    curvature = (bent(0.3 + h, q) - 2.0 * bent(0.3, q) + bent(0.3 - h, q)) / h**2
    assert found["root"] == pytest.approx(-(0.01 * curvature[0] + 0.02 * curvature[2]), rel=1e-3)


@pytest.mark.slow
def test_every_sensor_has_its_own_errors_and_a_name_in_the_measurement() -> None:
    wrong = {"bias": 0.5, "quantisation": 0.25}
    testbed = craft(near={**SENSORS["middle"], **wrong}, far={**SENSORS["middle"], "noise": 0.1})
    bench = Bench(BenchSettings(testbed=testbed, duration=1.0, seed=4))
    names = bench.appendages.names
    read = dict(zip(names, bench.question.tip_deflection, strict=True))
    assert read["near"] == 0.5
    assert read["boom_x"] == 0.0
    assert 0.0 < abs(read["far"]) < 1.0
    assert bench.question.tip_deflection.size == len(names) == 8


@pytest.mark.parametrize(
    ("sensor", "words"),
    [
        ({"kind": "strain"}, "None is no appendage; allowed: boom"),
        ({"kind": "rate", "appendage": "sail"}, "sail is no appendage; allowed: boom"),
        ({"kind": "accelerometer", "direction": [0, 0, 0]}, "has no direction"),
        ({"kind": "thermometer"}, "displacement"),
        ({"kind": "rate", "appendage": "boom", "noise": -1.0}, "noise"),
    ],
)
def test_wrong_sensors_are_refused(sensor: dict[str, Any], words: str) -> None:
    with pytest.raises(BadInput, match=words) as error:
        craft(odd=sensor)
    assert "\n" not in str(error.value)
