from typing import Any

import numpy as np
import pytest
from scipy.linalg import expm
from scipy.stats import chi2

from flexslew_control.estimators.kalman import (
    FilterSettings,
    KalmanFilter,
    continuous_gain,
    discrete_model,
)
from flexslew_plant.errors import BadInput
from flexslew_plant.measurement import Measurement
from flexslew_plant.testbeds.csa import CsaTestbed
from flexslew_plant.testbeds.hub_with_appendages import HubTestbed
from flexslew_plant.testbeds.oscillators.floating_oscillator import (
    FloatingOscillatorParameters,
    FloatingOscillatorTestbed,
)

PERIOD = 0.01
MODEL = CsaTestbed(modes=1).model()
REST = np.array([0.0, 0.5, 0.0])
NOTHING = np.zeros(0)


def measured(tick: Any, y: Any, effort: Any, tip: Any = NOTHING) -> Any:
    return Measurement(tick, 0, tick * PERIOD, "", y[:2], y[2:4], tip, NOTHING, effort)


def simulated_nis(seed: Any, ticks: Any = 400) -> Any:
    """NIS of each tick of a run whose noises are those the filter expects."""
    rng = np.random.default_rng(seed)
    settings = FilterSettings(initial_deflection=0.05, initial_disturbance=2.0)
    estimator = KalmanFilter(MODEL, REST, settings, PERIOD)
    sigma = np.array([1e-4, 1e-4, 1e-3, 1e-3])
    x = np.concatenate((REST, np.zeros(3)))
    x[2], x[5] = 0.05 * rng.standard_normal(2)
    d = 2.0 * rng.standard_normal(2)
    effort, nis = np.zeros(2), []
    for tick in range(ticks):
        y = x[[0, 1, 3, 4]] + sigma * rng.standard_normal(4)
        if tick == 0:
            estimator.reset(measured(tick, y, effort))
        estimate = estimator.update(measured(tick, y, effort))
        if tick > 0:
            nis.append(estimate.nis)
        effort = 5.0 * np.sin(0.5 * tick * PERIOD) * np.ones(2)
        # the walk moves at ticks; its mean over the tick acts, as in the discretised noise
        step = 10.0 * np.sqrt(PERIOD) * rng.standard_normal(2)
        x = MODEL.advance(x, effort + d + 0.5 * step, PERIOD)
        d = d + step
    return np.array(nis)


def test_normalised_innovations_are_chi_square_over_seeded_runs() -> None:
    nis = np.array([simulated_nis(seed) for seed in range(10)])
    degrees = 4 * nis.size
    low, high = np.divide(chi2.ppf([0.001, 0.999], degrees), nis.size)
    assert low < nis.mean() < high
    inside = np.mean(nis < chi2.ppf(0.95, 4))
    assert abs(inside - 0.95) < 0.02


def test_wrong_noise_leaves_the_chi_square_band() -> None:
    rng = np.random.default_rng(5)
    estimator = KalmanFilter(MODEL, REST, FilterSettings(), PERIOD)
    total = []
    for tick in range(300):
        y = np.array([0.0, 0.5, 0.0, 0.0]) + 3e-3 * rng.standard_normal(4)
        if tick == 0:
            estimator.reset(measured(tick, y, np.zeros(2)))
        total.append(estimator.update(measured(tick, y, np.zeros(2))).nis)
    assert np.mean(total[1:]) > chi2.ppf(0.999, 4 * 299) / 299


def test_the_disturbance_of_a_joint_is_found() -> None:
    estimator = KalmanFilter(MODEL, REST, FilterSettings(), PERIOD)
    x, effort = np.concatenate((REST, np.zeros(3))), np.zeros(2)
    for tick in range(6000):
        now = measured(tick, x[[0, 1, 3, 4]], effort)
        if tick == 0:
            estimator.reset(now)
        estimate = estimator.update(now)
        effort = -800.0 * (x[:2] - REST[:2]) - 2000.0 * x[3:5]
        x = MODEL.advance(x, effort + np.array([5.0, -2.0]), PERIOD)
    np.testing.assert_allclose(estimate.disturbance, [5.0, -2.0], atol=0.1)


