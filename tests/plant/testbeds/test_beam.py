import numpy as np
import pytest

from flexslew_plant.testbeds.beam import ClampedFreeBeam, wave_numbers

BEAM = ClampedFreeBeam(length=30.0, linear_density=0.2, bending_stiffness=1500.0, modes=6)
CLAMP, TIP = np.array([0.0]), np.array([30.0])


def test_wave_numbers_solve_the_frequency_equation() -> None:
    b = np.array(wave_numbers(8))
    np.testing.assert_allclose(b[:3], [1.87510407, 4.69409113, 7.85475744], atol=5e-9)
    np.testing.assert_allclose(np.cos(b) * np.cosh(b), -1.0, atol=1e-13 * np.cosh(b[-1]) * b[-1])


def test_the_clamped_end_neither_moves_nor_turns() -> None:
    np.testing.assert_allclose(BEAM.shape(CLAMP), 0.0, atol=1e-14)
    np.testing.assert_allclose(BEAM.shape(CLAMP, derivative=1), 0.0, atol=1e-14)


def test_the_free_end_bears_no_moment_and_no_shear() -> None:
    b = np.array(wave_numbers(6))[:, None] / 30.0
    assert np.abs(BEAM.shape(TIP, derivative=2) / b**2).max() < 1e-13
    assert np.abs(BEAM.shape(TIP, derivative=3) / b**3).max() < 1e-13


def test_every_shape_is_one_at_the_tip() -> None:
    np.testing.assert_allclose(BEAM.shape(TIP), 1.0, rtol=1e-13)


@pytest.mark.parametrize("derivative", [1, 2, 3])
def test_derivatives_are_those_of_the_shapes(derivative: int) -> None:
    s, h = np.linspace(1.0, 29.0, 15), 1e-4
    ahead, behind = (BEAM.shape(s + d, derivative - 1) for d in (h, -h))
    np.testing.assert_allclose(
        (ahead - behind) / (2.0 * h), BEAM.shape(s, derivative), atol=1e-7, rtol=1e-6
    )


def test_shapes_are_orthogonal_and_their_squares_are_a_quarter_of_the_length() -> None:
    s, w = np.polynomial.legendre.leggauss(60)
    at = 15.0 * (s + 1.0)
    gram = (BEAM.shape(at) * (15.0 * w)) @ BEAM.shape(at).T
    np.testing.assert_allclose(gram, 7.5 * np.eye(6), atol=1e-11)
    np.testing.assert_allclose(BEAM.integral(0, 2, 0), 7.5, rtol=1e-12)


def test_first_moments_are_the_closed_form() -> None:
    # twice by parts of phi = phi'''' / b^4: integral of s phi = phi''(0) / b^4
    b = np.array(wave_numbers(6)) / 30.0
    expected = BEAM.shape(CLAMP, derivative=2)[:, 0] / b**4
    np.testing.assert_allclose(BEAM.integral(1, 1, 0), expected, rtol=1e-11)


def test_stiffness_over_mass_is_the_frequency_squared() -> None:
    stiffness = 1500.0 * BEAM.integral(0, 2, 2)
    mass = 0.2 * BEAM.integral(0, 2, 0)
    np.testing.assert_allclose(stiffness / mass, BEAM.frequencies**2, rtol=1e-11)


def test_twelve_modes_lose_no_digits() -> None:
    many = ClampedFreeBeam(30.0, 0.2, 1500.0, 12)
    np.testing.assert_allclose(many.shape(TIP), 1.0, rtol=1e-12)
    np.testing.assert_allclose(many.integral(0, 2, 0), 7.5, rtol=1e-11)
