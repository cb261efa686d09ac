"""A filter whose gains are known beforehand estimates what the filter itself does."""

import numpy as np

from flexslew_control.estimators.gained_filter import gain_filter
from flexslew_control.estimators.kalman import FilterSettings, KalmanFilter
from flexslew_plant.measurement import Measurement
from flexslew_plant.testbeds.csa import CsaTestbed
from flexslew_plant.testbeds.oscillators.floating_oscillator import FloatingOscillatorTestbed

PERIOD = 0.01
NOTHING = np.zeros(0)


def test_gains_known_beforehand_give_the_estimates_of_the_filter() -> None:
    model = FloatingOscillatorTestbed(damping_ratio=0.02).model()
    settings = FilterSettings(prediction="linear", effort_noise=0.1, initial_disturbance=0.5)
    estimator, rng = KalmanFilter(model, np.zeros(2), settings, PERIOD), np.random.default_rng(5)
    ticks = 300
    found = gain_filter(estimator, ticks)
    assert found is not None
    equations = CsaTestbed(modes=1).model()
    assert (
        gain_filter(KalmanFilter(equations, np.zeros(3), FilterSettings(), PERIOD), ticks) is None
    )
    x, effort = np.zeros(len(found.state)), np.zeros(1)
    for tick in range(ticks):
        y = 0.1 * rng.standard_normal(2)
        seen = Measurement(tick, 0, tick * PERIOD, "", y[:1], y[1:], NOTHING, NOTHING, effort)
        if tick == 0:
            estimator.reset(seen)
            x = found.start @ y
        else:
            x = found.origin + found.state @ (x - found.origin) + found.effort @ effort
            innovation = y - found.output @ x
            x = x + found.gains[tick] @ innovation
        estimate = estimator.update(seen)
        if tick > 0:
            assert np.allclose(estimate.innovation, innovation, rtol=1e-9, atol=1e-12)
        expected = np.concatenate((estimate.position, estimate.velocity, estimate.disturbance))
        assert np.allclose(x, expected, rtol=1e-9, atol=1e-12)
        effort = rng.standard_normal(1)
