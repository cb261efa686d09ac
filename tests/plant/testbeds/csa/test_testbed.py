from functools import lru_cache
from typing import Any

import numpy as np
import pytest
import sympy as sp

from flexslew_plant.testbeds.csa import CsaParameters, CsaTestbed, beam

VARIANTS = ("printed", "complete")
MODES = 2  # of the symbolic derivation


def model_of(variant: Any, modes: int = 3, **more: Any) -> Any:
    return CsaTestbed(variant=variant, modes=modes, **more).model()


def random_state(seed: Any, modes: int = 3) -> Any:
    rng = np.random.default_rng(seed)
    joints, rates = rng.uniform(-1.4, 1.4, 2), rng.normal(0.0, 0.3, 2)
    return np.concatenate((joints, rng.normal(0.0, 0.5, modes), rates, rng.normal(0.0, 0.4, modes)))


@lru_cache
def derived(variant: Any) -> Any:
    """Return M(q) and h(q, v) as functions of the symbols, by Lagrange from T and U.

    T is the integral of the velocity of the points (xi, y, 0) of the beams, pitched and then
    yawed, to first order in the bend but for its own rate squared.
    """
    t = sp.Symbol("t")
    xi, m, m_qq = sp.Symbol("xi"), sp.symbols(f"m:{MODES}"), sp.symbols(f"M:{MODES}")
    k_qq = sp.symbols(f"k:{MODES}")
    j_1, i_2, j_a = sp.symbols("J_1 I_2 J_a")
    q = [sp.Function(name)(t) for name in ("theta", "psi", *(f"q{j}" for j in range(MODES)))]
    theta, psi, bend = q[0], q[1], q[2:]
    y = sp.Function("y")(t)
    yaw = sp.Matrix(
        [[sp.cos(theta), -sp.sin(theta), 0], [sp.sin(theta), sp.cos(theta), 0], [0, 0, 1]]
    )
    pitch = sp.Matrix([[sp.cos(psi), 0, sp.sin(psi)], [0, 1, 0], [-sp.sin(psi), 0, sp.cos(psi)]])
    v = (yaw * pitch * sp.Matrix([xi, y, 0])).diff(t)
    y0, y1 = sp.symbols("y0 y1")
    square = sp.expand(sp.simplify((v.T * v)[0].subs(y.diff(t), y1).subs(y, y0)))
    square = square.subs(y0**2, 0)  # second order in the bend
    if variant == "printed":  # (1) leaves out what is left of y
        square = square.subs(y0, 0)
    sway = sum(a * b for a, b in zip(m, bend, strict=True))
    # 2 mu times the integrals of xi^2, xi y, xi y' and y'^2 over one beam are (4)-(6)
    modal = sum(a * b.diff(t) ** 2 for a, b in zip(m_qq, bend, strict=True))
    integrals = {xi**2: j_a, xi * y0: sway, xi * y1: sway.diff(t), y1**2: modal}
    polynomial = sp.Poly(square, xi, y0, y1)
    kinetic = sp.Rational(1, 2) * sum(
        coefficient * integrals[xi**a * y0**b * y1**c]
        for (a, b, c), coefficient in polynomial.terms()
    )
    kinetic += sp.Rational(1, 2) * (j_1 * theta.diff(t) ** 2 + i_2 * psi.diff(t) ** 2)
    potential = sp.Rational(1, 2) * sum(k * b**2 for k, b in zip(k_qq, bend, strict=True))
    rates = [c.diff(t) for c in q]
    momenta = [kinetic.diff(r) for r in rates]
    flat = dict(zip((*rates, *q), sp.symbols(f"v:{len(q)} x:{len(q)}"), strict=True))
    flat_rates, flat_q = list(flat.values())[: len(q)], list(flat.values())[len(q) :]
    mass = sp.Matrix([[p.diff(r) for r in rates] for p in momenta]).subs(flat)
    force = [
        sum(p.diff(c) * r for c, r in zip(q, rates, strict=True)) - (kinetic - potential).diff(own)
        for p, own in zip(momenta, q, strict=True)
    ]
    bias = sp.Matrix(force).subs(flat)
    constants = [j_1, i_2, j_a, *m, *m_qq, *k_qq]
    return sp.lambdify([constants, flat_q, flat_rates], (mass, bias[:, 0]), "numpy")


