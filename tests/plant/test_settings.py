from typing import Any

import numpy as np
import pytest

from flexslew_plant.bench.bench import BenchSettings
from flexslew_plant.errors import BadInput
from flexslew_plant.settings import PerJoint, flat, plain, validated
from flexslew_plant.testbeds import TestbedSettings as Bed
from flexslew_plant.testbeds import read_testbed
from flexslew_plant.testbeds.csa import CsaTestbed
from flexslew_plant.yaml_data import load_yaml, yaml_text


def refusal(kind: Any, values: Any) -> Any:
    with pytest.raises(BadInput) as caught:
        validated(kind, values, "trial.yaml")
    text = str(caught.value)
    assert text.startswith("trial.yaml: ")
    assert "\n" not in text
    return text


@pytest.mark.parametrize(
    ("kind", "values", "words"),
    [
        (
            Bed,
            {"varaint": "printed"},
            ["varaint: unknown key", "did you mean variant?"],
        ),
        (
            Bed,
            {"parameters": {"lenght": 3.0}},
            ["parameters.lenght", "did you mean length?"],
        ),
        (
            Bed,
            {"initial": {"xyz": 3.0}},
            ["initial.xyz", "allowed here: base_yaw, hub_pitch"],
        ),
        (BenchSettings, {"schedule": [{"switsh": "lqr"}]}, ["schedule.0.switsh: unknown key"]),
        (Bed, {"kind": "moon"}, ["moon", "csa"]),
        (Bed, {"variant": "half"}, ["variant", "'half'", "'printed' or 'complete'"]),
        (Bed, [{"kind": "csa"}], ["a list stands where keys belong"]),
        (Bed, {"initial": [{"base_yaw": 1.0}]}, ["initial: [{", "a list stands where keys belong"]),
        (BenchSettings, {"schedule": [["at", 3.0]]}, ["schedule.0: [", "a list stands where keys"]),
        (Bed, {"modes": 0}, ["modes: 0", "greater than or equal to 1"]),
        (Bed, {"modes": 2.5}, ["modes: 2.5"]),
        (Bed, {"modes": True}, ["modes: True", "give a number"]),
        (Bed, {"parameters": {"length": True}}, ["parameters.length: True", "give a number"]),
        (
            Bed,
            {"parameters": {"base_inertia": -2000.0}},
            ["base_inertia: -2000.0", "greater than 0"],
        ),
        (Bed, {"parameters": {"length": float("nan")}}, ["parameters.length: nan"]),
        (
            Bed,
            {"parameters": {"length": float("inf")}},
            ["parameters.length: inf", "finite"],
        ),
        (Bed, {"parameters": {"length": "long"}}, ["parameters.length: 'long'"]),
        (Bed, {"effort_limit": [150.0]}, ["effort_limit"]),
        (
            Bed,
            {"effort_limit": [150.0, -1.0]},
            ["effort_limit.1: -1.0", "greater than 0"],
        ),
        (Bed, {"effort_limit": [1.0, 2.0, 3.0]}, ["effort_limit"]),
        (Bed, {"damping_ratio": 1.0}, ["damping_ratio: 1.0", "less than 1"]),
        (Bed, {"parameters": 5}, ["parameters: 5"]),
        (BenchSettings, {"period": 0.0}, ["period: 0.0", "greater than 0"]),
        (BenchSettings, {"testbed": {"modes": -1}}, ["modes: -1"]),
        (BenchSettings, {"max_missed": 0}, ["max_missed: 0"]),
        (BenchSettings, {"actuator": {"lagg": 1.0}}, ["actuator.lagg", "did you mean lag?"]),
        (BenchSettings, {"sensors": {"joint_position": {"nois": 1.0}}}, ["did you mean noise?"]),
        (BenchSettings, {"testbed": {"parameters": {"lenght": 1}}}, ["did you mean length?"]),
    ],
)
def test_bad_values_are_told_in_one_line_with_key_value_and_what_is_allowed(
    kind: Any, values: Any, words: Any
) -> None:
    text = refusal(kind, values)
    for word in words:
        assert word in text


