"""The responses of one oscillator beside the matrix exponential, whatever its damping."""

import numpy as np
import pytest
from scipy.linalg import expm

from flexslew_lab.identification.modal.oscillators import Oscillator

DAMPING = [-0.01, 0.0, 0.02, 0.99, 1.0, 1.0 + 1e-9, 1.5, 30.0]


@pytest.mark.parametrize("ratio", DAMPING)
def test_a_transition_and_a_step_response_follow_the_matrix_exponential(ratio: float) -> None:
    w = 3.0
    # q, q' and a unit effort that is held
    a = np.array([[0.0, 1.0, 0.0], [-w * w, -2.0 * ratio * w, 1.0], [0.0, 0.0, 0.0]])
    times = np.array([0.0, 1e-3, 0.1, 2.0])
    exact = np.array([expm(a * t) for t in times])
    mode = Oscillator(w, ratio)
    np.testing.assert_allclose(mode.transition(times), exact[:, :2, :2], rtol=1e-9, atol=1e-11)
    q, rate = mode.step_response(times[:, None])
    np.testing.assert_allclose(q[:, 0], w * w * exact[:, 0, 2], rtol=1e-8, atol=1e-11)
    np.testing.assert_allclose(rate[:, 0], w * w * exact[:, 1, 2], rtol=1e-8, atol=1e-11)


def test_an_overdamped_oscillator_is_at_rest_after_a_long_time() -> None:
    mode = Oscillator(50.0, 40.0)
    assert np.isfinite(mode.transition(np.array([1.0, 1e4]))).all()
    q, rate = mode.step_response(np.array([[1e4]]))
    assert (q[0, 0], rate[0, 0]) == pytest.approx((1.0, 0.0))