def test_a_repeated_measurement_changes_nothing() -> None:
    estimator = KalmanFilter(MODEL, REST, FilterSettings(), PERIOD)
    estimator.reset(measured(0, np.array([0.0, 0.5, 0.0, 0.0]), np.zeros(2)))
    now = measured(1, np.array([1e-4, 0.5, 0.0, 0.0]), np.ones(2))
    first, second = estimator.update(now), estimator.update(now)
    assert first is second


def test_covariance_stays_symmetric_and_positive() -> None:
    estimator = KalmanFilter(MODEL, REST, FilterSettings(tip_sigma=5e-3), PERIOD)
    y, tip = np.array([0.0, 0.5, 0.0, 0.0]), np.zeros(2)
    estimator.reset(measured(0, y, np.zeros(2), tip))
    for tick in range(1, 2000):
        estimate = estimator.update(measured(tick, y, np.zeros(2), tip))
    assert estimate.innovation.size == 5
    np.testing.assert_array_equal(estimate.covariance, estimate.covariance.T)
    assert np.linalg.eigvalsh(estimate.covariance).min() > 0.0


def test_continuous_gain_solves_its_riccati_equation() -> None:
    linear = MODEL.linearise(REST)
    a, b = linear.state_matrix, linear.state_input_matrix
    c, r = np.eye(6)[[0, 1, 3, 4]], 1e-10 * np.eye(4)
    noise = b @ b.T + 1e-5 * np.diag([0, 0, 0, 0, 0, 1.0])
    gain, p = continuous_gain(a, c, noise, r)
    residual = a @ p + p @ a.T + noise - gain @ r @ gain.T
    assert abs(residual).max() < 1e-8 * abs(noise).max()


def test_discretised_noise_of_a_double_integrator_is_the_closed_form() -> None:
    a, b = np.array([[0.0, 1.0], [0.0, 0.0]]), np.array([[0.0], [1.0]])
    f, g, q = discrete_model(a, b, np.diag([0.0, 2.0]), 0.1)
    np.testing.assert_allclose(f, [[1.0, 0.1], [0.0, 1.0]])
    np.testing.assert_allclose(g, [[0.005], [0.1]])
    np.testing.assert_allclose(q, 2.0 * np.array([[1e-3 / 3, 5e-3], [5e-3, 0.1]]))


def test_an_appendage_that_does_not_move_the_joints_is_refused_by_name() -> None:
    with pytest.raises(BadInput, match=r"not observable.*mode 1"):
        KalmanFilter(MODEL, np.array([0.0, np.pi / 2, 0.0]), FilterSettings(), PERIOD)


def test_the_gain_tends_to_the_stationary_one() -> None:
    settings = FilterSettings(effort_noise=1.0, modal_noise=0.09)
    estimator = KalmanFilter(MODEL, REST, settings, PERIOD)
    y, none = np.array([0.0, 0.5, 0.0, 0.0]), np.zeros(2)
    estimator.reset(measured(0, y, none))
    for tick in range(1, 6000):
        covariance = estimator.update(measured(tick, y, none)).covariance
    variances = np.square([1e-4, 1e-4, 1e-3, 1e-3])
    gain = covariance[:, [0, 1, 3, 4]] / variances  # K = P+ C^T R^-1
    expected = estimator.steady_state_gain()
    np.testing.assert_allclose(expected, gain, rtol=0.0, atol=0.01 * abs(gain).max())


def own_covariance(a: Any, b: Any, c: Any, noises: Any, first: Any, period: Any, ticks: Any) -> Any:
    """P of [x, d] after so many measurements, by the textbook and a series of expm of its own."""
    forces, walk, variances = noises
    m, k = b.shape[1], len(a)
    whole = np.zeros((k + m, k + m))
    whole[:k, :k], whole[:k, k:] = a, b
    density = np.zeros_like(whole)
    density[:k, :k], density[k:, k:] = forces, walk**2 * np.eye(m)
    fine = expm(whole * period / 400)  # Q: the noise of 400 parts of a tick
    f, q, part = np.eye(k + m), np.zeros_like(whole), density * period / 400
    half = expm(whole * period / 800)
    for _ in range(400):
        q = fine @ q @ fine.T + half @ part @ half.T
        f = fine @ f
    p, c, r = first, np.hstack((c, np.zeros((len(c), m)))), np.diag(variances)
    for _ in range(ticks):
        p = f @ p @ f.T + q
        gain = p @ c.T @ np.linalg.inv(c @ p @ c.T + r)
        left = np.eye(k + m) - gain @ c
        p = left @ p @ left.T + gain @ r @ gain.T
    return p


