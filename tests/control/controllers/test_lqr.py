from typing import Any

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from tests.plants import plant as on_bench

from flexslew_control.controllers.lqr import (
    Lqr,
    ScaledWeights,
    build,
    disturbance_gain,
    regulator,
    scaled_problem,
)
from flexslew_control.law import Reference
from flexslew_lab.reproduce.laws import closed_loop
from flexslew_plant.errors import BadInput
from flexslew_plant.settings import plain, validated
from flexslew_plant.testbeds.csa import CsaTestbed

MODEL = CsaTestbed(modes=1).model()
LINEAR = MODEL.linearise(np.array([0.0, 0.5, 0.0]))


def held(_tick: Any) -> Reference:
    state = np.zeros(6)
    return Reference(state[:2], np.zeros(2), np.zeros(2), state, state)


def test_the_stationary_gain_is_the_limit_of_the_riccati_differential_equation() -> None:
    p = scaled_problem(LINEAR, ScaledWeights())
    gain, found = regulator(p.a, p.b, p.q, p.effort_weight)
    inverse = np.linalg.inv(p.effort_weight)

    def backward(_: Any, flat: Any) -> Any:
        s = flat.reshape(6, 6)
        return (s @ p.a + p.a.T @ s + p.q - s @ p.b @ inverse @ p.b.T @ s).ravel()

    limit = solve_ivp(backward, (0.0, 200.0), np.zeros(36), method="LSODA", rtol=1e-10, atol=1e-8)
    np.testing.assert_allclose(
        limit.y[:, -1].reshape(6, 6), found, rtol=1e-5, atol=1e-7 * abs(found).max()
    )
    assert np.linalg.eigvals(p.a - p.b @ gain).real.max() < 0.0


def test_disturbance_gain_leaves_the_least_squares_remainder() -> None:
    rng = np.random.default_rng(1)
    b, d = rng.standard_normal((5, 2)), rng.standard_normal(5)
    effort = -disturbance_gain(b) @ d
    np.testing.assert_allclose(effort, -np.linalg.lstsq(b, d, rcond=None)[0], atol=1e-12)
    np.testing.assert_allclose(b.T @ (b @ effort + d), 0.0, atol=1e-12)


def test_a_matched_disturbance_leaves_no_error_and_without_minimisation_its_static_one() -> None:
    plant = CsaTestbed(modes=1)
    cancelled = closed_loop(plant, build(Lqr(), on_bench()), held, 80.0, disturbance=5.0)
    assert abs(cancelled.state[-1, 0]) < 1e-5
    plain = build(Lqr(minimise_disturbance=False), on_bench())
    left = closed_loop(plant, plain, held, 80.0, disturbance=5.0)
    np.testing.assert_allclose(left.state[-1, 0], 5.0 / plain[1].gain[0, 0], rtol=0.01)


def test_an_uncontrollable_operating_point_is_refused_with_its_eigenvalue() -> None:
    with pytest.raises(BadInput, match=r"not controllable: eigenvalue .*0\.338329j.*mode 1"):
        build(Lqr(operating_point={"hub_pitch": float(np.pi / 2)}), on_bench())


def test_a_operating_point_for_an_unknown_joint_is_refused() -> None:
    with pytest.raises(BadInput, match="operating_point: elbow is not a joint"):
        build(Lqr(operating_point={"elbow": 0.1}), on_bench())


def test_a_trial_of_an_earlier_version_names_its_operating_point_set_point() -> None:
    old = validated(Lqr, {"set_point": {"hub_pitch": 0.3}}, "old.yaml")
    assert old == Lqr(operating_point={"hub_pitch": 0.3})
    assert "set_point" not in plain(old)
