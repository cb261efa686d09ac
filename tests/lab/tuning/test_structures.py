"""Structures are the transfer functions that they state, and fly as the law that they write."""

from typing import Any

import numpy as np
import pytest
from scipy.signal import cont2discrete

import flexslew as fs
from flexslew_lab.tuning.pid_system import PidSystem
from flexslew_lab.tuning.settings import PidBlock, StateSpaceBlock
from flexslew_lab.tuning.structures import (
    ControllerStructure,
    TridiagonalSystem,
    matrix_and_slopes,
)
from flexslew_plant.arrays import Vector
from flexslew_plant.settings import validated

PERIOD = 0.02
NOTCH = {"frequency": 6.0, "zeros": 0.1, "poles": 0.6}
PID = {
    "kind": "pid",
    "loops": {
        "effort.base_yaw": {
            "input": "error.base_yaw", "kp": 3.0, "ki": 0.5, "kd": 2.0, "filter": 0.1,
            "notches": [NOTCH],
        },
        "effort.hub_pitch": {"input": "error.hub_pitch", "kp": 4.0},
    },
    "position_feedback": [
        {"input": "tip.beam", "output": "effort.hub_pitch", "gain": -2.0, "frequency": 5.0,
         "damping": 0.4},
    ],
}  # fmt: skip
BLOCK = {
    "kind": "state_space", "order": 3, "speed": 2.0, "inputs": {"position.mass + tip.spring": 0.1},
    "outputs": {"effort.mass": 5.0},
}  # fmt: skip


def pid(**changes: Any) -> PidSystem:
    return PidSystem(validated(PidBlock, {**PID, **changes}, "here"), PERIOD)


def state_space(period: float = PERIOD) -> TridiagonalSystem:
    return TridiagonalSystem(validated(StateSpaceBlock, BLOCK, "here"), period)


def response(section: dict[str, Any], s: complex) -> Any:
    """Return the continuous transfer matrix of a linear law's keys."""
    a, b, c, d = (np.array(section["system"][key]) for key in "abcd")
    return c @ np.linalg.solve(s * np.eye(len(a)) - a, b) + d


def test_a_pid_with_a_notch_and_position_feedback_is_its_transfer_functions() -> None:
    structure, s = pid(), 0.4 + 3.0j
    found = response(structure.section(structure.start), s)
    w = NOTCH["frequency"]
    notch = (s**2 + 2 * 0.1 * w * s + w**2) / (s**2 + 2 * 0.6 * w * s + w**2)
    first = (3.0 + 0.5 / s + 2.0 * s / (0.1 * s + 1.0)) * notch
    feedback = -2.0 * 25.0 / (s**2 + 2 * 0.4 * 5.0 * s + 25.0)
    assert structure.signals == ("error.base_yaw", "error.hub_pitch", "tip.beam")
    assert found == pytest.approx(np.array([[first, 0.0, 0.0], [0.0, 4.0, feedback]]))


def test_a_parameter_of_a_pid_keeps_its_sign_and_zero_is_none() -> None:
    structure = pid()
    assert "effort.hub_pitch.ki" not in structure.labels
    values = structure.values(-2.0 * np.ones(len(structure.labels)))
    assert values["position_feedback_1.gain"] == pytest.approx(-2.0 * np.exp(-2.0))
    assert values["effort.base_yaw.kp"] == pytest.approx(3.0 * np.exp(-2.0))


@pytest.mark.parametrize("structure", [pid(), state_space()], ids=["pid", "state_space"])
def test_derivatives_agree_with_differences(structure: ControllerStructure) -> None:
    x = structure.other_start(np.random.default_rng(2))
    k, slopes = matrix_and_slopes(structure, x)
    assert k == pytest.approx(np.real(structure.matrix(x)))
    step = 1e-6
    for unit, slope in zip(np.eye(x.size), slopes, strict=True):
        ends = [np.real(structure.matrix(x + sign * step * unit)) for sign in (1.0, -1.0)]
        numeric = (ends[0] - ends[1]) / (2.0 * step)
        assert slope == pytest.approx(numeric, rel=1e-5, abs=1e-6 * abs(k).max())


@pytest.mark.parametrize("structure", [pid(), state_space()], ids=["pid", "state_space"])
def test_the_sampled_gain_is_the_section_by_the_method_of_the_law(
    structure: ControllerStructure,
) -> None:
    x: Vector = structure.other_start(np.random.default_rng(2))
    section = structure.section(x)["system"]
    names = section["inputs"]
    a, b, c, d = (np.array(section[key]) for key in "abcd")
    # a sum of signals is one input of the structure, and the first of several equal ones here
    columns = [names.index(text.split("+")[0].strip()) for text in structure.signals]
    a, b, c, d, _ = cont2discrete((a, b[:, columns], c, d[:, columns]), PERIOD, "bilinear")
    m, p = d.shape
    k = np.real(structure.matrix(x))
    assert k == pytest.approx(np.block([[d, c], [b, a]]))
    assert k.shape == (m + len(a), p + len(a))


def test_sizes_and_speed_scale_a_state_space() -> None:
    """A size of its input and its output, and a speed, change units and nothing else."""
    structure = state_space()
    x = structure.other_start(np.random.default_rng(5))
    plain = {**BLOCK, "speed": 1.0, "inputs": {"position.mass": 1.0}, "outputs": {"effort.mass": 1}}
    one = TridiagonalSystem(validated(StateSpaceBlock, plain, "here"), PERIOD)
    scaled = response(structure.section(x), 2.0 * (0.3 + 1.0j))
    assert scaled[:, 0] == pytest.approx(50.0 * response(one.section(x), 0.3 + 1.0j)[:, 0])


def test_a_state_space_of_order_zero_is_a_gain() -> None:
    structure = TridiagonalSystem(validated(StateSpaceBlock, {**BLOCK, "order": 0}, ""), PERIOD)
    assert structure.labels == ("d.1",)
    assert structure.section(np.array([2.0]))["system"]["d"] == [[100.0, 100.0]]


def test_the_section_is_flown_by_the_law_linear() -> None:
    structure = state_space()
    section = structure.section(structure.start) | {"allow_unstable": True}
    trial = fs.trial("acc_benchmark", {"controllers": {"one": section}, "active": "one"})
    assert fs.fly(fs.trial(trial, {"duration": 0.2, "plan": None})).metrics
