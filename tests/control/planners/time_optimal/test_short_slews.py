"""Slews that are short beside the periods of the modes, where the end conditions are nearly alike.

Each is held against a linear program of its own: the goal is the integral of tau u, and 1, sin, cos
(robust: tau sin and tau cos, too) of every mode are orthogonal to u.
"""

from typing import Any

import numpy as np
import pytest
from scipy.optimize import linprog
from tests.plants import plant
from tests.representatives import seeds

from flexslew_control.planners import make_plan
from flexslew_control.planners.time_optimal.time_optimal import TimeOptimal
from flexslew_plant.arrays import Vector
from flexslew_plant.testbeds.identified import FreeMode, IdentifiedTestbed

CELLS = 800


def farthest(frequencies: Vector, robust: bool, duration: float) -> float:
    """Return the largest integral of tau u for |u| <= 1 [s^2], u constant on each cell."""
    step = duration / CELLS
    tau = step * (np.arange(CELLS) + 0.5)
    waves = np.exp(1j * np.outer(frequencies, tau))
    rows = [np.ones(CELLS), *waves.real, *waves.imag]
    if robust:
        rows += [*(tau / duration * waves.real), *(tau / duration * waves.imag)]
    unlike = np.linalg.svd(np.array(rows), full_matrices=False)[2] * np.sqrt(CELLS)
    none = np.zeros(len(unlike))
    found = linprog(-tau / duration, A_eq=unlike, b_eq=none, bounds=(-1.0, 1.0))
    return float(step * tau @ np.asarray(found.x))


@pytest.mark.parametrize("seed", seeds(12, default=3))  # two to four modes
def test_a_short_slew_is_found_and_none_is_shorter(seed: int) -> None:
    rng = np.random.default_rng(seed)
    robust, count = seed % 4 > 0, 2 + seed % 3
    frequencies = np.cumsum(rng.uniform(0.3, 1.5, count))
    modes = tuple(
        FreeMode(frequency=float(w), joints=(float(rng.uniform(0.02, 0.15)),), tips=(1.0,))
        for w in frequencies
    )
    testbed: Any = IdentifiedTestbed(free_modes=modes, modes=count)
    asked = TimeOptimal(
        robust=robust, structure="optimal", goal={"hub": float(10.0 ** rng.uniform(-3.0, -0.5))}
    )
    told = make_plan(asked, plant(0.01, (10.0,), testbed)).summary
    duration = told["duration"]
    edges = np.array([0.0, *told["switch_times"], duration])
    assert told["optimal"]
    signs = np.sign(told["arc_efforts"])[:, 0]
    for w in frequencies:
        for near in (w, w * 1.00001, w * 0.99999) if robust else (w,):  # a sensitive one: 1e-5
            phases = np.exp(1j * near * (duration - edges))
            assert abs(signs @ (phases[:-1] - phases[1:])) < 1e-7
    needed = (0.5 * told["rigid_duration"]) ** 2
    # the cells cost 1e-4 of the duration at the most
    assert farthest(frequencies, robust, 0.9999 * duration) < needed
    assert farthest(frequencies, robust, 1.001 * duration) > needed
