"""Loops that leave a rigid motion alone are marginal; hold and delay are as exact ones."""

import itertools
import warnings
from typing import Any

import numpy as np
import pytest
from scipy.linalg import expm

from flexslew_lab.analysis.analysis import Analysis, loop_analysis
from flexslew_lab.analysis.page import analysis_page
from flexslew_lab.trial.trial import parse_trial
from flexslew_plant.yaml_data import yaml_text

AXES = ("roll", "pitch", "yaw")


def analysis(values: dict[str, Any]) -> Analysis:
    return loop_analysis(parse_trial(yaml_text(values), "here"), "here")


def craft(kp: list[float], kd: list[float]) -> Analysis:
    """Return the analysis of a rigid craft with three torque drives."""
    drives = {
        name: {"kind": "torque", "direction": row, "limit": 10.0}
        for name, row in zip(AXES, np.eye(3).tolist(), strict=True)
    }
    inertia = {"xx": 35.0, "yy": 30.0, "zz": 32.0}
    body = {"kind": "spacecraft", "platform": {"mass": 200.0, "inertia": inertia}}
    return analysis({
        "duration": 30.0,
        "period": 0.05,
        "testbed": {**body, "actuators": drives},
        "controllers": {"pd_feedforward": {"kp": kp, "kd": kd}},
    })  # fmt: skip


def require_marginal(found: Analysis, free: list[str], slow: list[str]) -> None:
    """Check which joints have poles at z = 1: two where kp = kd = 0, one where kp = 0."""
    left = [*free, *slow]
    assert found.stable == (not left)
    assert sorted(found.uncontrolled) == sorted(left)
    ones = sum(abs(complex(*pole.z) - 1.0) < 1e-6 for pole in found.poles)
    assert ones == 2 * len(free) + len(slow)
    for name in left:
        assert name in found.statement
        assert "marginal" in found.statement


@pytest.mark.parametrize("gains", [
    ((4.0, 12.0), (0.0, 0.0), (4.0, 12.0)),
    ((4.0, 12.0), (0.0, 12.0), (4.0, 12.0)),
    ((0.0, 0.0), (0.0, 12.0), (4.0, 12.0)),
    ((4.0, 12.0), (4.0, 12.0), (4.0, 12.0)),
])  # fmt: skip
def test_every_axis_without_control_is_named(gains: tuple[tuple[float, float], ...]) -> None:
    kp, kd = ([gain[k] for gain in gains] for k in range(2))
    found = craft(kp, kd)
    free = [name for name, gain in zip(AXES, gains, strict=True) if gain == (0.0, 0.0)]
    slow = [name for name, gain in zip(AXES, gains, strict=True) if gain == (0.0, 12.0)]
    require_marginal(found, free, slow)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        page = analysis_page(found, "zero")
    assert ("MARGINAL" in page) == (not found.stable)


@pytest.mark.matrix
@pytest.mark.parametrize("gains", list(itertools.product([(4.0, 12.0), (0.0, 12.0), (0.0, 0.0)],
                                                    repeat=3)))  # fmt: skip
def test_every_mixture_of_axes_without_control_is_named(gains: Any) -> None:
    if not any(gain[1] for gain in gains):
        return  # the law reads no sensor and closes no loop
    kp, kd = ([gain[k] for gain in gains] for k in range(2))
    free = [name for name, gain in zip(AXES, gains, strict=True) if gain == (0.0, 0.0)]
    slow = [name for name, gain in zip(AXES, gains, strict=True) if gain == (0.0, 12.0)]
    require_marginal(craft(kp, kd), free, slow)


@pytest.mark.slow
@pytest.mark.parametrize(("kp", "kd", "left"), [(0.0, 0.0, 2), (0.0, 920.0, 1), (460.0, 920.0, 0)])
def test_a_hub_without_control_is_marginal(kp: float, kd: float, left: int) -> None:
    gains = {"kp": [460.0, kp], "kd": [920.0, kd]}
    found = analysis({"duration": 30.0, "controllers": {"pd_feedforward": gains}})
    assert found.uncontrolled == ("hub_pitch",) * bool(left)
    assert sum(abs(complex(*pole.z) - 1.0) < 1e-6 for pole in found.poles) == left
    assert found.stable == (not left)


def spectral_radius(turn: float, delay: float, factor: float) -> float:
    """Return that of a tick of the oscillator below, from matrix exponentials.

    A delay of 2.5 ticks gives the mean of the commands two and three ticks before.
    """
    k, h, kp, kd = STIFFNESS, turn / np.sqrt(2.0 * STIFFNESS), 0.05, 0.3
    a = np.zeros((4, 4))
    a[:2, 2:] = np.eye(2)
    a[2:, :2] = [[-k, k], [k, -k]]
    b = np.array([[0.0], [0.0], [1.0], [0.0]])
    both = expm(np.block([[a, b], [np.zeros((1, 5))]]) * h)
    whole, part = int(np.floor(delay)), delay % 1.0
    tick = np.zeros((7, 7))  # the motion, and the commands of the last three ticks
    tick[:4, :4] = both[:4, :4]
    tick[:4, 3 + whole] += factor * (1.0 - part) * both[:4, 4]
    tick[:4, 4 + whole] += factor * part * both[:4, 4]
    tick[4, [0, 2]] = -kp, -kd
    tick[5, 4], tick[6, 5] = 1.0, 1.0
    return float(abs(np.linalg.eigvals(tick)).max())


STIFFNESS = 450.0


@pytest.mark.parametrize("turn", [1.2, 2.4, 2.9, 4.5, 7.3])
def test_stability_and_gain_margin_are_those_of_the_exact_hold(turn: float) -> None:
    joint = "mass"
    found = analysis({
        "duration": 40.0,
        "period": float(turn / np.sqrt(2.0 * STIFFNESS)),
        "testbed": {"kind": "floating_oscillator", "parameters": {"stiffness": STIFFNESS}},
        "controllers": {"pd_feedforward": {"kp": [0.05], "kd": [0.3]}},
        "allow_faults": True,
        "schedule": [{"at": 0.0, "fault": {"kind": "command_delay", "joint": joint, "ticks": 2.5}}],
    })  # fmt: skip
    assert found.stable == (spectral_radius(turn, 2.5, 1.0) < 1.0 + 1e-6)
    assert bool(found.point.warnings) == (turn >= 1.5)
    assert found.point.path.steps == (1 if turn < 2.0 else found.point.path.steps)
    if found.stable and np.isfinite(up := found.efforts[0].gain_up):
        assert spectral_radius(turn, 2.5, 1.01 * up) > 1.0
        assert spectral_radius(turn, 2.5, 0.99 * up) < 1.0 + 1e-5
