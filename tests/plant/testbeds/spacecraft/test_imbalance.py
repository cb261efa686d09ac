"""Wheels that are not balanced: forces by quadrature, motion by closed forms."""

from typing import Any

import numpy as np
import pytest

from flexslew_plant.arrays import Matrix
from flexslew_plant.bench.bench import Bench, BenchSettings
from flexslew_plant.errors import BadInput
from flexslew_plant.measurement import EffortCommand
from flexslew_plant.testbeds import Testbed, read_testbed

J, WHEEL, SPEED = 10.0, 0.05, 20.0  # [kg m^2, kg m^2, rad/s]


def craft(wheel: dict[str, Any], motion: str = "free", **keys: Any) -> Testbed:
    """Return a rigid craft of equal inertias with one wheel."""
    platform = {"motion": motion, "mass": 50.0, "inertia": {"xx": J, "yy": J, "zz": J}}
    own = {"axis": [0.0, 0.0, 1.0], "inertia": WHEEL, "limit": 1.0, **wheel}
    parts = {"appendages": {}, "actuators": {}, "wheels": {"wheel": own}}
    return read_testbed({"kind": "spacecraft", "platform": platform, **parts, **keys}, "here")


def coasted(testbed: Testbed, period: float, lasting: float) -> tuple[Matrix, Matrix]:
    """Return q and v at every tick while the wheel coasts, all else from rest."""
    bench = Bench(BenchSettings(testbed=testbed, period=period, duration=lasting + 1.0))
    start = np.concatenate(bench.model.split(bench._start))
    start[-1] = SPEED
    bench.place(start, np.zeros(1), np.zeros(1))
    q, v = [], []
    for _ in range(round(lasting / period)):
        asked = bench.question
        assert bench.offer(EffortCommand(asked.tick, asked.epoch, asked.controller, np.zeros(1)))
        bench.advance()
        truth = bench.truth()
        q.append(truth.position)
        v.append(truth.velocity)
    return np.array(q), np.array(v)


@pytest.mark.slow
def test_dynamic_imbalance_turns_a_craft_as_the_closed_form_says_over_1000_s() -> None:
    """J w' - i H w = U W^2 exp(i W t) of w = w_x + i w_y; of second order are 2e-9 rad of these."""
    size, period, lasting = 1e-5, 0.05, 1000.0
    q, _ = coasted(craft({"dynamic_imbalance": size}), period, lasting)
    spin = WHEEL * SPEED / J
    rate = size * SPEED**2 / (1j * J * (SPEED - spin))
    t = period * np.arange(1, len(q) + 1)
    turn = rate * (np.expm1(1j * SPEED * t) / (1j * SPEED) - np.expm1(1j * spin * t) / (1j * spin))
    found = 2.0 * (q[:, 3] + 1j * q[:, 4])
    assert abs(turn).max() > 3e-4
    assert abs(found - turn).max() < 1e-6


def test_rates_tremble_by_the_imbalance_times_the_speed_over_the_inertia() -> None:
    """To (W h)^2 / 24 = 7e-5 of the wheel's own period, which ticks resolve."""
    wheel = {"dynamic_imbalance": 1e-5, "static_imbalance": 2e-5, "place": [0.0, 0.0, 0.5]}
    _, v = coasted(craft(wheel), 0.002, 2.0)
    t, spin = 0.002 * np.arange(1, len(v) + 1), WHEEL * SPEED / J
    # F = S W^2 e^(i W t) at z: a torque of z F ahead by a quarter of a turn
    torque = (1e-5 + 1j * 0.5 * 2e-5) * SPEED**2
    rate = torque / (1j * J * (SPEED - spin)) * (np.exp(1j * SPEED * t) - np.exp(1j * spin * t))
    np.testing.assert_allclose(v[:, 3] + 1j * v[:, 4], rate, atol=2e-4 * abs(rate).max())
    push = 2e-5 * SPEED / 50.0 * np.expm1(1j * SPEED * t) / 1j
    np.testing.assert_allclose(v[:, 0] + 1j * v[:, 1], push, atol=1e-3 * abs(push).max())


@pytest.mark.parametrize("key", ["static_imbalance", "dynamic_imbalance"])
def test_only_a_free_platform_trembles(key: str) -> None:
    with pytest.raises(BadInput, match=r"wheels\.wheel.*motion: free"):
        craft({key: 1e-5}, motion="held")
