"""A fixed-order controller of a spacecraft: torques about body axes, allocated to its wheels."""

from typing import Any

import numpy as np
import pytest
from scipy.linalg import block_diag

import flexslew as fs
from flexslew_lab.analysis.analysis import disk_margin
from flexslew_lab.tuning.closed_loop import PerformancePlant
from flexslew_lab.tuning.kept_keys import kept_section
from flexslew_lab.tuning.tuned import bench_loops, trial_with
from flexslew_lab.tuning.tuning_file import read_tuning, tuning_path
from flexslew_plant.errors import BadInput
from flexslew_plant.yaml_data import load_yaml

pytest.importorskip("ctrlsys")

AXES = "xyz"
GAINS = {"kp": (40.0, 37.0, 30.0), "ki": (1.0, 0.9, 0.75), "kd": (210.0, 195.0, 160.0)}


def pointing(structure: dict[str, Any]) -> dict[str, Any]:
    """Return the shipped tuning of the observatory with another structure, on one model."""
    keys: dict[str, Any] = load_yaml(tuning_path("observatory_pointing").read_text(), "here")
    return {**keys, "structure": structure, "models": [{}]}


def attitude_pid() -> dict[str, Any]:
    """Return the PID of the observatory as systems in parallel."""
    errors = {
        f"torque.{axis}": {"input": f"error.{axis}", "kp": kp, "ki": ki}
        for axis, kp, ki in zip(AXES, GAINS["kp"], GAINS["ki"], strict=True)
    }
    rates = {
        f"torque.{axis}": {"input": f"error_rate.{axis}", "kp": kd}
        for axis, kd in zip(AXES, GAINS["kd"], strict=True)
    }
    blocks = [{"kind": "pid", "loops": loops} for loops in (errors, rates)]
    return {"kind": "parallel", "systems": blocks}


def test_systems_in_parallel_have_the_goals_of_the_attitude_law_that_they_are() -> None:
    """All but the last, on poles: the gains structure counts those of the null motion, too."""
    ours, theirs = read_tuning(pointing(attitude_pid())), read_tuning(pointing({"kind": "gains"}))
    numbers = [
        [number.value for number in problem.numbers(problem.structure.start)[0]]
        for problem in (ours, theirs)
    ]
    np.testing.assert_allclose(numbers[0][:-1], numbers[1][:-1], rtol=3e-3)
    trial = trial_with(ours, ours.structure.start)
    section = trial.controllers["pointing"]
    assert section["law"] == "linear"
    assert len(section["system"]["a"]) == 3
    assert section["allocation"]["kind"] == "wheels"
    assert section["handover_time"] == 10.0
    (loop,) = bench_loops(ours, trial).values()
    assert 1.0 / disk_margin(loop) == pytest.approx(numbers[0][0], rel=3e-3)


@pytest.mark.parametrize(
    ("system", "words"),
    [
        ({"outputs": {"torque.w": 1.0}}, "one of torque.x, torque.y, torque.z"),
        ({"inputs": {"position.x": 1.0}}, "one of error.x, error_rate.x, applied.x"),
    ],
)
def test_an_unknown_signal_of_an_axis_is_refused(system: dict[str, Any], words: str) -> None:
    given = {"kind": "state_space", "order": 6, "inputs": {"error.x": 1e-3, "error_rate.x": 1e-3},
             "outputs": {"torque.x": 0.1}, **system}  # fmt: skip
    with pytest.raises(BadInput, match=words):
        read_tuning(pointing(given))


def test_a_state_space_reads_the_axes() -> None:
    blocks = [
        {"kind": "state_space", "order": 6, "inputs": {f"error.{a}": 1e-3, f"error_rate.{a}": 1e-3},
         "outputs": {f"torque.{a}": 0.1}}
        for a in AXES
    ]  # fmt: skip
    problem = read_tuning(pointing({"kind": "parallel", "systems": blocks}))
    system = problem.structure.section(problem.structure.start)["system"]
    assert np.shape(system["a"]) == (18, 18)
    assert system["outputs"] == ["torque.x", "torque.y", "torque.z"]
    assert np.shape(np.real(problem.structure.matrix(problem.structure.start))) == (21, 24)


def test_of_another_law_the_keys_of_its_axes_are_kept() -> None:
    axes = {"gyroscopic": True, "allocation": {"kind": "wheels"}, "handover_time": 3.0}
    assert kept_section("a", {"law": "collocated_pid", "kp": [1.0], **axes}) == axes
    assert kept_section("a", {"law": "lqr", "handover_time": 3.0}) == {}
    assert kept_section("a", {"law": "linear", "system": {}, **axes}) == axes


def test_a_plant_with_many_rigid_motions_is_reduced_without_a_change_of_its_response() -> None:
    """Three double integrators, three that nothing moves, and a mode, in other coordinates."""
    rng, h = np.random.default_rng(4), 0.1
    rigid = np.kron(np.eye(6), [[1.0, h], [0.0, 1.0]])
    mode = 0.99 * np.array([[np.cos(0.3), np.sin(0.3)], [-np.sin(0.3), np.cos(0.3)]])
    push = np.kron(np.eye(6, 3), [[0.5 * h**2], [h]])
    a, b = block_diag(rigid, mode), np.vstack((push, 0.01 * rng.standard_normal((2, 3))))
    c = np.hstack((np.kron(np.eye(3, 6), [[1.0, 0.0]]), 0.01 * rng.standard_normal((3, 2))))
    turn = np.linalg.qr(rng.standard_normal((14, 14)))[0]
    plant = PerformancePlant(turn @ a @ turn.T, turn @ b, c @ turn.T, np.zeros((3, 3)), 3, 3, h)
    found = plant.reduced()
    assert len(found.a) == 8
    for w in (0.01, 0.3, 10.0):
        z = np.exp(1j * w * h)
        one, other = (p.c @ np.linalg.solve(z * np.eye(len(p.a)) - p.a, p.b)
                      for p in (plant, found))  # fmt: skip
        np.testing.assert_allclose(other, one, atol=1e-6 * abs(one).max())


@pytest.mark.slow
def test_the_shipped_tuning_of_order_5_has_more_margin_than_the_tuned_gains() -> None:
    """The number of docs/requirements_to_controller.md."""
    tuned = fs.tune("observatory_order_5")
    assert tuned.met
    assert len(tuned.section["system"]["a"]) == 3 * 5
    assert min(tuned.margins.values()) == pytest.approx(1.588, abs=0.015)
    assert fs.worst_case(tuned.trial, {"gain": 0.3}, "pointing", at=0.0).guaranteed
