"""Excitations shake where they say, keep within their limits and tell the joints apart."""

from typing import Any

import numpy as np
import pytest
from tests.representatives import products

from flexslew_control.law import PlantDescription
from flexslew_control.planners.entry import PlanTask
from flexslew_control.planners.excitation.excitation import Excitation, plan_excitation
from flexslew_control.planners.excitation.signals import lines_of, multisine, orthogonal
from flexslew_control.planners.slew import Feedback
from flexslew_plant.errors import BadInput
from flexslew_plant.settings import validated
from flexslew_plant.testbeds import read_testbed

SIGNALS = ("multisine", "chirp", "random_binary", "impulse")


def planned(kind: str = "csa", gains: Any = (460.0, 920.0), **keys: Any) -> Any:
    testbed = read_testbed({"kind": kind}, "here")
    plant = PlantDescription(testbed, 0.01, np.array(testbed.effort_limit))
    settings = validated(Excitation, keys, "here")
    feedback = Feedback(kp=(gains[0],), kd=(gains[1],))
    return plan_excitation(PlanTask(settings, plant, feedback)), plant


@pytest.mark.parametrize(
    ("kind", "signal"),
    products(["csa", "floating_oscillator", "hub_with_appendages"], SIGNALS),
)
def test_the_largest_amplitude_keeps_the_limits_when_it_is_flown(kind: str, signal: str) -> None:
    gains = (460.0, 920.0) if kind == "csa" else (0.5, 1.0)
    plan, plant = planned(kind, gains, signal=signal, duration=120.0, band=[0.5, 8.0],
                          largest_excursion=[0.01], effort_share=0.4)  # fmt: skip
    model = plant.testbed.model()
    x = np.zeros(2 * model.coordinates)
    effort, away = np.zeros(model.joints), np.zeros(model.joints)
    for push in plan.effort:
        position, rate = model.joint_state(x)
        u = push - gains[0] * position - gains[1] * rate
        effort, away = np.maximum(effort, abs(u)), np.maximum(away, abs(position))
        x = model.advance(x, u, 0.01)
    assert (effort <= 0.4 * plant.effort_limit * (1.0 + 1e-9)).all()
    assert (away <= 0.01 * (1.0 + 1e-9)).all()
    used = max((effort / plant.effort_limit / 0.4).max(), (away / 0.01).max())
    assert used > 0.9
    assert plan.summary["predicted_excursion"] == pytest.approx(
        dict(zip(model.joint_names, away.tolist(), strict=True)), rel=1e-4
    )  # what .01 rad leave that is not linear
    np.testing.assert_array_equal(plan.position, np.zeros_like(plan.position))


def test_whole_periods_repeat_and_joints_are_orthogonal_at_every_line() -> None:
    plan, _ = planned(duration=200.0, band=[0.5, 8.0], amplitude=[1.0])
    period = round(plan.summary["period"] / 0.01)
    first = round(plan.summary["taper"] / 0.01)
    lines = lines_of((0.5, 8.0), period, 0.01).astype(int)
    spectra = []
    for e in range(2):
        begin = first + e * plan.summary["periods"] * period
        one = plan.effort[begin : begin + period]
        np.testing.assert_array_equal(one, plan.effort[begin + period : begin + 2 * period])
        spectra.append(np.fft.rfft(one, axis=0))
    both = np.array(spectra)  # (experiments, lines, joints)
    for line in lines:
        gram = both[:, line].conj().T @ both[:, line]
        assert abs(gram[0, 1]) < 1e-9 * abs(gram[0, 0])
    power = np.abs(both[0]) ** 2
    assert power[lines].sum() == pytest.approx(power.sum(), rel=1e-12)
    ends = plan.effort[[0, len(plan.effort) - 1]]
    assert np.abs(ends).max() < 0.01


@pytest.mark.parametrize("joints", [1, 2, 3, 5])
def test_experiments_tell_any_number_of_joints_apart(joints: int) -> None:
    turns = orthogonal(joints)
    np.testing.assert_allclose(turns.conj().T @ turns, joints * np.eye(joints), atol=1e-12)


def test_chosen_phases_have_a_lower_crest_factor_than_random_ones() -> None:
    lines = np.arange(5.0, 95.0)
    crest = {}
    for phases in ("random", "schroeder", "optimised"):
        one = multisine(lines, np.ones(90), 2000, phases, np.random.default_rng(3))
        crest[phases] = 1.0 / np.sqrt(np.mean(one**2))
    assert crest["optimised"] < crest["schroeder"] < crest["random"]
    assert crest["optimised"] < 1.6


@pytest.mark.parametrize(
    ("keys", "words"),
    [
        ({"band": [3.0, 2.0]}, r"plan: band: \[3, 2\] is not allowed"),
        ({"band": [1.0, 400.0]}, r"at most 157.1 rad/s"),
        ({"joints": ["wing"]}, r"plan: joints: wing is not allowed.*base_yaw"),
        ({"joints": ["base_yaw", "base_yaw"]}, r"at most once"),
        ({"band": [0.1, 2.0], "duration": 20.0}, r"plan: duration: 20 is not allowed.*need"),
        ({"amplitude": [500.0]}, r"plan: amplitude: 500 is not allowed: base_yaw has 150"),
        ({"signal": "noise"}, r"signal"),
    ],
)
def test_what_cannot_be_shaken_is_refused_in_one_line(keys: Any, words: str) -> None:
    with pytest.raises(BadInput, match=words) as error:
        planned(**keys)
    assert "\n" not in str(error.value)