def symbolic(variant: Any, q: Any, v: Any) -> tuple[Any, Any]:
    p, b = CsaParameters(), beam(CsaTestbed(modes=MODES))
    mu, a = p.linear_density, p.hub_radius
    j_a = 2.0 * mu * ((p.length + a) ** 3 - a**3) / 3.0
    m = 2.0 * mu * (b.integral(1, 1, 0) + a * b.integral(0, 1, 0))
    m_qq = np.full(MODES, 2.0 * mu * p.length / 4.0)
    constants = [p.base_inertia + p.hub_inertia_1, p.hub_inertia_2, j_a, *m, *m_qq,
                 *(m_qq * b.frequencies**2)]  # fmt: skip
    mass, bias = derived(variant)(constants, q, v)
    return np.array(mass, dtype=float), np.array(bias, dtype=float).ravel()


@pytest.mark.parametrize("variant", VARIANTS)
@pytest.mark.parametrize("seed", range(5))
def test_mass_matrix_and_bias_follow_from_lagrange(variant: Any, seed: Any) -> None:
    q, v = np.split(random_state(seed, MODES), 2)
    model = model_of(variant, MODES)
    mass, bias = symbolic(variant, q, v)
    np.testing.assert_allclose(model.mass_matrix(q), mass, rtol=1e-12, atol=1e-9)
    np.testing.assert_allclose(model.bias(q, v), bias, rtol=1e-11, atol=1e-9)


def test_the_variants_differ_only_by_the_term_left_out() -> None:
    q, v = np.split(random_state(3), 2)
    printed, complete = (model_of(variant) for variant in VARIANTS)
    sway = complete.mass_matrix(np.zeros(5))[0, 2:] @ q[2:]
    gained = np.sin(q[1]) * v[0] * v[1] * sway
    kinetic = [model.kinetic_energy(np.concatenate((q, v))) for model in (printed, complete)]
    assert kinetic[1] - kinetic[0] == pytest.approx(gained, rel=1e-10)


@pytest.mark.parametrize("variant", VARIANTS)
def test_energy_and_yaw_momentum_stay_over_100_seconds_of_ticks(variant: Any) -> None:
    model, free = model_of(variant), np.zeros(2)
    x = np.array([0.1, 0.3, 0.5, 0.02, -0.01, 0.2, -0.1, 0.1, 0.05, 0.02])
    energy, momentum = model.energy(x), model.momentum(x)[0]
    largest = 0.0
    for _ in range(100):
        for _ in range(100):
            x = model.advance(x, free, 0.01)
        largest = max(largest, abs(model.energy(x) / energy - 1.0))
        assert model.momentum(x)[0] == pytest.approx(momentum, rel=1e-9)
    assert largest < 1e-9


def test_damping_takes_energy_at_the_modal_rate() -> None:
    free, damped = (model_of("complete", 1, damping_ratio=zeta) for zeta in (0.0, 0.01))
    np.testing.assert_array_equal(free.packed[:-1], damped.packed[:-1])
    linear = damped.linearise(np.zeros(3))
    mass, stiffness = linear.mass[2, 2], linear.stiffness[2, 2]
    assert linear.damping[2, 2] == pytest.approx(0.02 * np.sqrt(mass * stiffness), rel=1e-12)


@pytest.mark.parametrize("variant", VARIANTS)
@pytest.mark.parametrize("modes", [1, 3])
def test_jacobian_is_the_limit_of_differences(variant: Any, modes: int) -> None:
    model = model_of(variant, modes, damping_ratio=0.01)
    x, effort, h = random_state(7, modes), np.array([20.0, -40.0]), 1e-6
    dx, du = model.jacobian(x, effort)
    for j, unit in enumerate(np.eye(x.size)):
        ahead, behind = (model.derivative(x + s * unit, effort) for s in (h, -h))
        np.testing.assert_allclose(dx[:, j], (ahead - behind) / (2.0 * h), atol=2e-8)
    for j, unit in enumerate(np.eye(2)):
        rise = model.derivative(x, effort + unit) - model.derivative(x, effort)
        np.testing.assert_allclose(du[:, j], rise, atol=1e-13)


def test_both_variants_have_the_same_linear_motions() -> None:
    rest = np.array([0.2, 0.7, 0.0, 0.0, 0.0])
    printed, complete = (model_of(variant).linearise(rest) for variant in VARIANTS)
    np.testing.assert_array_equal(complete.mass, printed.mass)
    np.testing.assert_array_equal(complete.stiffness, printed.stiffness)
