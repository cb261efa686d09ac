import pickle
from typing import Any

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from flexslew_plant.settings import validated
from flexslew_plant.testbeds import WITH_EQUATIONS, TestbedSettings
from flexslew_plant.testbeds.csa import CsaTestbed, CsaVariant

# q is as long as v; the free platform, where it is not, has tests of its own
SAME_LENGTHS = [kind for kind in WITH_EQUATIONS if kind != "spacecraft"]

STATE = np.array([0.1, 0.3, 0.5, 0.05, -0.02, 0.2, -0.1, 0.3, 0.1, 0.05])
EFFORT = np.array([60.0, -30.0])


def model(variant: CsaVariant = "complete") -> Any:
    return CsaTestbed(variant=variant, modes=3).model()


def integrated(of: Any, x: Any, effort: Any, duration: Any) -> Any:
    found = solve_ivp(
        lambda t, y: of.derivative(y, effort), (0.0, duration), x, "DOP853", rtol=3e-14, atol=1e-15
    )
    return found.y[:, -1]


@pytest.mark.parametrize("variant", ["printed", "complete"])
def test_one_tick_is_exact_to_1e_9(variant: CsaVariant) -> None:
    bed = model(variant)
    for scale in (1.0, 5.0):
        reached = bed.advance(scale * STATE, EFFORT, 0.01)
        np.testing.assert_allclose(
            reached, integrated(bed, scale * STATE, EFFORT, 0.01), atol=1e-10
        )


def test_many_ticks_stay_within_1e_9() -> None:
    bed, x = model(), STATE
    for _ in range(500):
        x = bed.advance(x, EFFORT, 0.01)
    np.testing.assert_allclose(x, integrated(bed, STATE, EFFORT, 5.0), atol=1e-9)


def test_halving_the_step_shows_the_order() -> None:
    bed = model()
    exact = integrated(bed, STATE, EFFORT, 2.0)
    errors = [np.abs(bed.advance(STATE, EFFORT, 2.0, n) - exact).max() for n in (6, 12)]
    assert np.log2(errors[0] / errors[1]) == pytest.approx(8.0, abs=1.2)


def test_steps_of_one_call_are_steps_of_several() -> None:
    bed, x = model(), STATE
    for _ in range(4):
        x = bed.advance(x, EFFORT, 0.01)
    np.testing.assert_allclose(bed.advance(STATE, EFFORT, 0.04, 4), x, rtol=1e-14)


def test_the_same_call_gives_the_same_bits_and_leaves_its_arguments_alone() -> None:
    bed, x, effort = model(), STATE.copy(), EFFORT.copy()
    first = bed.advance(x, effort, 0.01)
    second = bed.advance(x, effort, 0.01)
    assert first.tobytes() == second.tobytes()
    np.testing.assert_array_equal(x, STATE)
    np.testing.assert_array_equal(effort, EFFORT)
    assert not np.shares_memory(first, second)


def test_a_model_can_be_sent_to_another_process() -> None:
    bed = model()
    expected = bed.advance(STATE, EFFORT, 0.01)
    sent = pickle.loads(pickle.dumps(bed))
    assert sent.advance(STATE, EFFORT, 0.01).tobytes() == expected.tobytes()


@pytest.mark.slow
@pytest.mark.parametrize("kind", SAME_LENGTHS)
def test_energy_is_kinetic_plus_potential(kind: Any) -> None:
    bed = validated(TestbedSettings, {"kind": kind}, "here").model()
    x = 0.1 * np.random.default_rng(4).standard_normal(2 * bed.coordinates)
    still = np.concatenate((x[: bed.coordinates], np.zeros(bed.coordinates)))
    assert bed.energy(x) == pytest.approx(bed.kinetic_energy(x) + bed.energy(still), rel=1e-13)
    assert bed.kinetic_energy(still) == 0.0
