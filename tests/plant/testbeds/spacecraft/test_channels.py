"""Sensors on appendages and on the platform read what the motion is."""

from typing import Any

import numpy as np
import pytest
from tests.plant.testbeds.spacecraft.crafts import attitude

from flexslew_plant.bench.bench import Bench
from flexslew_plant.bench.records import BenchSettings
from flexslew_plant.errors import BadInput
from flexslew_plant.testbeds import read_testbed

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


def craft(motion: str = "free", **sensors: Any) -> Any:
    values = {
        "kind": "spacecraft",
        "platform": {
            "motion": motion,
            "mass": 40.0,
            "inertia": {"xx": 9.0, "yy": 8.0, "zz": 7.0, "xy": 0.5},
            "place": [0.1, 0.2, 0.0],
            "axis": [1.0, 1.0, 0.5],
        },
        "appendages": {"boom": {"shape": BOOM, "hinge": {"place": [0.3, 0, 0.2], "axes": AXES}}},
        "sensors": sensors or SENSORS,
    }
    return read_testbed(values, "here")


def moving(model: Any, seed: int = 3) -> Any:
    rng = np.random.default_rng(seed)
    q = model.rest({})
    q[q.size - model.modes :] = 0.05 * rng.standard_normal(model.modes)
    return np.concatenate((q, 0.4 * rng.standard_normal(model.coordinates)))


def place_of(model: Any, testbed: Any, x: Any, name: str) -> Any:
    """Return where a sensor is in inertia space, and the platform's axes."""
    a = testbed.craft.appendages[0]
    own, q = np.array(SENSORS["hub"]["place"]), x[model.positions - model.modes : model.positions]
    if name == "tip":
        tip = a.shape.tip
        own = a.place + a.axes.T @ (tip.place + tip.displacement @ q)
    turn = attitude(x[3:7])
    return x[:3] + turn @ own, turn


@pytest.mark.parametrize("name", ["hub", "tip"])
def test_an_accelerometer_reads_the_second_derivative_of_its_place(name: str) -> None:
    testbed = craft()
    model = testbed.model()
    x, effort, h = moving(model), np.array([3.0, -2.0, 1.0]), 1e-4
    tips = model.appendages
    read = tips.felt(x, model.derivative(x, effort), 0.0)[tips.names.index(name)]
    ahead, behind = (model.advance(x, effort, dt) for dt in (h, -h))
    here, turn = place_of(model, testbed, x, name)
    there = [place_of(model, testbed, at, name)[0] for at in (ahead, behind)]
    acceleration = (there[0] - 2.0 * here + there[1]) / h**2
    direction = np.array(SENSORS[name]["direction"], dtype=float)
    direction /= np.linalg.norm(direction)
    if name == "tip":
        direction = np.array(AXES).T @ direction
    assert read == pytest.approx(direction @ turn.T @ acceleration, rel=1e-5)


@pytest.mark.parametrize("motion", ["held", "pivot"])
def test_a_bound_platform_feels_its_own_motion_alone(motion: str) -> None:
    model = craft(motion).model()
    x = moving(model)
    tips = model.appendages
    effort = np.array([3.0, -2.0, 1.0])
    felt = tips.felt(x, model.derivative(x, effort), 0.0)[tips.names.index("hub")]
    assert (felt == 0.0) == (motion == "held")


def test_displacement_rate_and_strain_are_those_of_the_bent_beam() -> None:
    testbed = craft()
    model = testbed.model()
    x = moving(model)
    q, v = model.modal_state(x)
    found = dict(zip(model.appendages.names, model.appendages.reading(q, v), strict=True))
    line = testbed.craft.appendages[0].shape.along

    def bent(s: float, modes: Any) -> Any:
        return line.spot(s).displacement @ modes

    assert found["middle"] == pytest.approx(bent(1.0, q)[2])
    assert found["middle_rate"] == pytest.approx(bent(1.0, v)[2])
    h = 1e-3
    curvature = (bent(0.3 + h, q) - 2.0 * bent(0.3, q) + bent(0.3 - h, q)) / h**2
    assert found["root"] == pytest.approx(-(0.01 * curvature[0] + 0.02 * curvature[2]), rel=1e-3)


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
