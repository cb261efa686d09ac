from math import pi
from typing import Any

import pytest

from flexslew_plant.bench.bench import Bench, BenchSettings
from flexslew_plant.bench.schedule import Schedule
from flexslew_plant.errors import BadInput
from flexslew_plant.settings import validated


def read(*entries: Any) -> Any:
    return validated(Schedule, list(entries), "trial.yaml")


def test_entries_are_read_in_their_order() -> None:
    first, second = read(
        {"at": 40.0, "switch": "other"},
        {"at": 60.0, "until": 80.0, "disturbance": {"base_yaw": 5.0}},
    )
    assert (first.at, first.switch, first.disturbance) == (40.0, "other", None)
    assert (second.until, second.disturbance) == (80.0, {"base_yaw": 5.0})


@pytest.mark.parametrize(
    ("entry", "words"),
    [
        ({"at": 1.0}, "exactly one of"),
        ({"at": 1.0, "switch": "a", "disturbance": {"base_yaw": 1.0}}, "exactly one of"),
        ({"at": 1.0, "until": 2.0, "switch": "a"}, "until is only for"),
        ({"at": 2.0, "until": 2.0, "disturbance": {"base_yaw": 1.0}}, "until must be later"),
        ({"at": -1.0, "switch": "a"}, "0.at: -1.0 is not allowed"),
        ({"switch": "a"}, "at"),
        ({"at": float("nan"), "switch": "a"}, "at: nan is not allowed"),
        ({"at": 1.0, "disturbance": {"base_yaw": float("inf")}}, "inf is not allowed"),
        ({"at": 1.0, "swich": "a"}, "did you mean switch"),
    ],
)
def test_a_wrong_entry_is_refused_in_one_line(entry: Any, words: str) -> None:
    with pytest.raises(BadInput, match=words) as caught:
        read(entry)
    assert str(caught.value).startswith("trial.yaml: 0")
    assert "\n" not in str(caught.value)


def test_a_disturbance_of_an_unknown_joint_is_refused() -> None:
    schedule = read({"at": 1.0, "disturbance": {"base_yav": 1.0}})
    with pytest.raises(BadInput, match=r"base_yav is not a joint.*base_yaw, hub_pitch"):
        Bench(BenchSettings(schedule=schedule))


BIAS = "kind: sensor_bias, channel"


@pytest.mark.parametrize(
    ("text", "allowed"),
    [
        (f"{{{BIAS}: joint_position, of: base_yaw, bias: 1 deg}}", ""),
        (f"{{{BIAS}: joint_velocity, bias: 1 deg/s}}", ""),
        (f"{{{BIAS}: tip_deflection, bias: -3 mm}}", ""),
        ("{kind: actuator_stuck, joint: hub_pitch, effort: 3 N m}", ""),
        (f"{{{BIAS}: joint_position, bias: 1 mm}}", "give a number in rad, mrad"),
        (f"{{{BIAS}: joint_velocity, bias: 1 deg}}", "give a number in rad/s, deg/s"),
        (f"{{{BIAS}: tip_deflection, bias: 1 deg}}", "give a number in m, mm"),
        (f"{{{BIAS}: root_curvature, bias: 1 mm}}", "give a number in 1/m"),
        ("{kind: actuator_stuck, joint: hub_pitch, effort: 3 N}", "give a number in N m, mN m"),
        ("{disturbance: {hub_pitch: 3 N}}", "give a number in N m, mN m"),
        ("{disturbance: {hub_pitch: {pulse: {amplitude: 3 N, width: 1}}}}", "in N m, mN m"),
    ],
)
def test_an_injected_quantity_is_in_the_unit_of_what_it_is_about(text: str, allowed: str) -> None:
    bench = Bench(BenchSettings(allow_faults=True))
    result = bench.inject(text)
    assert (result.refused is None) == (not allowed)
    assert allowed in str(result.refused)


def test_a_bias_with_a_unit_is_that_number_in_si() -> None:
    values = {"kind": "sensor_bias", "channel": "joint_position", "bias": "180 deg"}
    (entry,) = read({"at": 1.0, "fault": values})
    assert entry.fault.bias == pytest.approx(pi)
