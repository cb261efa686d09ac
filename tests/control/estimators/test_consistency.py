"""Every filter is as good as it says: NEES and NIS of 50 seeds, at rest and in a fast slew.

The truth is the filter's own model under the noises that its settings state.
"""

from collections.abc import Callable, Iterator
from functools import partial
from typing import Any, TypeAlias

import numpy as np
import pytest
from scipy.stats import chi2
from tests.representatives import representatives

from flexslew_control.controllers import CONTROLLERS
from flexslew_control.estimators.kalman import FilterSettings, KalmanFilter
from flexslew_control.law import PlantDescription
from flexslew_plant.arrays import Matrix, Vector
from flexslew_plant.errors import BadInput
from flexslew_plant.measurement import Measurement
from flexslew_plant.testbeds import Model
from flexslew_plant.testbeds.csa import CsaTestbed
from flexslew_plant.testbeds.oscillators.floating_oscillator import FloatingOscillatorTestbed

PERIOD, SEEDS, TICKS = 0.01, 50, 60
NOTHING = np.zeros(0)
PLANT = PlantDescription(CsaTestbed(modes=1), PERIOD, np.array([150.0, 150.0]))
OSCILLATOR = FloatingOscillatorTestbed().model()
Make: TypeAlias = Callable[[], KalmanFilter]


def by_default(name: str) -> Any:
    """Return the estimator of a law with its default settings."""
    kind = CONTROLLERS[name]
    return kind.build(kind.settings(), PLANT)[0]


def filters() -> Iterator[tuple[str, Make]]:
    """Yield name and maker of every filter that a law of the table has by default."""
    for name in CONTROLLERS:
        if isinstance(by_default(name), KalmanFilter):
            yield name, partial(by_default, name)
    linear = FilterSettings(prediction="linear", effort_noise=1e-6, modal_noise=1e-6)
    yield "linear", lambda: KalmanFilter(OSCILLATOR, np.zeros(2), linear, PERIOD)


FILTERS = dict(filters())
REST, SLEW = (0.0, 0.0), (0.3, -0.2)  # rates of the joints [rad/s]


class Truth:
    """The testbed under the noises of a filter."""

    def __init__(
        self, estimator: KalmanFilter, rates: tuple[float, ...], rng: np.random.Generator
    ) -> None:
        assert isinstance(estimator.model, Model)
        self.model, self.settings, self.rng = estimator.model, estimator.settings, rng
        s, n, m = estimator.settings, estimator.model.coordinates, estimator.model.joints
        density = np.zeros((n, n))  # of the accelerations
        self.walk, self.d = 0.0, np.zeros(m)
        if estimator.noise is not None:
            density = estimator.noise[n:, n:]
        else:
            self.walk = 10.0 if s.disturbance_walk is None else s.disturbance_walk
            self.d = s.initial_disturbance * rng.standard_normal(m)
            forces = np.linalg.inv(self.model.mass_matrix(estimator.rest))
            noises = [s.effort_noise or 0.0] * m + [s.modal_noise] * (n - m)
            density = forces @ np.diag(noises) @ forces
        half = np.linalg.svd(density * PERIOD)
        self.kick = half.U * np.sqrt(half.S)
        self.x = np.concatenate((estimator.rest, np.zeros(n)))
        self.x[m:n] += s.initial_deflection * rng.standard_normal(n - m)
        self.x[n : n + m] = rates[:m]
        self.x[n + m :] = s.initial_deflection * rng.standard_normal(n - m)

    def advance(self, effort: Vector) -> None:
        n, m, rng = self.model.coordinates, self.model.joints, self.rng
        step = self.walk * np.sqrt(PERIOD) * rng.standard_normal(m)
        bridge = self.walk * np.sqrt(PERIOD / 12.0) * rng.standard_normal(m)
        mean = self.d + 0.5 * step + bridge  # of the walk over the tick, exact
        kick = self.kick @ rng.standard_normal(n)
        self.x[n:] += 0.5 * kick  # half before and half after: as much on the way as white noise
        self.x = self.model.advance(self.x, effort + mean, PERIOD)
        self.x[n:] += 0.5 * kick
        self.d = self.d + step

    def measured(self, tick: int, effort: Vector) -> Measurement:
        n, m, s = self.model.coordinates, self.model.joints, self.settings
        q = self.x[:m] + s.angle_sigma * self.rng.standard_normal(m)
        v = self.x[n : n + m] + s.rate_sigma * self.rng.standard_normal(m)
        return Measurement(tick, 0, tick * PERIOD, "", q, v, NOTHING, NOTHING, effort)


def flown(make: Make, rates: tuple[float, ...], seed: int) -> tuple[Matrix, int]:
    """Return NEES and NIS of each tick, (ticks, 2), and how many states there are."""
    estimator, rng = make(), np.random.default_rng(seed)
    truth = Truth(estimator, rates, rng)
    effort, found = np.zeros(truth.model.joints), []
    for tick in range(TICKS):
        now = truth.measured(tick, effort)
        if tick == 0:
            estimator.reset(now)
        estimate = estimator.update(now)
        error = truth.x - np.concatenate((estimate.position, estimate.velocity))
        if estimate.disturbance.size:
            error = np.concatenate((error, truth.d - estimate.disturbance))
        found.append((error @ np.linalg.solve(estimate.covariance, error), estimate.nis))
        effort = 20.0 * np.sin(3.0 * tick * PERIOD) * np.ones(truth.model.joints)
        truth.advance(effort)
    return np.array(found), error.size


def band(share: float, degrees: int, count: int) -> tuple[float, float]:
    """Return where the mean of `count` squares with so many degrees in all lies that often."""
    outside = 0.5 * (1.0 - share)
    return chi2.ppf(outside, degrees) / count, chi2.ppf(1.0 - outside, degrees) / count


@pytest.mark.parametrize(
    "rates", representatives([REST, SLEW], SLEW, single=True), ids=["rest", "slew"]
)
@pytest.mark.parametrize("name", FILTERS)
def test_errors_and_innovations_are_as_large_as_the_covariance_says(
    name: str, rates: tuple[float, ...]
) -> None:
    runs = [flown(FILTERS[name], rates, seed) for seed in range(SEEDS)]
    states, outputs = runs[0][1], 2 * FILTERS[name]().model.joints
    both = np.array([run for run, _ in runs])
    nees, nis = both[:, :, 0], both[:, :, 1]
    for found, size in ((nees, states), (nis[:, 1:], outputs)):  # at a reset nothing is predicted
        low, high = band(0.95, SEEDS * size, SEEDS)
        average = found.mean(axis=0)  # over the seeds, tick by tick
        assert low < average.mean() < high
        # one expects 0.95 of the ticks; those of a run hang together
        assert np.mean((low < average) & (average < high)) > 0.8
    free = outputs * nis[:, 1:].size  # innovations are independent of each other
    low, high = band(0.999, free, nis[:, 1:].size)
    assert low < nis[:, 1:].mean() < high


def test_the_table_has_filters_to_look_at() -> None:
    assert {"output_feedback", "lqr", "proportional_integral", "linear"} <= set(FILTERS)


def test_a_linear_prediction_of_what_is_not_linear_is_refused() -> None:
    settings = FilterSettings(prediction="linear")
    with pytest.raises(BadInput, match=r"filter\.prediction: linear .* take nonlinear"):
        KalmanFilter(CsaTestbed(modes=1).model(), np.array([0.0, 0.5, 0.0]), settings, PERIOD)
