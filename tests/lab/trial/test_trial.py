from collections.abc import Iterator
from copy import deepcopy
from functools import reduce
from math import pi
from operator import getitem
from pathlib import Path
from typing import Any

import pytest
from tests.present import present

from flexslew_lab.trial.sources import example_trials, read_trial, trial_path
from flexslew_lab.trial.trial import (
    load_trial,
    parse_trial,
    plan_of_trial,
    text_of,
    trial_of_values,
)
from flexslew_plant.errors import BadInput
from flexslew_plant.own_code import ANY_CODE
from flexslew_plant.yaml_data import load_yaml

HUB = """
duration: 10.0
testbed: {kind: hub_with_appendages}
plan: {method: time_optimal, goal: {hub: 1.0}, robust: false}
"""


def test_a_plan_starts_where_the_testbed_rests() -> None:
    plan = present(plan_of_trial(parse_trial(HUB, "hub.yaml")))
    assert plan.duration == pytest.approx(6.01986708, abs=1e-6)  # physics/time_optimal
    turned = HUB.replace("appendages}", "appendages, initial: {hub: 0.5}}").replace("1.0}", "1.5}")
    again = present(plan_of_trial(parse_trial(turned, "hub.yaml")))
    assert again.position[0, 0] == 0.5
    assert again.duration == pytest.approx(plan.duration, abs=1e-9)


def test_a_plan_believes_in_the_bench_unless_it_says_otherwise() -> None:
    text = """
    testbed: {parameters: {bending_stiffness: 1200.0}, initial: {hub_pitch: 0.2}}
    plan: {method: optimized_feedforward, goal: {base_yaw: 0.5}, duration: 30.0}
    controllers: {pd_feedforward: {kp: 500.0, kd: [900.0, 950.0]}}
    """
    plan = present(plan_of_trial(parse_trial(text, "csa.yaml")))
    asked = plan.request
    assert asked["model"]["parameters"]["bending_stiffness"] == 1200.0
    assert asked["initial"] == {"base_yaw": 0.0, "hub_pitch": 0.2}
    assert asked["goal"] == {"base_yaw": 0.5, "hub_pitch": 0.2}
    assert asked["feedback"] == {"kp": [500.0, 500.0], "kd": [900.0, 950.0]}
    assert plan.summary["believes"] == "1 mode instead of 3"


@pytest.mark.parametrize(
    ("plan", "words"),
    [
        ("model: {variant: printed}", "variant printed instead of complete, 1 mode instead of 3"),
        ("model: {modes: 3}", ""),
        ("initial: {base_yaw: 0.1}", "1 mode instead of 3, initial.base_yaw 0.1 instead of 0.0"),
        (
            "feedback: {kp: 400.0, kd: 920.0}",
            "1 mode instead of 3, feedback.kp [400.0, 400.0] instead of [460.0, 460.0]",
        ),
    ],
)
def test_a_plan_says_what_it_believes_differently_from_the_bench(plan: str, words: str) -> None:
    text = f"plan: {{method: optimized_feedforward, duration: 40.0, {plan}}}"
    assert present(plan_of_trial(parse_trial(text, "csa.yaml"))).summary["believes"] == words


@pytest.mark.parametrize("name", ["m1", "swap_demo", "time_optimal_hub", "time_optimal_oscillator"])
def test_every_trial_that_comes_along_is_sound(name: str) -> None:
    trial = load_trial(trial_path(name))
    assert trial.name == name


@pytest.mark.parametrize(
    ("text", "word"),
    [
        ("testbed: hub\nplan: {method: time_optimal, goal: {hub: 1.0}}", "testbed"),
        ("plan: {method: time_optimal}", "goal"),
        ("plan: fast", "plan"),
        ("controllers: {'': {law: lqr}}\nactive: ''", "controllers: '' is not allowed: a name"),
        ("testbed: {kind: hub_with_appendages, length: 3}\nplan: {method: time_optimal}", "length"),
    ],
)
def test_what_is_wrong_is_named(text: str, word: str) -> None:
    with pytest.raises(BadInput, match=rf"t\.yaml: .*{word}") as caught:
        parse_trial(text, "t.yaml")
    assert "\n" not in str(caught.value)


def test_an_entry_after_the_end_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "t.yaml"
    text = "duration: 10.0\nschedule: [{at: AT, disturbance: {base_yaw: 1.0}}]"
    path.write_text(text.replace("AT", "9.99"))
    assert load_trial(path).duration == 10.0
    for late in ("10.0", "9.996", "70.0"):
        path.write_text(text.replace("AT", late))
        with pytest.raises(BadInput, match=r"schedule\.0\.at: .* the run ends at 10 s"):
            load_trial(path)


def test_a_run_without_a_tick_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "t.yaml"
    path.write_text("period: 0.02\nduration: 0.011", encoding="utf-8")
    assert load_trial(path).duration == 0.011
    path.write_text("period: 0.02\nduration: 0.01  # °", encoding="utf-8")
    with pytest.raises(BadInput, match=r"duration: 0\.01 is not allowed: at least a tick of 0\.02"):
        load_trial(path)


