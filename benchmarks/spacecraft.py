"""How fast SCOLE-S is integrated, beside NumPy with the same equations, in the same run."""

import os
import subprocess
import sys
from collections.abc import Callable
from importlib import resources
from pathlib import Path
from tempfile import TemporaryDirectory
from time import perf_counter

import numpy as np
from scipy.integrate import DOP853
from scipy.linalg import cho_factor, cho_solve

from flexslew_lab.reproduce.scole_flights import example_trial
from flexslew_lab.run.run_trial import run_trial
from flexslew_plant.arrays import Matrix, Vector
from flexslew_plant.testbeds import Model, read_testbed
from flexslew_plant.testbeds.spacecraft.assembly.craft import Spacecraft
from flexslew_plant.testbeds.spacecraft.testbed import SpacecraftTestbed
from flexslew_plant.yaml_data import load_yaml

_ROUNDS = 9
_TIMES = 400
_PERIOD = 0.004  # [s]
_MODES = (4, 8, 16, 32, 48)


def figures() -> dict[str, float]:
    """Return the best of rounds in which ours and the floor take turns.

    spacecraft_step_us: one 4 ms step of SCOLE-S, 8 modes, free, called from Python [us].
    spacecraft_numpy_step_us: the same equations and method in NumPy [us].
    spacecraft_ratio: how many times longer that takes [-].
    spacecraft_step_<n>_modes_us: the step with another number of modes [us].
    spacecraft_trial_s: the 12 s trial scole_s_a in process, compiled, without a report [s].
    spacecraft_compile_s, spacecraft_compile_other_size_s: until the first step of SCOLE-S in a new
        process with nothing compiled, then of one with another number of modes [s].
    spacecraft_load_s: the same as the first with everything compiled [s].
    """
    testbed = _scole(8)
    model, x = testbed.model(), _state(testbed.model())
    effort = np.full(model.efforts, 0.5)
    floor = _NumpyCraft(testbed.craft)
    cases: dict[str, tuple[Callable[[], object], int]] = {
        "spacecraft_step_us": (lambda: model.advance(x, effort, _PERIOD), _TIMES),
        "spacecraft_numpy_step_us": (lambda: floor.step(x, effort, _PERIOD), 4),
    }
    found = _best(cases)
    found["spacecraft_ratio"] = found["spacecraft_numpy_step_us"] / found["spacecraft_step_us"]
    for modes in _MODES:
        other = _scole(modes).model()
        at = _state(other)
        name = f"spacecraft_step_{modes}_modes_us"
        found |= _best({name: (_stepped(other, at, effort), _TIMES)})
    return found | _whole_trial() | _first_steps()


def _whole_trial() -> dict[str, float]:
    trial, seconds = example_trial("scole_s_a"), []
    for _ in range(3):
        with TemporaryDirectory() as folder:
            began = perf_counter()
            run_trial(trial, "scole_s_a", Path(folder) / "run", in_process=True, report=False)
            seconds.append(perf_counter() - began)
    return {"spacecraft_trial_s": min(seconds)}


def _say_first_steps() -> None:
    """Print how long the first step takes, and that of another size [s]."""
    for modes in (8, 5):
        model = _scole(modes).model()
        began = perf_counter()
        model.advance(_state(model), np.full(model.efforts, 0.5), _PERIOD)
        print(perf_counter() - began)


def _first_steps() -> dict[str, float]:
    with TemporaryDirectory() as folder:
        environment = {**os.environ, "NUMBA_CACHE_DIR": folder}
        command = [sys.executable, __file__, "first"]
        rows = [
            [float(line) for line in subprocess.check_output(command, env=environment).split()]
            for _ in range(2)
        ]
    return {
        "spacecraft_compile_s": rows[0][0],
        "spacecraft_compile_other_size_s": rows[0][1],
        "spacecraft_load_s": rows[1][0],
    }


def _stepped(model: Model, x: Vector, effort: Vector) -> Callable[[], object]:
    return lambda: model.advance(x, effort, _PERIOD)


def _best(cases: dict[str, tuple[Callable[[], object], int]]) -> dict[str, float]:
    seconds: dict[str, list[float]] = {name: [] for name in cases}
    for run in range(_ROUNDS + 1):
        for name, (case, times) in cases.items():
            began = perf_counter()
            for _ in range(times):
                case()
            if run:  # the first one compiles
                seconds[name].append((perf_counter() - began) / times)
    return {name: 1e6 * min(times) for name, times in seconds.items()}