@pytest.mark.parametrize(
    ("testbed", "period", "ticks"),
    [
        (HubTestbed(), 0.01, 1500),
        (HubTestbed(), 0.02, 1000),
        (HubTestbed(), 0.1, 400),  # the mode turns by 0.65 rad in a tick
        (HubTestbed(), 0.4, 100),
        (FloatingOscillatorTestbed(), 1.0, 60),
        (CsaTestbed(modes=3), 0.05, 400),
        (CsaTestbed(modes=6), 0.01, 600),
        (CsaTestbed(modes=8, damping_ratio=0.005), 0.05, 200),
    ],
    ids=str,
)
def test_the_covariance_is_that_of_an_own_filter_however_far_modes_turn_in_a_tick(
    testbed: Any, period: Any, ticks: Any
) -> None:
    model, sigmas = testbed.model(), (1e-4, 1e-3)
    m, n = model.joints, model.coordinates
    rest = np.concatenate((np.linspace(0.0, 0.5, m + 1)[1:], np.zeros(n - m)))
    estimator = KalmanFilter(model, rest, FilterSettings(), period)
    linear = model.linearise(rest)
    modes = [0.01] * (n - m)
    first = np.diag(np.square([sigmas[0]] * m + modes + [sigmas[1]] * m + modes + [10.0] * m))
    c = np.zeros((2 * m, 2 * n))
    c[:m, :m], c[m:, n : n + m] = np.eye(m), np.eye(m)
    noises = np.zeros((2 * n, 2 * n)), 10.0, np.square(np.repeat(sigmas, m))
    expected = own_covariance(
        linear.state_matrix, linear.state_input_matrix, c, noises, first, period, ticks
    )
    still = np.zeros(m)
    for tick in range(ticks + 1):
        now = Measurement(tick, 0, tick * period, "", rest[:m], still, NOTHING, NOTHING, still)
        if tick == 0:
            estimator.reset(now)
        covariance = estimator.update(now).covariance
    sizes = np.sqrt(np.diag(expected))
    # up to 1 / 16 rad in a tick the transition is of second order, right within a per cent
    np.testing.assert_allclose(np.sqrt(np.diag(covariance)), sizes, rtol=0.01)
    off = np.linalg.eigvals(np.linalg.solve(expected, covariance)).real  # along every direction
    assert 0.98 < off.min() < off.max() < 1.02


@pytest.mark.parametrize("period", [0.1, 0.2])
def test_a_filter_whose_modes_are_too_fast_for_a_step_of_its_equations_is_refused(
    period: float,
) -> None:
    fast = CsaTestbed(modes=8, damping_ratio=0.005).model()
    rest = np.concatenate((REST[:2], np.zeros(8)))
    with pytest.raises(BadInput, match=r"cannot follow .* period of .* modes up to 53\.\d rad/s"):
        KalmanFilter(fast, rest, FilterSettings(), period)


def test_a_bench_that_is_ten_times_faster_has_the_same_filter() -> None:
    def covariance(c: float) -> Any:
        """Return P after 50 ticks, in units of the slow bench's time."""
        model = FloatingOscillatorTestbed(
            parameters=FloatingOscillatorParameters(stiffness=c**2)
        ).model()
        settings = FilterSettings(
            rate_sigma=1e-3 * c, initial_deflection=0.02, initial_deflection_rate=0.03 * c,
            initial_disturbance=2.0 * c**2, disturbance_walk=c**2.5, modal_noise=0.1 * c**3,
        )  # fmt: skip
        estimator = KalmanFilter(model, np.zeros(2), settings, 0.1 / c)
        for tick in range(50):
            seen = Measurement(
                tick, 0, tick * 0.1 / c, "", np.zeros(1), np.zeros(1), NOTHING, NOTHING, np.zeros(1)
            )
            if tick == 0:
                estimator.reset(seen)
            found = estimator.update(seen).covariance
        time = np.array([1.0, 1.0, c, c, c**2])
        return found / np.outer(time, time)

    np.testing.assert_allclose(covariance(10.0), covariance(1.0), rtol=1e-9)