def test_a_key_of_another_testbed_is_not_offered() -> None:
    text = refusal(Bed, {"kind": "floating_oscillator", "variant": "printed"})
    assert "unknown key" in text
    assert "bending_stiffness" not in text


def test_further_errors_are_named() -> None:
    text = refusal(Bed, {"modes": 0, "damping_ratio": -1.0})
    assert text.endswith("(wrong or missing, too: damping_ratio)")
    many = {"schedule": [{"switsh": "lqr"}], "period": 0.0, "seed": "x", "duration": -1.0}
    assert refusal(BenchSettings, many).endswith("too: duration, seed, schedule.0.at and 1 more)")


def test_a_misspelled_key_is_told_before_the_one_that_is_missing() -> None:
    entry = {"switsh": "lqr", "att": 3.0, "retargt": {}}
    text = refusal(BenchSettings, {"schedule": [entry]})
    assert text.startswith("trial.yaml: schedule.0.switsh: unknown key; did you mean switch?")
    assert text.endswith("(wrong or missing, too: at, att, retargt)")


def test_long_values_are_cut() -> None:
    assert len(refusal(BenchSettings, {"active": list(range(1000))})) < 200


def test_settings_come_back_from_yaml() -> None:
    settings = validated(BenchSettings, {"testbed": {"modes": 2}, "fallback": ["a"]}, "here")
    text = yaml_text(plain(settings))
    assert validated(BenchSettings, load_yaml(text, "here"), "here") == settings


def test_flat_settings_are_ros_parameters() -> None:
    values = {
        "a": {"b": 1, "c": {"d": [1.0, 2.0]}},
        "e": None,
        "f": [],
        "g": [{"at": 1.0}],
        "h": {},
    }
    assert flat(values) == {"a.b": 1, "a.c.d": [1.0, 2.0], "g": "[{at: 1.0}]\n", "h": "{}"}


def test_settings_cannot_be_changed() -> None:
    bed = CsaTestbed()
    with pytest.raises(AttributeError):
        setattr(bed, "modes", 4)  # noqa: B010  # what a type checker would refuse
    assert np.isfinite(bed.parameters.length)


@pytest.mark.parametrize(
    ("kind", "values", "words"),
    [
        (Bed, 5, "trial.yaml: (whole file): 5 is not allowed: give keys"),
        (Bed, {"kind": "moon"}, "moon is not a testbed; allowed: csa, "),
        (
            Bed,
            {"effort_limit": [5.0]},
            "effort_limit: [5.0] is not allowed: too few entries",
        ),
        (BenchSettings, {"testbed": 5}, "testbed: 5 is not allowed: give keys"),
        (BenchSettings, {"fallback": "pd"}, "fallback: 'pd' is not allowed: give a list"),
        (BenchSettings, {"schedule": [{}]}, "schedule.0.at: is missing"),
        (BenchSettings, {"allow_faults": "perhaps"}, "'perhaps' is not allowed: give true or"),
        (BenchSettings, {"max_missed": 1.5}, "max_missed: 1.5 is not allowed: give a whole number"),
        (PerJoint, [], "[] is not allowed: at least 1 entry, here 0"),
    ],
)
def test_no_word_of_python_reaches_the_user(kind: Any, values: Any, words: str) -> None:
    text = refusal(kind, values)
    assert words in text
    for python in ("tuple", "dictionary", "instance", "_kind", "Input should", "argument", "class"):
        assert python not in text


def test_a_single_number_serves_every_joint() -> None:
    assert validated(PerJoint, 460, "t") == validated(PerJoint, [460.0], "t") == (460.0,)
    assert validated(PerJoint, [1.0, 2.0], "t") == (1.0, 2.0)


@pytest.mark.parametrize(("kind", "drives"), [("csa", 2), ("floating_oscillator", 1)])
def test_a_single_effort_limit_serves_every_drive(kind: str, drives: int) -> None:
    found = read_testbed({"kind": kind, "effort_limit": 7}, "t")
    assert found.effort_limit == (7.0,) * drives
    assert "effort_limit.0: -7 is not allowed" in refusal(Bed, {"kind": kind, "effort_limit": -7})
