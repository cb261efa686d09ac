from typing import Any

import numpy as np
import pytest

from flexslew_control.planners.input_shaping.shapers import ShaperName, convolve, make_shaper
from flexslew_plant.errors import BadInput

W = 0.468949


@pytest.mark.parametrize("name", ["zv", "mzv", "zvd", "zvdd", "ei_two_hump"])
@pytest.mark.parametrize("damping", [0.0, 0.02, 0.3, 0.7, 0.95])
def test_no_vibration_is_left_at_the_nominal_frequency(name: ShaperName, damping: float) -> None:
    shaper = make_shaper(name, W, damping)
    assert shaper.residual(W, damping)[0] < 1e-12
    assert shaper.amplitudes.sum() == pytest.approx(1.0, abs=1e-15)
    assert (shaper.amplitudes > 0.0).all()


# 4/pi asin(sqrt 0.05 ...) and its like in closed form; two humps: the literature's rounded value
@pytest.mark.parametrize(
    ("name", "width", "digits"),
    [
        ("zv", 4 / np.pi * np.arcsin(0.05), 3e-5),
        ("zvd", 4 / np.pi * np.arcsin(np.sqrt(0.05)), 3e-5),
        ("ei", 2 / np.pi * np.arccos(0.85 / 1.05), 3e-5),
        ("ei_two_hump", 0.726, 2e-3),
        ("ei_three_hump", 0.964, 2e-3),
    ],
)
def test_the_width_at_five_percent_is_the_published_one(
    name: ShaperName, width: Any, digits: float
) -> None:
    errors = np.linspace(-0.6, 0.6, 120001)
    good = make_shaper(name, W).residual(W * (1.0 + errors)) <= 0.05 + 1e-9
    middle = errors.size // 2
    low, high = middle, middle
    while low > 0 and good[low - 1]:
        low -= 1
    while high < errors.size - 1 and good[high + 1]:
        high += 1
    assert errors[high] - errors[low] == pytest.approx(width, abs=digits)


def test_zero_vibration_leaves_an_exact_mode_at_rest() -> None:
    shaper, w, t = make_shaper("zv", W), W, 40.0
    x = sum(
        a * (1 - np.cos(w * (t - s))) for a, s in zip(shaper.amplitudes, shaper.times, strict=True)
    )
    v = sum(a * np.sin(w * (t - s)) for a, s in zip(shaper.amplitudes, shaper.times, strict=True))
    assert x == pytest.approx(1.0, abs=1e-9)
    assert v == pytest.approx(0.0, abs=1e-9)


@pytest.mark.parametrize("name", ["ei", "ei_two_hump", "ei_three_hump"])
@pytest.mark.parametrize("damping", [0.0, 0.01, 0.05, 0.1])
@pytest.mark.parametrize("tolerance", [0.02, 0.05, 0.1])
def test_the_highest_hump_is_the_tolerance_at_any_damping(
    name: ShaperName, damping: float, tolerance: float
) -> None:
    shaper = make_shaper(name, W, damping, tolerance)
    curve = shaper.residual(W * np.linspace(0.4, 1.6, 20001), damping)
    peaks = curve[1:-1][(curve[1:-1] > curve[:-2]) & (curve[1:-1] > curve[2:])]
    assert peaks.max() == pytest.approx(tolerance, rel=1e-5)
    assert shaper.amplitudes.sum() == pytest.approx(1.0, abs=1e-15)
    assert (shaper.amplitudes > 0.0).all()


def test_mzv_is_that_of_printers() -> None:
    """Klipper: a1 = 1 - 1/sqrt 2, a2 = (sqrt 2 - 1) K, a3 = a1 K^2 at 0, 3/8, 3/4 of the period."""
    damping, root = 0.1, np.sqrt(1.0 - 0.01)
    k = np.exp(-0.75 * damping * np.pi / root)
    a = np.array([1.0 - np.sqrt(0.5), (np.sqrt(2.0) - 1.0) * k, (1.0 - np.sqrt(0.5)) * k**2])
    shaper = make_shaper("mzv", W, damping)
    assert shaper.amplitudes == pytest.approx(a / a.sum(), abs=1e-15)
    assert shaper.times == pytest.approx(2.0 * np.pi / (W * root) * np.array([0.0, 0.375, 0.75]))


def test_smoothing_is_the_spread_of_a_step() -> None:
    zv = make_shaper("zv", W)
    assert zv.smoothing == pytest.approx(0.5 * np.pi / W)  # half each, half a period apart
    assert make_shaper("none", W).smoothing == 0.0


def test_several_modes_are_shaped_by_convolution() -> None:
    both = convolve([make_shaper("zv", 0.34), make_shaper("zvd", 2.12, 0.01)])
    assert both.residual(0.34)[0] < 1e-12
    assert both.residual(2.12, 0.01)[0] < 1e-12


def test_delays_are_exact_between_the_ticks() -> None:
    t = np.linspace(0.0, 3.0, 301)
    shaped = make_shaper("zv", 3.3).shape(lambda t: np.clip(t, 0, 1), t)
    exact = 0.5 * np.clip(t, 0, 1) + 0.5 * np.clip(t - np.pi / 3.3, 0, 1)
    assert shaped == pytest.approx(exact, abs=1e-13)


def test_negative_impulses_must_be_asked_for() -> None:
    with pytest.raises(BadInput, match="negative: true"):
        make_shaper("um_zv", W)
    for damping in (0.0, 0.1, 0.6, 0.95):
        shaper = make_shaper("um_zv", W, damping, negative=True)
        assert shaper.residual(W, damping)[0] < 1e-12
        assert shaper.duration < make_shaper("zv", W, damping).duration


def test_numbers_out_of_range_are_refused() -> None:
    for frequency, damping in ((0.0, 0.0), (-1.0, 0.0), (1.0, 1.0), (1.0, -0.1)):
        with pytest.raises(BadInput, match="is not allowed"):
            make_shaper("zv", frequency, damping)
