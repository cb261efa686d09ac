"""Each error source alone against the bench with that source alone."""

from typing import NamedTuple

import numpy as np
import pytest

from flexslew_control.plan import Plan
from flexslew_lab.budget.budget import Budget, BudgetRequest
from flexslew_lab.budget.contribution import Contribution
from flexslew_lab.budget.error_free import error_free, simulate
from flexslew_lab.budget.pointing_budget import pointing_budget
from flexslew_lab.budget.windows import KNOWLEDGE, METRICS
from flexslew_lab.trial.sources import read_trial
from flexslew_lab.trial.trial import Trial, plan_of_trial

LATE = "testbed.pointing_from=50"  # the linear loop is that of the goal, not of the slew
ORBIT = (
    "testbed.orbit={altitude: 6.0e5, inclination: 1.2, dipole: [0.5, -0.3, 0.4], "
    "solar_area: 9.0, solar_centre: [0.0, 0.0, 0.1]}"
)
PUSH = (
    "schedule=[{at: 45.0, disturbance: {roll: 0.001, "
    "pitch: {sine: {amplitude: 0.01, frequency: 0.3}}}}]"
)
WHEEL = (
    "testbed.wheels.roll.static_imbalance=1e-4",
    "testbed.wheels.roll.place=[0.1, 0.2, 0.3]",
    "testbed.initial_motion={wheel_speeds: {roll: 10.0}}",
)


class Alone(NamedTuple):
    """A source, and the errors by metric of a bench with it less those of one without."""

    source: Contribution
    flown: dict[str, np.ndarray]


def alone(name: str, *sets: str, source: str) -> Alone:
    trial, file = read_trial(name, list(sets))
    budget = pointing_budget(trial, file, BudgetRequest())
    plan = plan_of_trial(trial, predict=False)
    error = flight(trial, trial, plan, budget) - flight(trial, quiet(trial), plan, budget)
    (one,) = (c for c in budget.contributions if c.name == source)
    return Alone(one, budget.loop.named(budget.windows.of_series(error)))


def quiet(trial: Trial) -> Trial:
    return error_free(trial)


def flight(design: Trial, bench: Trial, plan: Plan | None, budget: Budget) -> np.ndarray:
    return simulate(design, bench, "here", plan, budget.loop).error


def rms(values: np.ndarray) -> np.ndarray:
    return np.asarray(np.sqrt((values**2).mean(axis=0)))


def test_a_disturbance_causes_the_errors_of_the_bench() -> None:
    found = alone("three_axes", PUSH, LATE, source="schedule.0.disturbance")
    for metric, flown in found.flown.items():
        predicted = found.source.parts[metric].fixed
        limit = 1e-4 * abs(flown).max() if metric in METRICS else 1e-12
        assert abs(predicted - flown).max() < limit, metric  # readings are exact


def test_torques_of_the_orbit_cause_the_errors_of_the_bench() -> None:
    found = alone("three_axes", ORBIT, LATE, source="testbed.orbit")
    for metric in ("APE", "MPE"):
        flown = found.flown[metric]
        assert abs(found.source.parts[metric].fixed - flown).max() < 2e-3 * abs(flown).max()


def test_an_unbalanced_wheel_causes_the_size_of_the_errors_of_the_bench() -> None:
    found = alone("three_axes", *WHEEL, LATE, source="testbed.wheels")
    for metric in ("APE", "RPE"):
        predicted = rms(found.source.parts[metric].fixed)
        assert predicted == pytest.approx(rms(found.flown[metric]), rel=0.06), metric


@pytest.mark.parametrize(
    "channel", ["joint_position", pytest.param("joint_velocity", marks=pytest.mark.slow)]
)
def test_a_bias_causes_the_errors_of_the_bench(channel: str) -> None:
    """The readings are rotation vectors, whose errors at a turn of 50 degrees are not the turn."""
    key = f"sensors.{channel}.bias"
    found = alone("three_axes", f"{key}=1e-5", LATE, source=key)
    flown = found.flown["MPE"]
    assert abs(found.source.parts["MPE"].fixed - flown).max() < 5e-3 * abs(flown).max()


@pytest.mark.slow
def test_a_noise_has_the_variance_of_the_bench() -> None:
    key = "sensors.joint_velocity.noise"
    found = alone("m1", f"{key}=1e-3", "duration=400", source=key)
    for metric in ("APE", "RPE"):
        predicted = np.sqrt(found.source.parts[metric].noise.mean(axis=0))
        assert rms(found.flown[metric]) == pytest.approx(predicted, rel=0.25), metric


