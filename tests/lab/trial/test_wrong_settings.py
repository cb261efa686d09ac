"""What is wrong in the settings of a law or planner is told as soon as the trial is made."""

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

import flexslew as fs
from flexslew_control.controllers import CONTROLLERS, build_controller
from flexslew_control.planners import PLANNERS
from flexslew_lab.trial.trial import build_controllers, load_trial, plant_of
from flexslew_plant.errors import BadInput
from flexslew_plant.settings import plain
from flexslew_plant.yaml_data import yaml_text

WRONG = [float("nan"), float("inf"), float("-inf"), "a", "nan", [1.0, float("nan")], {"x": 1}]


def numbers(section: dict[str, Any], above: str = "") -> Iterator[str]:
    """Yield the keys of all numbers, and lists of them, of a section."""
    for key, value in section.items():
        if isinstance(value, dict):
            yield from numbers(value, f"{above}{key}.")
        elif isinstance(value, (int, float, list)) and not isinstance(value, bool):
            yield above + key


@pytest.mark.parametrize("law", CONTROLLERS)
def test_no_number_of_a_law_is_none(law: str) -> None:
    keys = [*numbers(plain(CONTROLLERS[law].settings()))]
    assert keys or law == "linear"
    for key in keys:
        for wrong in WRONG:
            values = {"controllers": {law: {}}, f"controllers.{law}.{key}": wrong}
            with pytest.raises(BadInput, match=key.rpartition(".")[2]) as caught:
                fs.trial("m1", {**values, "active": law, "plan": None})
            assert f"controllers.{law}" in str(caught.value)
            assert "\n" not in str(caught.value)


@pytest.mark.parametrize("method", PLANNERS)
def test_no_number_of_a_planner_is_none(method: str) -> None:
    needed = {"goal": {"base_yaw": 1.0}} if method == "time_optimal" else {}
    for key in numbers(plain(PLANNERS[method].settings(**needed))):
        for wrong in WRONG:
            with pytest.raises(BadInput, match=key.rpartition(".")[2]) as caught:
                fs.trial("m1", {"plan": {"method": method, **needed}, f"plan.{key}": wrong})
            assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"controllers.pd_feedforward.kp": [1, 2, 3]}, "kp: .* give 1 or 2 numbers"),
        ({"controllers.pd_feedforward.kp": [1, -1]}, "kp.1: -1"),
        ({"controllers.pd_feedforward.kq": 1.0}, "kq"),
        ({"controllers.pd_feedforward.handover_time": -1.0}, "handover_time"),
        ({"controllers.lqr": {"weights": {"effort": 0.0}}}, "weights.effort"),
        ({"controllers.proportional_integral": {"tracking_time": 0.004}}, "half a tick"),
        ({"plan.goal": {"base_jaw": 1.0}}, "plan.goal.* did you mean base_yaw"),
        (
            {
                "allow_faults": True,
                "schedule": [
                    {"at": 0.0, "fault": {"kind": "actuator_gain", "joint": "jaw", "gain": 0.5}}
                ],
            },
            r"schedule\.0\.fault\.joint: the testbed has no jaw; allowed: base_yaw, hub_pitch",
        ),
        (
            {"schedule": [{"at": 5.0, "disturbance": {"jaw": 1.0}}]},
            r"schedule\.0\.disturbance.*jaw.*base_yaw, hub_pitch",
        ),
    ],
)
def test_what_does_not_suit_the_bench_is_told_by_file_and_key(
    changes: dict[str, Any], words: str, tmp_path: Path
) -> None:
    with pytest.raises(BadInput, match=words):
        fs.trial("m1", changes)
    keys = plain(fs.trial("m1"))
    for path, value in changes.items():
        *above, key = path.split(".")
        inner = keys
        for part in above:
            inner = inner[part]
        inner[key] = value
    file = tmp_path / "wrong.yaml"
    file.write_text(yaml_text(keys))
    with pytest.raises(BadInput, match=words) as caught:
        load_trial(file)
    assert str(caught.value).startswith(str(file))


@pytest.mark.parametrize(
    ("law", "own"),
    [
        ("lqr", {"weights": {"time": 1e308}}),
        ("model_predictive", {"step": 1e308}),
        ("proportional_integral", {"weights": {"time": 1e308}}),
        ("output_feedback", {"weight_frequency": 1e308}),
    ],
)
def test_numbers_beyond_those_of_a_computer_are_refused(law: str, own: dict[str, Any]) -> None:
    trial = fs.trial("m1", {"controllers": {law: own}, "active": law, "plan": None})
    with pytest.raises(BadInput, match=f"controllers.{law}.*out of range"):
        build_controllers(trial, "here")
    with pytest.raises(BadInput, match=r"a node.*out of range"):
        build_controller("x", law, own, plant_of(trial), "a node")
