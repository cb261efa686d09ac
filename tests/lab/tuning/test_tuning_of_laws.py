"""Numbers of laws and PIDs are tuned in the loop of the running law, which has the same numbers."""

from typing import Any

import numpy as np
import pytest

import flexslew as fs
from flexslew_lab.tuning.tuned import TunedController, bench_loops
from flexslew_lab.tuning.tuning_file import read_tuning
from flexslew_plant.errors import BadInput

pytest.importorskip("ctrlsys")
GAINS: dict[str, Any] = {
    "tuning": "m1_gains", "trial": "m1", "controller": "pd_feedforward",
    "structure": {"kind": "gains"},
    "goals": [
        {"goal": "margin", "disk": 1.0, "hard": False},
        {"goal": "gain", "source": ["disturbance.base_yaw"], "to": ["position.base_yaw"],
         "below": 0.004},
    ],
    "starts": 1, "evaluations": 150,
}  # fmt: skip


@pytest.fixture(scope="module")
def gains() -> TunedController:
    return fs.tune(GAINS)


def test_soft_goals_improve_while_hard_ones_are_met(gains: TunedController) -> None:
    soft, hard = gains.goals
    assert hard.met
    assert soft.value < soft.before or hard.before > 1.0
    found = fs.analyse(gains.trial, "pd_feedforward")
    assert found.stable


def test_a_gain_goal_is_the_peak_of_the_bench_s_closed_loop(gains: TunedController) -> None:
    """The disturbance is added to the command, as in the loop of the analysis."""
    loop = next(iter(bench_loops(gains.problem, gains.trial).values()))
    closed = loop.closed
    w = np.append(np.geomspace(1e-3, np.pi / closed.period, 20_000), gains.goals[1].frequency)
    z = np.exp(1j * w * closed.period)
    row = closed.rows(["position.base_yaw"])
    column = closed.inputs.index("effort.base_yaw")
    size = abs(row.at(z)[:, 0, column])
    assert gains.goals[1].value == pytest.approx(size[-1] / 0.004, rel=1e-6)
    assert size.max() == size[-1]


def test_the_numbers_of_a_law_stand_in_the_tuned_trial(gains: TunedController) -> None:
    section = gains.trial.controllers["pd_feedforward"]
    assert section is not None
    assert {"kp", "kd"} <= set(section)
    assert gains.section["kp"] != [460.0, 460.0]


def test_numbers_in_which_a_law_is_not_affine_are_refused() -> None:
    keys = {"controller": "output_feedback", "trial": "swap_demo",
            "structure": {"kind": "gains", "keys": ["weight_frequency"]}}  # fmt: skip
    with pytest.raises(BadInput, match="the law is not affine in them"):
        read_tuning({**GAINS, **keys, "goals": [{"goal": "margin", "disk": 0.5}]})


M1_PID: dict[str, Any] = {
    "tuning": "m1_pid", "trial": "m1", "controller": "notched",
    "structure": {
        "kind": "pid",
        "loops": {
            "effort.base_yaw": {"input": "error.base_yaw", "kp": 460.0, "kd": 920.0,
                                "filter": 0.02, "notches": [{"frequency": 6.0}]},
            "effort.hub_pitch": {"input": "error.hub_pitch", "kp": 460.0, "kd": 920.0,
                                 "filter": 0.02},
        },
    },
    "goals": [
        {"goal": "margin", "disk": 0.4},
        {"goal": "bandwidth", "frequency": 0.05},
        {"goal": "roll_off", "frequency": 20.0, "at": "sensors"},
        {"goal": "tracking", "joints": ["base_yaw"], "time": 20.0, "steady": 0.1},
        {"goal": "poles", "damping": 0.001},
    ],
    "starts": 1, "evaluations": 60,
}  # fmt: skip


@pytest.fixture(scope="module")
def m1_pid() -> TunedController:
    return fs.tune(M1_PID)


def test_weighted_goals_bound_the_responses_of_the_bench_s_loop(m1_pid: TunedController) -> None:
    """Of S and T with all efforts or sensors open at once, from the loop of the running law."""
    loop = next(iter(bench_loops(m1_pid.problem, m1_pid.trial).values()))
    w = np.geomspace(1e-3, 100.0, 3000)
    response = loop.response(w)
    numbers = {goal.label.split(" ")[0]: goal.value for goal in m1_pid.goals}

    def sensitivity(names: tuple[str, ...]) -> Any:
        return np.linalg.inv(np.eye(len(names)) + loop.loop_gain(names, response))

    def sizes(matrices: Any) -> Any:
        return np.linalg.norm(matrices, 2, axis=(1, 2))

    s = sizes(sensitivity(loop.effort_names))
    slow = w < 0.05
    assert (s <= numbers["bandwidth"] * np.sqrt((w / 0.05) ** 2 + 1e-6) * 1.01)[slow].all()
    sensors = tuple(n for n in loop.sensor_names if n.startswith("position"))
    t = sizes(np.eye(len(sensors)) - sensitivity(sensors))
    fast = w > 20.0
    assert (t <= numbers["roll-off"] * 20.0 / w * np.sqrt(1.0 + (0.005 * w) ** 2) * 1.01)[
        fast
    ].all()
    closed = loop.closed
    columns = [closed.inputs.index(f"reference.{joint}") for joint in loop.joint_names]
    row = closed.rows(["position.base_yaw"]).at(np.exp(1j * w * closed.period))
    error = abs(1.0 - row[:, 0, columns[loop.joint_names.index("base_yaw")]])
    bound = abs((1.5j * w + 0.1 * 0.1) / (1j * w + 0.1))
    assert (error <= numbers["tracking"] * bound * 1.01).all()
    damping = min(pole.damping for pole in m1_pid.analysis.poles)
    assert numbers["poles"] == pytest.approx(0.001 / damping, rel=1e-3)