def test_a_quantum_below_the_noise_is_white_and_another_is_flown() -> None:
    key = "sensors.joint_position"
    fine = pointing_budget(
        *read_trial("m1", [f"{key}.noise=1e-4", f"{key}.quantisation=1e-4"]), BudgetRequest()
    )
    (white,) = (c for c in fine.contributions if c.name == f"{key}.quantisation")
    assert white.parts["APE"].fixed.max() == 0.0
    (noise,) = (c for c in fine.contributions if c.name == f"{key}.noise")
    ratio = white.parts["APE"].noise / noise.parts["APE"].noise
    assert ratio == pytest.approx(1.0 / 12.0)
    coarse = alone("m1", f"{key}.quantisation=1e-4", source=f"{key}.quantisation")
    assert abs(coarse.source.parts["APE"].fixed - coarse.flown["APE"]).max() == 0.0


def test_a_delay_and_friction_are_the_differences_of_flights() -> None:
    delay = "schedule=[{at: 0.0, fault: {kind: command_delay, ticks: 2}}]"
    budget = pointing_budget(
        *read_trial("m1", [delay, "allow_faults=true", "actuator.coulomb_friction=1e-2"]),
        BudgetRequest(),
    )
    kinds = {c.name: c.kind for c in budget.contributions}
    assert kinds["schedule.0.fault.command_delay"] == "delay"
    assert kinds["actuator.coulomb_friction"] == "friction"
    assert all(c.parts["APE"].fixed.any() for c in budget.contributions if c.kind == "delay")


def test_errors_of_knowledge_of_readings_are_those_of_the_sensors() -> None:
    key = "sensors.joint_position"
    budget = pointing_budget(
        *read_trial("m1", [f"{key}.noise=2e-4", f"{key}.bias=1e-4"]), BudgetRequest(window=5.0)
    )
    parts = {one.name: one.parts for one in budget.contributions}
    n = budget.windows.length
    noise = parts[f"{key}.noise"]
    shares = {"AKE": 1.0, "MKE": 1.0 / n, "RKE": 1.0 - 1.0 / n, "KDE": 2.0 / n}
    for metric, share in shares.items():
        assert noise[metric].noise == pytest.approx(4e-8 * share), metric
    assert parts[f"{key}.bias"]["AKE"].fixed == pytest.approx(1e-4)


def test_an_observer_has_the_errors_of_knowledge_of_the_bench() -> None:
    """A bias of the sensors of an observer on its own model, as the linear form predicts it."""
    key = "sensors.joint_position.bias"
    found = alone("scole_full", f"{key}=1e-5", source=key)
    for metric in (KNOWLEDGE["APE"], KNOWLEDGE["MPE"]):
        flown = found.flown[metric]
        predicted = found.source.parts[metric].fixed
        assert abs(flown).max() > 1e-6
        assert abs(predicted - flown).max() < 0.02 * abs(flown).max(), metric


def test_gyro_and_star_tracker_have_the_variances_of_the_bench() -> None:
    """Within a window, where a short flight has many independent errors."""
    sensors = (
        "testbed.sensors={gyro: {kind: gyro, angle_random_walk: 1.0e-6, rate_random_walk: 1.0e-8}, "
        "tracker: {kind: star_tracker, across: 1.0e-5, about: 2.0e-5}}"
    )
    hold = "plan={method: none, goal: {roll: 0.0, pitch: 0.0, yaw: 0.0}}"
    law = "controllers.pd_feedforward={kp: [12.0], kd: [60.0], attitude: {}}"
    sets = [sensors, hold, law, "testbed.pointing_from=20"]
    trial, source = read_trial("three_axes", sets)
    budget = pointing_budget(trial, source, BudgetRequest(window=2.0))
    plan = plan_of_trial(trial, predict=False)
    error = flight(trial, trial, plan, budget)
    flown = budget.loop.named(budget.windows.of_series(error))
    for metric in ("RPE", "RKE"):
        parts = [one.parts[metric] for one in budget.contributions]
        predicted = np.sqrt(sum(p.noise.mean(axis=0) for p in parts))
        assert rms(flown[metric]) == pytest.approx(predicted, rel=0.25), metric
        assert rms(flown[metric]).mean() == pytest.approx(predicted.mean(), rel=0.12), metric
