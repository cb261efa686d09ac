"""Coloured residuals: one physical mode is one mode, without ghosts, and intervals hold it."""

import numpy as np
import pytest
from tests.lab.identification.disturbed import ARM, SPRING, arm_record, spring_record

from flexslew_lab.identification.modal.coloured import noise_filters
from flexslew_lab.identification.modal.modes import identify_modes
from flexslew_lab.identification.modal.subspace import ResampledRecord, arx

BAND = 0.05, 2.0  # [rad/sample]


def arm_intervals(seed: int) -> list[tuple[float, float, float]]:
    """Return low ends, truths and high ends of what was found of the arm; two modes, no ghosts."""
    model = identify_modes(arm_record(seed), BAND)
    assert len(model.modes) == len(ARM)
    assert model.noise_order > 0
    found = []
    for mode, truth in zip(model.modes, ARM, strict=True):
        for interval, value in (
            (mode.frequency, truth.frequency),
            (mode.damping_ratio, truth.damping_ratio),
        ):
            found.append((interval.low, value, interval.high))
    return found


@pytest.mark.campaign
def test_the_modes_of_a_disturbed_arm_are_found_without_ghosts(case: np.random.Generator) -> None:
    """Each is within twice its interval: 1 in 10,000 is not."""
    for low, value, high in arm_intervals(int(case.integers(2**31))):
        assert abs(value - 0.5 * (low + high)) < high - low


@pytest.mark.slow
@pytest.mark.campaign
def test_the_intervals_of_a_disturbed_arm_hold_the_truth() -> None:
    """Of 80 intervals of 95 %, 68 or more hold the truth but for one in 10,000 tries."""
    found = [one for seed in range(20) for one in arm_intervals(seed)]
    held = sum(low <= value <= high for low, value, high in found)
    assert held >= 68


@pytest.mark.campaign
def test_a_spring_that_stiffens_is_one_mode(case: np.random.Generator) -> None:
    """Its best linear frequency lies between that of no and of normal deflections."""
    stiffening = 0.02
    model = identify_modes(spring_record(int(case.integers(2**31)), 4096, stiffening))
    (mode,) = model.modes
    stiffest = SPRING.frequency * np.sqrt(1.0 + 3.0 * stiffening)
    assert SPRING.frequency < mode.frequency.low < mode.frequency.high < 1.005 * stiffest
    low, high = mode.damping_ratio.low, mode.damping_ratio.high
    assert low - 0.001 < SPRING.damping_ratio < high + 0.001


def test_a_weak_spring_gives_its_own_mode() -> None:
    (mode,) = identify_modes(spring_record(1, 4096, 1e-5)).modes
    assert mode.frequency.value == pytest.approx(SPRING.frequency, rel=1e-3)
    assert mode.damping_ratio.value == pytest.approx(SPRING.damping_ratio, rel=1e-2)


def test_the_poles_of_an_arx_model_are_those_of_its_equation() -> None:
    rng = np.random.default_rng(5)
    poles = 0.95 * np.exp(1j * np.array([0.4, 1.1]))
    a = np.real(np.poly([*poles, *poles.conj()]))
    u, y = rng.standard_normal(4000), np.zeros(4000)
    for k in range(4, 4000):
        y[k] = -a[1:] @ y[k - 4 : k][::-1] + u[k - 1] + 0.1 * rng.standard_normal()
    record = ResampledRecord(u[:, None], y[:, None], y[:, None], 1.0, False)
    found = arx(record, (4,)).by_order[4]
    expected = sorted(abs(np.log(poles)))
    assert [mode.frequency for mode in found] == pytest.approx(expected, rel=2e-3)


@pytest.mark.parametrize(("inputs", "outputs"), [(1, 2), (1, 3), (2, 4), (3, 2)])
def test_the_poles_of_several_channels_are_those_of_their_equation(
    inputs: int, outputs: int
) -> None:
    """y(k) = A1 y(k-1) + A2 y(k-2) + B u(k-1) has the poles of its companion matrix."""
    rng = np.random.default_rng(inputs + outputs)
    first, b = (
        0.15 * rng.standard_normal((outputs, outputs)),
        rng.standard_normal((outputs, inputs)),
    )
    second = -0.7 * np.eye(outputs)
    u, y = rng.standard_normal((2000, inputs)), np.zeros((2000, outputs))
    for k in range(2, 2000):
        y[k] = first @ y[k - 1] + second @ y[k - 2] + b @ u[k - 1]
    companion = np.block([[first, second], [np.eye(outputs), np.zeros((outputs, outputs))]])
    poles = np.linalg.eigvals(companion)
    assert abs(poles).max() < 1.0
    found = arx(ResampledRecord(u, y, y, 1.0, False), (2,)).by_order[2]
    expected = sorted(abs(np.log(poles[poles.imag > 0.0])))
    assert [mode.frequency for mode in found] == pytest.approx(expected, rel=1e-6)


def test_the_noise_filter_has_the_poles_of_what_is_disturbed() -> None:
    record = arm_record(0, 4096)
    taps = noise_filters(record)[0]
    poles = np.roots(taps)
    nearest = [np.abs(np.log(poles + 0j) - w).min() for w in (0.367j, 0.797j)]
    assert max(nearest) < 0.02
