"""Algebra of the laws on small motions, on seeded random plants and on the shipped antennas."""

import numpy as np
import pytest
from scipy.linalg import expm, solve_continuous_are
from tests.plants import plant

from flexslew_control.controllers import CONTROLLERS, build_controller
from flexslew_control.controllers.linear_form import SmallMotionForm
from flexslew_control.controllers.lqr import regulator
from flexslew_control.controllers.retargeting.disturbance_accommodating import (
    IntegralWeights,
    augmented,
    integral_gains,
)
from flexslew_control.controllers.retargeting.modal_space import modal_gains, space_gains
from flexslew_control.controllers.retargeting.sampled_regulator import sampled_gain
from flexslew_control.controllers.retargeting.small_motion_laws import (
    IntegralFeedback,
    integral_form,
)
from flexslew_control.estimators.small_motion_observer import (
    ObserverSettings,
    SmallMotionObserver,
    observer,
)
from flexslew_control.law import Estimate, Reference
from flexslew_control.linear.small_motion import Frozen, design_motion
from flexslew_lab.reproduce.scole_flights import example_trial
from flexslew_plant.arrays import EMPTY
from flexslew_plant.errors import BadInput
from flexslew_plant.measurement import Measurement

WEIGHTS = IntegralWeights(state=10.0, effort=2.0, effort_rate=0.05)


def random_plant(seed: int, k: int = 4, m: int = 4) -> Frozen:
    """Return M, D, K, B* and d of a plant that holds together."""
    rng = np.random.default_rng(seed)
    a, b = rng.standard_normal((2, k, k))
    return Frozen(
        a @ a.T + k * np.eye(k),
        0.05 * b @ b.T,
        b @ b.T,
        rng.standard_normal((k, m)),
        rng.standard_normal(k),
    )


def closed(frozen: Frozen, gains: np.ndarray) -> np.ndarray:
    """Return the loop of (x, x', integral of x) under u = -gains (x, x', integral of x)."""
    k = len(frozen.mass)
    f = np.zeros((3 * k, 3 * k))
    f[: 2 * k, : 2 * k] = frozen.state_matrix
    f[: 2 * k] -= frozen.state_input_matrix @ gains
    f[2 * k :, :k] = np.eye(k)
    return f


@pytest.mark.parametrize("seed", range(4))
def test_the_pi_law_has_the_poles_of_the_augmented_regulator(seed: int) -> None:
    frozen = random_plant(seed)
    a, b = augmented(frozen)
    w = np.diag([WEIGHTS.state] * 8 + [WEIGHTS.effort] * 4)
    gain, _ = regulator(a, b, w, WEIGHTS.effort_rate * np.eye(4))
    theirs = np.sort_complex(np.linalg.eigvals(a - b @ gain))
    ours = np.sort_complex(np.linalg.eigvals(closed(frozen, integral_gains(frozen, WEIGHTS))))
    np.testing.assert_allclose(ours, theirs, rtol=1e-6, atol=1e-6)


@pytest.mark.parametrize("seed", range(4))
def test_the_pi_law_leaves_nothing_of_a_matched_disturbance_and_some_of_another(seed: int) -> None:
    frozen = random_plant(seed, 4, 2)  # two efforts for four motions
    gains = integral_gains(frozen, WEIGHTS)
    f = closed(frozen, gains)
    k = 4
    for matched in (True, False):
        force = frozen.input_matrix @ np.ones(2) if matched else frozen.disturbance
        pushed = np.zeros(3 * k)
        pushed[k : 2 * k] = np.linalg.solve(frozen.mass, force)
        wide = np.zeros((3 * k + 1, 3 * k + 1))
        wide[: 3 * k, : 3 * k], wide[: 3 * k, -1] = f, pushed
        y = (expm(wide * 400.0) @ np.append(np.zeros(3 * k), 1.0))[: 3 * k]
        assert (abs(y[:k]).max() < 1e-6) == matched


@pytest.mark.parametrize("w", [0.5, 10.0, 56.1])
def test_one_mode_of_modal_space_control_is_its_regulator(w: float) -> None:
    a, b = np.array([[0.0, 1.0], [-w * w, 0.0]]), np.array([[0.0], [1.0]])
    p = solve_continuous_are(a, b, np.diag([w * w, 1.0]), 0.01 * np.eye(1))
    k = 100.0 * b.T @ p
    stiffening, damping = modal_gains(np.array([w * w]), 0.01)
    np.testing.assert_allclose(k[0], [stiffening[0], damping[0]], rtol=1e-6)


