from typing import Any

import numpy as np
import pytest

from flexslew_control.planners.feedforward.manoeuvre import Manoeuvre
from flexslew_plant.testbeds.csa import CsaTestbed, beam

MODEL = CsaTestbed(variant="printed", modes=1).model()
GAIN_P, GAIN_D = np.array([460.0, 460.0]), np.array([920.0, 920.0])


def at(pitch: Any) -> Any:
    return MODEL.linearise(np.array([0.0, pitch, 0.0]))


@pytest.mark.parametrize(("pitch", "rate"), [(0.0, 0.468949), (np.pi / 2, 0.338329)])
def test_open_loop_frequency(pitch: Any, rate: float) -> None:
    assert at(pitch).frequencies[0] == pytest.approx(rate, abs=1e-5)


@pytest.mark.parametrize(("pitch", "period"), [(0.0, 29.560), (0.5, 27.842), (1.0, 23.116)])
def test_longest_closed_loop_periods(pitch: float, period: float) -> None:
    loop = at(pitch).with_feedback(GAIN_P, GAIN_D)
    damped = np.abs(loop.eigenvalues.imag)
    natural = 2.0 * np.pi / loop.frequencies  # without damping
    found = np.concatenate((natural, 2.0 * np.pi / damped[damped > 1e-9]))
    assert np.abs(found - period).min() < 1e-3


def test_pitch_axis_period() -> None:
    j_2 = MODEL.mass_matrix(np.zeros(3))[1, 1]
    periods = 2.0 * np.pi / at(0.5).with_feedback(GAIN_P, GAIN_D).frequencies
    poles = np.roots([j_2, 920.0, 460.0])
    assert np.abs(np.append(periods, 2.0 * np.pi / abs(poles[0].imag)) - 23.565).min() < 1e-3


def test_three_modes_of_the_beam_and_their_integrals() -> None:
    bed = CsaTestbed(modes=3)
    np.testing.assert_allclose(beam(bed).frequencies, [0.338329, 2.120270, 5.936817], atol=1e-6)
    linear = bed.model().linearise(np.zeros(5))
    np.testing.assert_allclose(linear.mass[0, 2:], [107.08658, -18.94164, 7.36150], atol=1e-5)
    np.testing.assert_allclose(np.diag(linear.mass)[:2], [4000.0 + 3972.0, 5972.0], rtol=1e-12)
    np.testing.assert_allclose(linear.mass[2:, 2:], 3.0 * np.eye(3), atol=1e-9)
    np.testing.assert_allclose(
        np.diag(linear.stiffness)[2:], [0.343399, 13.486634, 105.737396], atol=1e-6
    )


class StepFromRest(Manoeuvre):
    initial_state = np.zeros(6)


def step_response() -> tuple[Any, Any]:
    """Return times and states after a step of 0.2 rad in both references."""
    goal = np.array([0.2, 0.2])
    slew = StepFromRest(MODEL, GAIN_P, GAIN_D, goal, goal, 1.0, "cubic")
    edges = np.linspace(0.0, 130.0, 6501)
    return edges, slew.fly(edges, np.zeros((12 * 6500, 2)))


def test_step_response_of_figure_5() -> None:
    t, x = step_response()
    tip = np.abs(x[:, 2])
    assert tip.max() == pytest.approx(3.5646, abs=1e-4)
    assert tip[(t >= 75.0) & (t <= 100.0)].max() == pytest.approx(0.269, abs=1e-3)
    outside = np.abs(x[:, 0] - 0.2) > 0.02 * 0.2
    assert t[outside][-1] == pytest.approx(106.4, abs=0.1)


def test_torque_of_a_step_is_the_gain_times_the_step() -> None:
    _, x = step_response()
    np.testing.assert_allclose(GAIN_P * (0.2 - x[0, :2]) - GAIN_D * x[0, 3:5], 92.0)