@pytest.mark.parametrize(
    ("text", "key"),
    [
        ("plan: {method: none, goal: {hub_pitch: 30 cm}}", "plan.goal.hub_pitch"),
        ("plan: {method: reference_only, initial: {base_yaw: 2 m}}", "plan.initial.base_yaw"),
        (
            "plan: {method: minimax_feedforward, joint_range: {base_yaw: [-1 deg, 5 mm]}}",
            "plan.joint_range.base_yaw.1",
        ),
        (
            "testbed: {kind: floating_oscillator}\nplan: {method: none, goal: {mass: 30 deg}}",
            "plan.goal.mass",
        ),
        (
            "schedule: [{at: 0, disturbance: {hub_pitch: {pulse: {amplitude: 3 N, width: 1}}}}]",
            "schedule.0.disturbance.hub_pitch.pulse.amplitude",
        ),
        (
            "plan: {method: time_optimal, goal: {base_yaw: 1}, amplitude: 90 N}",
            "plan.amplitude",
        ),
        ("schedule: [{at: 0, disturbance: {hub_pitch: 3 N}}]", "schedule.0.disturbance.hub_pitch"),
        (
            "{testbed: {kind: floating_oscillator}, actuator: {coulomb_friction: 1 N m}}",
            "actuator.coulomb_friction",
        ),
        ("sensors: {joint_position: {noise: 1 mm}}", "sensors.joint_position.noise"),
        ("sensors: {tip_deflection: {bias: 1 deg}}", "sensors.tip_deflection.bias"),
    ],
)
def test_a_joint_that_turns_is_given_in_no_unit_of_one_that_slides(text: str, key: str) -> None:
    with pytest.raises(BadInput, match=rf"t\.yaml: {key}: .* give a number in "):
        parse_trial(text, "t.yaml")


def test_every_joint_takes_the_units_of_its_own_kind() -> None:
    turns: Any = parse_trial("plan: {method: none, goal: {hub_pitch: 90 deg}}", "t.yaml")
    assert turns.plan.goal == {"hub_pitch": pi / 2}
    text = """
    testbed: {kind: floating_oscillator}
    plan: {method: none, goal: {mass: 30 cm}}
    actuator: {coulomb_friction: 5 mN, coulomb_speed: 1 mm/s, quantisation: 1 mN}
    schedule:
    - {at: 0.0, disturbance: {mass: {sine: {amplitude: 20 mN, frequency: 1.0}}}}
    - {at: 0.0, disturbance: {mass: 30 mN}}
    """
    slides: Any = parse_trial(text, "t.yaml")
    assert slides.plan.goal == {"mass": 0.3}
    assert slides.schedule[0].disturbance["mass"].sine.amplitude == 0.02
    assert slides.schedule[1].disturbance["mass"] == 0.03
    errors: Any = parse_trial(
        """sensors:
          joint_position: {noise: 0.1 mrad, quantisation: 20 arcsec}
          joint_velocity: {bias: 0.01 deg/s}
          tip_deflection: {noise: 1 mm}""",
        "t.yaml",
    ).sensors
    assert errors.joint_position.noise == pytest.approx(1e-4)
    assert errors.joint_position.quantisation == pytest.approx(pi / 32400.0)
    assert errors.joint_velocity.bias == pytest.approx(pi / 18000.0)
    assert errors.tip_deflection.noise == 1e-3
    motor = slides.actuator
    assert (motor.coulomb_friction, motor.coulomb_speed, motor.quantisation) == (5e-3, 1e-3, 1e-3)


def test_a_fault_that_silences_nobody_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "t.yaml"
    text = """
    allow_faults: true
    schedule: [{at: 1.0, fault: {kind: controller_silent, controller: NAME}}]
    """
    path.write_text(text.replace("NAME", "pd_feedforward"))
    load_trial(path)
    path.write_text(text.replace("NAME", "pd_feedforwrd"))
    with pytest.raises(BadInput, match=r"schedule\.0\.fault\.controller: .*mean pd_feedforward\?"):
        load_trial(path)


def test_a_trial_with_units_is_that_in_si() -> None:
    with_units = [
        "duration=1 min", "period=10 ms", "plan.duration=0.5 min", "plan.goal.hub_pitch=45 deg",
        "schedule=[{at: 12500 ms, switch: pd_feedforward}]",
    ]  # fmt: skip
    in_si = [
        "duration=60.0", "period=0.01", "plan.duration=30.0",
        f"plan.goal.hub_pitch={45.0 * (pi / 180.0)!r}",
        "schedule=[{at: 12.5, switch: pd_feedforward}]",
    ]  # fmt: skip
    assert read_trial("m1", with_units)[0] == read_trial("m1", in_si)[0]
    with pytest.raises(BadInput, match=r"plan\.duration: '45 deg' .* give a number in s"):
        read_trial("m1", ["plan.duration=45 deg"])


@pytest.mark.slow
def test_a_boolean_is_no_number_anywhere_in_a_trial() -> None:
    """Wherever shipped trials hold a number; laws and models are read where they are built."""
    asked = set[tuple[str, ...]]()
    for shipped in example_trials():
        values = load_yaml(text_of(shipped.path), shipped.name)
        for place in numbers(values):
            key = tuple(str(step) for step in place if not isinstance(step, int))
            if key in asked or key[0] == "controllers" or key[:2] == ("plan", "model"):
                continue
            asked.add(key)
            wrong = deepcopy(values)
            *way, last = place
            reduce(getitem, way, wrong)[last] = True
            with pytest.raises(BadInput):
                trial_of_values(wrong, shipped.name, ANY_CODE)
    assert len(asked) > 100


def numbers(values: Any, place: tuple[Any, ...] = ()) -> Iterator[tuple[Any, ...]]:
    if isinstance(values, dict | list):
        for key, part in values.items() if isinstance(values, dict) else enumerate(values):
            yield from numbers(part, (*place, key))
    elif isinstance(values, int | float) and not isinstance(values, bool):
        yield place


@pytest.mark.parametrize("name", ["m1", "control_moment_gyros"])
def test_a_boolean_is_no_number_of_modes_of_a_plan(name: str) -> None:
    with pytest.raises(BadInput, match="modes: True is not allowed"):
        plan_of_trial(read_trial(name, ["plan.model.modes=true"])[0])
