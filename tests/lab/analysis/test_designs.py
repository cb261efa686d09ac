"""Designs that ship: docs/examples/designs makes the laws of the trials, and they hold."""

import runpy
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.linalg import solve_discrete_are, solve_discrete_lyapunov

from flexslew_control.controllers.linear.linear_law import LinearSettings, to_discrete
from flexslew_lab.notebook import fly, linear_model, trial
from flexslew_plant.arrays import Matrix, Vector
from flexslew_plant.system_file import system_from_file

FOLDER = Path(__file__).parents[3] / "docs" / "examples" / "designs"
DESIGNS = {
    "lqg": ("designs", "lqg.py"),
    "mixed_sensitivity": ("designs", "mixed_sensitivity.py"),
    "positive_position_feedback": ("designs", "positive_position_feedback.py"),
    "pd_notch": ("designs", "pd_notch.py"),
    "robust": ("acc_benchmark", "acc_benchmark.py robust"),
    "plain": ("acc_benchmark", "acc_benchmark.py plain"),
}
LQG = trial("designs").controllers["lqg"]


def response(system: dict[str, Any], w: float) -> Matrix:
    """Return the frequency response of a law, shape (outputs, inputs)."""
    a, b, c = (np.array(system[key]) for key in "abc")
    z = np.exp(1j * w * system["period"]) if system.get("period") else 1j * w
    d = system.get("d") or np.zeros((len(c), b.shape[1]))
    return np.asarray(c @ np.linalg.solve(z * np.eye(len(a)) - a, b) + np.array(d))