def _scole(modes: int) -> SpacecraftTestbed:
    text = (resources.files("flexslew_lab") / "trials" / "scole_s_a.yaml").read_text()
    values = load_yaml(text, "scole_s_a")["testbed"]
    values["appendages"]["mast"]["shape"]["modes"] = modes
    testbed = read_testbed(values, "scole_s_a")
    assert isinstance(testbed, SpacecraftTestbed)
    return testbed


def _state(model: Model) -> Vector:
    rng = np.random.default_rng(0)
    x = 1e-4 * rng.standard_normal(model.positions + model.coordinates)
    x[3:7] = [0.0, 0.0, 0.0, 1.0]
    return x


class _NumpyCraft:
    """One fixed appendage on a free platform, written with NumPy (Kane's form)."""

    def __init__(self, craft: Spacecraft) -> None:
        mast = craft.appendages[0]
        self.mass, self.first, self.inertia = craft.rigid()
        i = mast.integrals.seen_from(mast.place, mast.axes)
        self.p, self.h, self.g = i.translation, i.rotation, i.gyroscopic
        self.j1 = _inertias(i.second_1)
        self.j2 = _inertias(i.second_2)
        self.modal, self.stiffness, self.damping = mast.mass, mast.stiffness, mast.damping
        self.n = mast.modes
        turn = np.zeros((self.n, 9))
        for k, drive in enumerate(craft.drives):
            if drive.owner == 0 and drive.point is not None:
                turn[:, k] = drive.point.turn.T @ drive.direction
        self.input = np.vstack((np.eye(6, 9), turn))
        self.input[3:6, 6:9] = np.eye(3)
        self.a, self.b = DOP853.A[:12, :12], DOP853.B[:12]

    def rate(self, x: Vector, effort: Vector) -> Vector:
        n = self.n
        q, v = x[7 : 7 + n], x[7 + n :]
        velocity, spin, rates = v[:3], v[3:6], v[6:]
        s, ds = self.first + self.p @ q, self.p @ rates
        d = self.j1 + np.einsum("i,ijab->jab", q, self.j2)
        inertia = self.inertia + 0.5 * np.einsum("j,jab->ab", q, self.j1 + d)
        c = self.h + np.einsum("i,ija->aj", q, self.g)
        skew = np.cross(s, np.eye(3)).T
        linear = self.mass * velocity + np.cross(spin, s) + ds
        angular = np.cross(s, velocity) + inertia @ spin + c @ rates
        force = np.cross(spin, ds) + np.cross(spin, linear)
        torque = np.cross(ds, velocity) + np.einsum("j,jab->ab", rates, d) @ spin
        torque += np.cross(spin, angular) + np.cross(velocity, linear)
        elastic = 2.0 * np.einsum("i,ija->ja", rates, self.g) @ spin
        elastic += self.stiffness * q + self.damping @ rates
        elastic -= self.p.T @ np.cross(velocity, spin) + 0.5 * np.einsum(
            "a,jab,b->j", spin, d, spin
        )
        top = np.hstack((self.mass * np.eye(3), -skew, self.p))
        middle = np.hstack((skew, inertia, c))
        mass: Matrix = np.vstack((top, middle, np.hstack((self.p.T, c.T, np.diag(self.modal)))))
        bias = np.concatenate((force, torque, elastic))
        a = cho_solve(cho_factor(mass), self.input @ effort - bias)
        vector, w = x[3:6], x[6]
        place = velocity + 2.0 * np.cross(vector, np.cross(vector, velocity) + w * velocity)
        turn = 0.5 * np.append(w * spin + np.cross(vector, spin), -vector @ spin)
        return np.concatenate((place, turn, rates, a))

    def step(self, x: Vector, effort: Vector, h: float) -> Vector:
        slopes = np.zeros((12, x.size))
        for i in range(12):
            slopes[i] = self.rate(x + h * (self.a[i, :i] @ slopes[:i]), effort)
        after: Vector = x + h * (self.b @ slopes)
        return after


def _inertias(second: Matrix) -> Matrix:
    trace = np.trace(second, axis1=-2, axis2=-1)
    inertias: Matrix = trace[..., None, None] * np.eye(3) - second
    return inertias


if __name__ == "__main__" and sys.argv[1:] == ["first"]:
    _say_first_steps()
elif __name__ == "__main__":
    for name, value in figures().items():
        print(f"{name:32s} {value:10.2f}")
