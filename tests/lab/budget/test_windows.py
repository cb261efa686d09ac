"""Metrics as filters of windows: closed forms of white noise, bias and harmonic."""

import numpy as np
import pytest

from flexslew_lab.budget.windows import Windows, windows_of
from flexslew_plant.errors import BadInput

_N = 20
_WINDOWS = Windows(7, 7 + 12 * _N - 1, _N, apart=2)


def _white(sigma: float, ticks: int) -> np.ndarray:
    """Return the impulse response of an error that is the noise itself."""
    response = np.zeros((ticks, 1, 1))
    response[0] = sigma
    return response


def test_the_variances_of_a_white_noise_are_the_closed_forms() -> None:
    found = _WINDOWS.of_noise(_white(0.3, _WINDOWS.last + 1))
    expected = {"APE": 1.0, "MPE": 1.0 / _N, "RPE": 1.0 - 1.0 / _N, "PDE": 2.0 / _N}
    for metric, share in expected.items():
        assert found[metric] == pytest.approx(0.09 * share), metric


def test_a_bias_has_an_absolute_and_a_mean_error_alone() -> None:
    found = _WINDOWS.of_series(np.full((_WINDOWS.last + 1, 1), -2.0))
    assert found["APE"] == pytest.approx(-2.0)
    assert found["MPE"] == pytest.approx(-2.0)
    assert abs(found["RPE"]).max() == 0.0
    assert abs(found["PDE"]).max() == 0.0


def test_a_harmonic_is_filtered_by_the_kernel_of_its_window() -> None:
    """The mean of N samples of a sine is the sine of the middle times Dirichlet's kernel."""
    w, amplitude, ticks = 0.11, 0.7, np.arange(_WINDOWS.last + 1)
    found = _WINDOWS.of_series(amplitude * np.exp(1j * w * ticks)[:, None])
    kernel = np.sin(_N * w / 2.0) / (_N * np.sin(w / 2.0))
    shift = abs(np.exp(1j * w * 2 * _N) - 1.0)
    assert abs(found["MPE"]) == pytest.approx(amplitude * abs(kernel))
    assert abs(found["PDE"]) == pytest.approx(amplitude * abs(kernel) * shift)
    square = (abs(found["RPE"]) ** 2).mean()
    assert square == pytest.approx(amplitude**2 * (1.0 - kernel**2))


def test_the_variances_of_a_coloured_noise_are_those_of_its_members() -> None:
    """An AR(1) that has settled: sums of its covariance function a^|l| s^2 / (1 - a^2)."""
    a, windows = 0.9, Windows(400, 400 + 5 * _N - 1, _N)
    response = np.zeros((windows.last + 1, 1, 1))
    response[:, 0, 0] = a ** np.arange(len(response))
    found = windows.of_noise(response)
    lag = np.arange(_N)
    covariance = a ** abs(lag[:, None] - lag) / (1.0 - a * a)
    mean = covariance.mean()
    across = (a ** (_N + lag[:, None] - lag) / (1.0 - a * a)).mean()
    assert found["APE"] == pytest.approx(1.0 / (1.0 - a * a))
    assert found["MPE"] == pytest.approx(mean)
    own = 1.0 / (1.0 - a * a) + mean - 2.0 * covariance.mean(axis=1)
    assert found["RPE"].reshape(-1, _N) == pytest.approx(np.tile(own, (5, 1)))
    assert found["PDE"] == pytest.approx(2.0 * (mean - across))


def test_a_noise_that_begins_has_the_variances_of_drawn_members() -> None:
    rng, windows = np.random.default_rng(3), Windows(5, 64, _N)
    response = rng.standard_normal((65, 2, 3)) * np.exp(-np.arange(65) / 30.0)[:, None, None]
    predicted = windows.of_noise(response)
    sums = {metric: 0.0 for metric in predicted}
    members = 4000
    for _ in range(members):
        noise = rng.standard_normal((65, 3))
        error = np.zeros((65, 2))
        for axis, k in np.ndindex(2, 3):
            error[:, axis] += np.convolve(response[:, axis, k], noise[:, k])[:65]
        for metric, values in windows.of_series(error).items():
            sums[metric] = sums[metric] + (values**2).mean(axis=0) / members
    for metric, variance in predicted.items():
        assert sums[metric] == pytest.approx(variance.mean(axis=0), rel=0.08), metric


def test_a_run_that_is_too_short_has_no_metrics_of_windows() -> None:
    for last, metrics in ((_N - 2, {"APE"}), (_N - 1, {"APE", "MPE", "RPE"})):
        windows = Windows(0, last, _N)
        assert set(windows.of_series(np.ones((last + 1, 1)))) == metrics
        assert set(windows.of_noise(_white(1.0, last + 1))) == metrics


@pytest.mark.parametrize(("seconds", "apart"), [(0.001, None), (1.0, 1.5), (1.0, 0.0)])
def test_windows_that_are_no_ticks_are_refused(seconds: float, apart: float | None) -> None:
    with pytest.raises(BadInput, match=r"--window|--drift"):
        windows_of(0, 100, 0.1, seconds, apart)
