"""Prescribed hinge motions: their rates are the derivatives of their angles."""

import numpy as np
import pytest
from tests.plant.testbeds.spacecraft.crafts import random_axes, random_points

from flexslew_plant.arrays import Matrix, Vector
from flexslew_plant.testbeds.spacecraft.assembly.bodies import rotation_matrix
from flexslew_plant.testbeds.spacecraft.assembly.craft import (
    Appendage,
    PrescribedRotation,
    Spacecraft,
)
from flexslew_plant.testbeds.spacecraft.assembly.packing import packed
from flexslew_plant.testbeds.spacecraft.equations import layout as at
from flexslew_plant.testbeds.spacecraft.equations.hinge_motion import prescribed
from flexslew_plant.testbeds.spacecraft.shapes.integrals import integrals_of

TABLE = np.array([[0.0, 0, 0, 0], [0.3, 0.2, 1.4, 2.0], [0.6, 0.7, 1.5, -1.0], [1, 1, 0, 0]])


def turning(axes: Matrix, *motions: PrescribedRotation) -> tuple[Vector, int]:
    """Return a packed platform with a rigid appendage that turns, and where its block begins."""
    i, none = integrals_of(random_points(np.random.default_rng(1), 0)), np.zeros(0)
    a = Appendage("a", i, none, none, np.zeros((0, 0)), np.zeros(3), axes, at.PRESCRIBED,
                  manoeuvres=motions)  # fmt: skip
    p = packed(Spacecraft(1.0, np.zeros(3), np.eye(3), (a,)))
    return p, int(p[int(p[at.APPENDAGE_TABLE])])


def test_the_rates_of_every_profile_are_derivatives_of_the_direction_cosines() -> None:
    rng = np.random.default_rng(0)
    axes, motions, begin = random_axes(rng), [], 0.3
    for profile in (at.SMOOTH, at.BANG_BANG, at.TABLE):
        axis = rng.standard_normal(3)
        motions.append(
            PrescribedRotation(begin, 1.7, 0.9, axis / np.linalg.norm(axis), profile, TABLE)
        )
        begin += 2.0
    p, block = turning(axes, *motions)

    def cosines(t: float) -> np.ndarray:
        return np.array(prescribed(p, block, t)[0]).reshape(3, 3)

    h = 1e-5
    for t in (0.1, 0.5, 1.3, 2.5, 3.6, 4.5, 5.0, 5.6, 7.0):
        e, rate, acceleration = (np.array(v) for v in prescribed(p, block, t))
        e = e.reshape(3, 3)
        slope = (cosines(t + h) - cosines(t - h)) / (2 * h)
        x, y, z = rate
        skew = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
        np.testing.assert_allclose(slope, -skew @ e, atol=1e-8)  # E' = -w_e~ E
        after, before = (np.array(prescribed(p, block, s)[1]) for s in (t + h, t - h))
        np.testing.assert_allclose((after - before) / (2 * h), acceleration, atol=1e-7)
    end = axes
    for m in motions:
        end = rotation_matrix(m.axis, m.angle) @ end
    np.testing.assert_allclose(cosines(10.0), end, atol=1e-14)


@pytest.mark.parametrize("profile", [at.SMOOTH, at.BANG_BANG])
def test_the_profiles_peak_accelerations(profile: int) -> None:
    # smooth: beta'' = (2 pi theta / T^2) sin(2 pi t / T); bang-bang: 4 theta / T^2
    m = PrescribedRotation(0.0, 3.0, 1.5, np.array([1.0, 0, 0]), profile)
    p, block = turning(np.eye(3), m)
    peak = {at.SMOOTH: 2 * np.pi * 1.5 / 9.0, at.BANG_BANG: 4 * 1.5 / 9.0}[profile]
    np.testing.assert_allclose(prescribed(p, block, 0.75)[2], [peak, 0, 0], rtol=1e-12)
