import numpy as np
import pytest

from flexslew_lab.notebook import fly, trial
from flexslew_plant.errors import BadInput
from flexslew_plant.testbeds import initial_state, read_testbed
from flexslew_plant.testbeds.oscillators.floating_oscillator import FloatingOscillatorTestbed

OSCILLATOR = FloatingOscillatorTestbed()


def test_the_frequency_is_the_root_of_two_k_over_m() -> None:
    model = OSCILLATOR.model()
    assert model.linearise(np.zeros(2)).frequencies == pytest.approx([np.sqrt(2.0)], abs=1e-14)


def test_equations_8_and_9_hold() -> None:
    model = OSCILLATOR.model()
    x = np.array([0.3, -0.2, 0.5, 0.7])
    rate = model.derivative(x, np.array([0.4]))
    x1, x2 = x[0], x[0] + x[1]
    assert rate[2] == pytest.approx(0.4 - (x1 - x2), abs=1e-15)
    assert rate[2] + rate[3] == pytest.approx(-(x2 - x1), abs=1e-15)


def test_a_step_of_effort_moves_it_as_the_closed_form_does() -> None:
    model = OSCILLATOR.model()
    x = model.advance(np.zeros(4), np.array([1.0]), 3.0, 60)
    w = np.sqrt(2.0)
    assert x[1] == pytest.approx(-(1.0 - np.cos(w * 3.0)) / w**2, abs=1e-13)
    assert x[0] + x[1] / 2 == pytest.approx(3.0**2 / 4, abs=1e-13)


def test_a_second_mode_is_refused() -> None:
    with pytest.raises(BadInput, match="modes: 2"):
        read_testbed({"kind": "floating_oscillator", "modes": 2}, "trial.yaml")


@pytest.mark.parametrize("rate", [0.0, 1.0, -0.3])
def test_a_free_mass_that_moves_keeps_momentum_and_energy(rate: float) -> None:
    """x_2'(0) = v: both masses drift with v / 2, and swing at sqrt(2 k / m) about it."""
    keys = {
        "plan": None,
        "duration": 10.0,
        "testbed": {"kind": "floating_oscillator", "initial": {"free_mass_rate": rate}},
        "controllers": {"pd_feedforward": {"kp": [0.0], "kd": [0.0]}},
    }
    flight = fly(trial(keys))
    t, w = flight.time, np.sqrt(2.0)
    expected = 0.5 * rate * (t - np.sin(w * t) / w)
    np.testing.assert_allclose(flight["position.mass"], expected, atol=1e-6)
    np.testing.assert_allclose(flight["tip.spring"], rate * np.sin(w * t) / w, atol=1e-6)


def test_it_rests_unless_told_otherwise() -> None:
    assert not initial_state(OSCILLATOR).any()