@pytest.mark.parametrize("name", DESIGNS)
def test_a_trial_flies_what_the_script_makes(
    name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    shipped, (script, *kind) = DESIGNS[name][0], DESIGNS[name][1].split()
    file = str(tmp_path / "law.npz")
    monkeypatch.setattr(sys, "argv", [script, *kind, file])
    runpy.run_path(str(FOLDER / script))
    made = system_from_file(file, "test")["system"]
    flown = trial(shipped).controllers[name]["system"]
    assert made["inputs"] == flown["inputs"]
    for w in (0.01, 0.1, 0.5, 2.0, 10.0):
        one = response(made, w)
        # the trials hold ten digits; one part in 1e6 is what rounding makes of them near a pole
        np.testing.assert_allclose(response(flown, w), one, atol=1e-6 * abs(one).max())


def test_the_filter_of_the_lqg_is_kalmans_that_predicts() -> None:
    """Its gain is A P C^T (C P C^T + R)^-1, P by SciPy's Riccati equation, not A times that."""
    plant, system = linear_model(trial("m1"), sampled=True, hub_pitch=0.5), LQG["system"]
    rows = [plant.output_labels.index(f"position:{of}") for of in ("base_yaw", "hub_pitch")]
    a, b, c, noise = plant.A, plant.B, plant.C[rows], 1e-6 * np.eye(2)
    p = solve_discrete_are(a.T, c.T, b @ b.T, noise)
    gain = a @ p @ c.T @ np.linalg.inv(c @ p @ c.T + noise)
    np.testing.assert_allclose(-np.array(system["b"]), gain, rtol=0, atol=1e-6 * abs(gain).max())


def poles(shipped: str, name: str, keys: dict[str, Any], **joints: float) -> Vector:
    """Return the poles in z of the sampled loop of plant and shipped law, where joints rest."""
    what = trial(shipped, {"plan": None, **keys})
    plant, system = linear_model(what, sampled=True, **joints), what.controllers[name]["system"]
    seen = []
    for signal in system["inputs"]:
        kind, _, of = signal.partition(".")
        measured = {"error": "position", "error_rate": "rate"}.get(kind, kind)
        row = plant.C[plant.output_labels.index(f"{measured}:{of}")]
        seen.append(-row if kind in ("error", "error_rate") else row)
    a, b, c = (np.array(system[key]) for key in "abc")
    d = np.array(system.get("d") or np.zeros((len(c), b.shape[1])))
    if not system.get("period"):
        a, b, c, d = to_discrete(LinearSettings(), a, b, c, d, what.period)
    y = np.array(seen)
    loop = np.block([[plant.A + plant.B @ d @ y, plant.B @ c], [b @ y, a]])
    return np.asarray(np.linalg.eigvals(loop))


def growth(name: str, stiffness: float) -> float:
    """Return the spectral radius of one tick of the benchmark's loop, less one."""
    z = poles("acc_benchmark", name, {"testbed.parameters.stiffness": stiffness})
    return float(abs(z).max() - 1.0)


def test_the_robust_law_is_stable_for_every_stiffness_of_the_benchmark() -> None:
    assert max(growth("robust", k) for k in np.linspace(0.5, 2.0, 16)) < 0.0


def test_the_plain_law_loses_its_soft_end() -> None:
    assert max(growth("plain", k) for k in (0.62, 1.0, 1.25, 2.0)) < 0.0
    assert min(growth("plain", k) for k in (0.5, 0.54, 0.58)) > 0.0


@pytest.mark.slow
def test_the_benchmark_settles_within_15_s_with_little_effort() -> None:
    flight = fly(trial("acc_benchmark"))
    x2 = flight["position.mass"] + flight["tip.spring"]
    late = flight.time >= 15.0
    assert abs(x2[~late]).max() > 1.0  # the impulse threw it
    assert abs(x2[late]).max() < 0.1
    assert abs(flight["effort.mass"]).max() < 1.0


@pytest.mark.slow
def test_the_benchmark_answers_noise_with_what_its_linear_loop_does() -> None:
    """The variances of a loop z+ = A z + B n with white n: P = A P A' + B B' s^2."""
    what = trial("acc_benchmark", {"testbed.initial": {}, "duration": 600.0})
    flight, s = fly(what), what.sensors.tip_deflection.noise
    plant, system = linear_model(what, sampled=True), what.controllers["robust"]["system"]
    a, b, c = (np.array(system[key]) for key in "abc")
    a, b, c, d = to_discrete(LinearSettings(), a, b, c, np.zeros((1, 2)), what.period)
    rows = [plant.output_labels.index(n) for n in ("position:mass", "tip:spring")]
    y = plant.C[rows]
    loop = np.block([[plant.A + plant.B @ d @ y, plant.B @ c], [b @ y, a]])
    noise = np.vstack((plant.B @ d[:, 1:], b[:, 1:]))  # of the tip sensor
    p = solve_discrete_lyapunov(loop, s**2 * noise @ noise.T)
    x2 = np.append(y.sum(axis=0), np.zeros(len(a)))
    u = np.concatenate(((d @ y)[0], c[0]))
    rms_u = np.sqrt(u @ p @ u + float(d[0, 1]) ** 2 * s**2)
    found = flight["position.mass"] + flight["tip.spring"]
    # 600 s of a loop that forgets within 2 s are 300 samples: 4 % of a standard deviation
    assert found.std() == pytest.approx(np.sqrt(x2 @ p @ x2), rel=0.1)
    assert flight["effort.mass"].std() == pytest.approx(rms_u, rel=0.1)
    assert rms_u < 2e-4


@pytest.mark.parametrize("name", [n for n, (of, _) in DESIGNS.items() if of == "designs"])
def test_a_design_holds_every_mode_of_the_bench(name: str) -> None:
    largest = abs(poles("designs", name, {}, hub_pitch=0.5)).max()
    assert largest < 1.0 + 1e-9  # rounding, of modes that are hardly damped


def test_positive_position_feedback_damps_what_the_notch_leaves() -> None:
    def damping(name: str) -> float:
        s = np.log(poles("designs", name, {}, hub_pitch=0.5).astype(complex)) / 0.01
        second = s[(s.imag > 2.1) & (s.imag < 2.2)]
        return float((-second.real / abs(second)).max())

    assert damping("positive_position_feedback") > 0.01
    assert 0.0 < damping("pd_notch") < 0.001
