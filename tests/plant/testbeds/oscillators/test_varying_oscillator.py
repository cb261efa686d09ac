"""The oscillator whose stiffness varies: time reaches the equations of motion."""

from typing import Any

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from flexslew_plant.bench.bench import Bench, BenchSettings
from flexslew_plant.errors import BadInput
from flexslew_plant.testbeds.oscillators.varying_oscillator import VaryingOscillatorTestbed

TESTBED = VaryingOscillatorTestbed()


def exact(times: Any, x: Any, start: float = 0.0) -> Any:
    def rate(t: Any, y: Any) -> tuple[Any, Any]:
        return y[1], 100.0 - (100.0 + 10.0 * np.sin(2.0 * np.pi * t)) * y[0]

    span = (start, start + times[-1])
    return solve_ivp(rate, span, x, "DOP853", start + times, rtol=1e-12, atol=1e-13).y.T


def test_the_uncontrolled_peak_is_the_published_one() -> None:
    model, x, peak = TESTBED.model(), np.zeros(2), 0.0
    for k in range(3000):
        x = model.advance(x, np.zeros(1), 0.001, t=0.001 * k)
        peak = max(peak, abs(x[0]))
    assert peak == pytest.approx(2.20635, abs=5e-6)  # physics/spacecraft, Example 3


@pytest.mark.parametrize("start", [0.0, 0.3, 12.7])
@pytest.mark.parametrize("period", [0.001, 0.01, 0.05])
def test_steps_at_any_time_are_those_of_the_equation(start: float, period: float) -> None:
    model, x = TESTBED.model(), np.array([0.7, -2.0])
    times = period * np.arange(1, 21)
    for k in range(20):
        x = model.advance(x, np.zeros(1), period, t=start + k * period)
    np.testing.assert_allclose(x, exact(times, [0.7, -2.0], start)[-1], atol=2e-7)


def test_the_bench_counts_time_from_tick_zero_in_every_epoch() -> None:
    bench = Bench(BenchSettings(testbed=TESTBED, active="", duration=0.5))
    flown = []
    for _ in range(2):
        states = []
        while not bench.done:
            bench.advance()
            states.append(bench.truth().position[0])
        # the drive's brake is all that pushes: it is off at rest, and small
        assert states[0] == pytest.approx(0.005, rel=0.01)
        flown.append(states)
        bench.reset()
    assert flown[0] == flown[1]


def test_the_jacobian_follows_the_time() -> None:
    model = TESTBED.model()
    for t, stiffness in ((0.0, 100.0), (0.25, 110.0), (0.75, 90.0)):
        assert model.linearise(np.zeros(1), t).stiffness[0, 0] == pytest.approx(stiffness)
        assert model.jacobian(np.zeros(2), np.zeros(1), t)[0][1, 0] == pytest.approx(-stiffness)


def test_it_carries_no_payload() -> None:
    with pytest.raises(BadInput, match=r"payload: 1\.2 is not allowed: varying_oscillator carries"):
        TESTBED.scaled(payload=1.2)