def test_modal_space_control_leaves_every_motion_on_its_own() -> None:
    mass = np.diag([50.0, 1.0, 1.0])
    stiffness = np.diag([0.0, 9.0, 25.0])
    b = np.array([[1.0, 0.3, -0.2], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]])  # modal forces push it too
    gains = space_gains(Frozen(mass, np.zeros((3, 3)), stiffness, b, np.zeros(3)), 0.01, 10.0)
    np.testing.assert_allclose(gains[0], [0.0, 0.0, 0.0, 500.0, 0.0, 0.0], atol=1e-9)
    assert np.count_nonzero(abs(gains[1:]) > 1e-9) == 4


def test_a_held_regulator_tends_to_the_continuous_one() -> None:
    frozen = random_plant(7)
    a, b = frozen.state_matrix, frozen.state_input_matrix
    q, r = np.eye(8), 0.1 * np.eye(4)
    gain = sampled_gain(a, b, q, r, 1e-5, "sampled")
    np.testing.assert_allclose(gain, regulator(a, b, q, r)[0], rtol=2e-3, atol=2e-3)


def test_a_continuous_regulator_that_a_tick_makes_unstable_is_refused() -> None:
    testbed = example_trial("antenna_4").testbed
    with pytest.raises(BadInput, match=r"continuous is not stable .* 0.05 s: .* take sampled"):
        build_controller(
            "a", "disturbance_minimisation", {}, plant(0.05, [4e3] * 4, testbed), "trial"
        )


def test_efforts_that_do_the_same_are_refused_by_name() -> None:
    twin = {"kind": "force", "direction": [0.0, 1.0, 0.0], "appendage": None, "mode": None}
    testbed = example_trial("antenna_4", {"testbed": {"actuators": {"beam_mode": twin}}}).testbed
    with pytest.raises(
        BadInput, match=r"beam_mode and y are dependent; the motion of mode 1 cannot"
    ):
        build_controller(
            "a", "disturbance_accommodating", {}, plant(0.01, [4e3] * 4, testbed), "trial"
        )


def test_planned_gains_wait_for_a_plan_that_has_some() -> None:
    testbed = example_trial("antenna_3").testbed
    assert "planned_gains" in CONTROLLERS
    controller = build_controller("a", "planned_gains", {}, plant(0.01, [1e3], testbed), "trial")
    assert (
        str(controller.reason)
        == "its plan has no gains; set plan.gains to constant, perturbation or adiabatic"
    )


@pytest.mark.parametrize("planned", [False, True], ids=["constant", "planned"])
def test_an_integral_on_an_observer_is_its_matrices_tick_by_tick(planned: bool) -> None:
    """With gains of every tick, and efforts at their limits some of the time."""
    testbed = example_trial("antenna_1").testbed
    estimator = observer(
        design_motion(plant(0.01, testbed.effort_limit, testbed), None), ObserverSettings(), 0.01
    )
    assert isinstance(estimator, SmallMotionObserver)
    (n, m), rng = (16, 10), np.random.default_rng(9)
    gains, none = rng.standard_normal((21, m, 3 * n)), np.zeros(m)
    references = [
        Reference(none, none, rng.standard_normal(m), EMPTY, gains=own.ravel()) for own in gains[1:]
    ]
    law = IntegralFeedback(gains[0], none, np.full(m, 4.0), 0.5, 0.01, planned)
    form = integral_form(estimator, law, references)
    assert isinstance(form.observer, SmallMotionForm)
    start, *others = form.observer.behind
    y = rng.standard_normal((len(references), 2 * n))
    s, efforts = start @ y[0], np.zeros((len(references), m))
    for k, reference in enumerate(references):
        if k > 0:
            a, b, e, c, d = (each[min(k, len(each)) - 1] for each in others)
            assert not b.any()  # whatever motors make of a demand, it winds back by its own
            s = a @ s + e @ y[k - 1] + c + d @ efforts[k - 1]
        own = form.law.from_state[min(k, len(form.law.from_state) - 1)]
        efforts[k] = np.clip(form.law.demand[k] + own @ np.concatenate((y[k], s)), -4.0, 4.0)
        measured = Measurement(k, 0, 0.01 * k, "", none, none, EMPTY, EMPTY, none)
        estimate = Estimate(y[k, :n], y[k, n:], EMPTY, np.zeros((0, 0)), EMPTY)
        expected = law.update(measured, estimate, reference)
        np.testing.assert_allclose(efforts[k], expected, rtol=1e-10, atol=1e-10)
    assert 0.2 < np.mean(np.abs(efforts) == 4.0) < 0.8
