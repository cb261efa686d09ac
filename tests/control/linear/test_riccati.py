"""Riccati equations and tests of rank, in any units."""

import numpy as np
import pytest
from scipy.linalg import LinAlgError, expm, solve_continuous_are, solve_discrete_are

from flexslew_control.linear.design_checks import require_controllable, require_observable
from flexslew_control.linear.riccati import continuous_riccati, discrete_riccati
from flexslew_plant.arrays import Matrix
from flexslew_plant.errors import BadInput

NAMES = ("joint", "mode", "joint rate", "mode rate")


def spacecraft(rng: np.random.Generator) -> tuple[Matrix, Matrix]:
    """Return A and B of a joint with an appendage, every number near one."""
    mass = np.array([[2.0, 0.6], [0.6, 1.0]])
    lower = np.linalg.solve(mass, np.diag([0.0, 10.0 ** rng.uniform(-1.0, 1.0)]))
    a = np.block([[np.zeros((2, 2)), np.eye(2)], [-lower, -0.01 * lower]])
    return a, np.vstack((np.zeros((2, 1)), np.linalg.solve(mass, np.eye(2)[:, :1])))


def test_a_solution_is_the_same_in_all_units() -> None:
    rng = np.random.default_rng(3)
    for _ in range(40):
        a, b = spacecraft(rng)
        q, r = np.diag(10.0 ** rng.uniform(-1.0, 1.0, 4)), np.eye(1)
        s = 0.05 * rng.normal(size=(4, 1))
        held = expm(0.1 * np.block([[a, b], [np.zeros((1, 5))]]))
        f, g = held[:4, :4], held[:4, 4:]
        x, u = 10.0 ** rng.uniform(-8.0, 8.0, 4), 10.0 ** rng.uniform(-8.0, 8.0)
        time, cost = 10.0 ** rng.uniform(-4.0, 4.0), 10.0 ** rng.uniform(-6.0, 6.0)
        weights = (x[:, None] * q * x, r * u**2, x[:, None] * s * u)
        q2, r2, s2 = (cost * weight for weight in weights)
        found = continuous_riccati(
            time * a * x / x[:, None], time * b * u / x[:, None], time * q2, time * r2, time * s2
        )
        for p2, p in (
            (found, solve_continuous_are(a, b, q, r, s=s)),
            (
                discrete_riccati(f * x / x[:, None], g * u / x[:, None], q2, r2, s2),
                solve_discrete_are(f, g, q, r, s=s),
            ),
        ):
            size = np.sqrt(np.diag(p))
            off = abs(p2 / cost / x / x[:, None] - p) / size / size[:, None]
            assert off.max() < 1e-5  # of a solver of order four on matrices over 16 decades


def test_what_no_effort_holds_has_no_solution() -> None:
    a, b, one = np.diag([1.0, -1.0]), np.array([[0.0], [1.0]]), np.eye(2)
    for solve in (continuous_riccati, discrete_riccati):
        with pytest.raises(LinAlgError):
            solve(2.0 * a, b, one, one[:1, :1])


def test_controllability_and_observability_do_not_depend_on_units() -> None:
    rng = np.random.default_rng(4)
    for _ in range(100):
        a, b = spacecraft(rng)
        whole = np.block([[a, b], [np.zeros((1, 5))]])  # with a disturbance of the effort
        seen = np.eye(5)[[0, 2]]
        names = (*NAMES, "disturbance")
        x = 10.0 ** rng.uniform(-2.0, 2.0, 5)
        x[4] *= 10.0 ** rng.uniform(-12.0, 12.0)
        rate = 10.0 ** rng.uniform(-5.0, 5.0)
        scaled = rate * whole * x / x[:, None]
        inputs = b * 10.0 ** rng.uniform(-10.0, 10.0) / x[:4, None]
        require_controllable(scaled[:4, :4], inputs, NAMES)
        require_observable(scaled, seen * x * 10.0 ** rng.uniform(-10.0, 10.0, (2, 1)), names)
        alone = scaled.copy()
        alone[2, [1, 3]] = 0.0  # the mode does not move the joint
        with pytest.raises(BadInput, match=r"not observable: .* mostly in mode"):
            require_observable(alone, seen * x, names)
        alone[3, [0, 2, 4]] = 0.0
        inputs[3] = 0.0
        with pytest.raises(BadInput, match="not controllable"):
            require_controllable(alone[:4, :4], inputs, NAMES)
