"""Slopes of flights by parameters: a closed form, and differences of whole flights."""

from itertools import pairwise
from typing import Any

import numpy as np
import pytest
from tests.lab.identification.shaken import bench
from tests.representatives import representatives

from flexslew_lab.identification.flights import FlightSimulation
from flexslew_lab.identification.records.record import Output, Quantity, Record
from flexslew_lab.trial.sources import read_trial
from flexslew_plant.arrays import Matrix, Vector
from flexslew_plant.settings import flat, plain

PERIOD = 0.01


def flights(testbed: Any, keys: tuple[str, ...], effort: Matrix) -> tuple[FlightSimulation, Vector]:
    """Return flights of a testbed under efforts, and the logarithms of its parameters."""
    model = testbed.model()
    joints = model.joint_names
    outputs = (
        *(Output(f"position.{n}", "rad", Quantity.JOINT_POSITION, n) for n in joints),
        *(Output(f"rate.{n}", "rad/s", Quantity.JOINT_RATE, n) for n in joints),
        *(Output(f"tip.{a}", "m", Quantity.DEFLECTION) for a in model.appendages.names),
    )
    still, limits = np.zeros((len(effort) + 1, len(outputs))), np.full(len(joints), np.inf)
    record = Record(PERIOD, effort, still, joints, outputs, "here", limits)
    known = flat(plain(testbed))
    return FlightSimulation(record, testbed, keys), np.log([known[key] for key in keys])


def test_the_slope_of_two_masses_by_their_spring_is_the_closed_form() -> None:
    """x = u t^2 / 2 M + m_2 / M r,  r = u / (m_1 w^2) (1 - cos w t),  w^2 = k (1/m_1 + 1/m_2)."""
    m, m_2, k, u = 1.3, 0.7, 2.1, 0.4
    masses = {"driven_mass": m, "free_mass": m_2, "stiffness": k}
    testbed = bench(kind="floating_oscillator", parameters=masses)
    problem, values = flights(testbed, ("parameters.stiffness",), np.full((2000, 1), u))
    (slope,) = problem.sensitivities(values)
    t, w = PERIOD * np.arange(2001), np.sqrt(k * (1.0 / m + 1.0 / m_2))
    swung = u / m * (0.5 * t * np.sin(w * t) / w - (1.0 - np.cos(w * t)) / w**2)
    expected = m_2 / (m + m_2) * swung
    # rounding of 2000 steps; differences of flights by 1e-5 are off by 1e-9
    np.testing.assert_allclose(slope[:, 0], expected, atol=2e-12 * np.abs(expected).max())


CRAFT = "own_spacecraft"
# largest effort of each that slews it by a radian or more [N m or N]
CASES: dict[str, tuple[str, float]] = {
    "csa parameters.bending_stiffness": ("csa", 60.0),
    "csa parameters.hub_radius": ("csa", 60.0),
    "csa damping_ratio": ("csa", 60.0),
    "hub_with_appendages parameters.length": ("hub_with_appendages", 2.0),
    "varying_oscillator parameters.stiffness_swing": ("varying_oscillator", 50.0),
    "own_spacecraft platform.inertia.xx": (CRAFT, 0.4),
    "own_spacecraft appendages.left.stiffness": (CRAFT, 0.4),
}


@pytest.mark.parametrize(
    "case",
    representatives(
        CASES, "csa parameters.bending_stiffness", "own_spacecraft appendages.left.stiffness"
    ),
)
def test_slopes_are_the_limit_of_differences_of_flights(case: str) -> None:
    """Of large motions: joints turn by a radian, where nothing is linear."""
    kind, largest = CASES[case]
    key = case.partition(" ")[2]
    if kind == CRAFT:
        testbed: Any = read_trial(CRAFT, None)[0].testbed
    else:
        testbed = bench(kind=kind, damping_ratio=0.005)
    model, rng = testbed.model(), np.random.default_rng(len(case))
    effort = np.cumsum(rng.standard_normal((400, model.efforts)), axis=0)
    problem, values = flights(testbed, (key,), largest * effort / np.abs(effort).max())
    (slope,) = problem.sensitivities(values)

    def difference(h: float) -> Matrix:
        return np.asarray((problem.simulate(values + h) - problem.simulate(values - h)) / (2.0 * h))

    # Romberg's table: of order 6, with rounding of 1e-13 in flights divided by the least step
    rows = [difference(h) for h in (4e-3, 2e-3, 1e-3)]
    rows = [(4.0 * b - a) / 3.0 for a, b in pairwise(rows)]
    limit = (16.0 * rows[1] - rows[0]) / 15.0
    moves = np.abs(problem.simulate(values)).max(axis=0)
    assert (np.abs(slope - limit) <= 1e-9 * np.abs(limit).max(axis=0) + 1e-11 * moves).all()
    assert (np.abs(slope).max(axis=0) > 1e-6 * moves).any()
