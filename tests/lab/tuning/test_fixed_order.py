"""Controllers of fixed order reach published norms, those of full order the Riccati equations'."""

import numpy as np
import pytest
from scipy.linalg import solve_continuous_are
from tests.lab.tuning import plants

from flexslew_lab.tuning.closed_loop import PerformancePlant
from flexslew_lab.tuning.fixed_order import design_fixed_order
from flexslew_lab.tuning.norms import h_infinity, h_two, stability
from flexslew_plant.errors import BadInput

ctrlsys = pytest.importorskip("ctrlsys")


@pytest.mark.parametrize(
    ("plant", "published"),
    [(plants.ac8(), 2.005), (plants.he1(), 0.1538), (plants.rea2(), 1.149)],
    ids=["AC8", "HE1", "REA2"],
)
def test_static_output_feedback_reaches_the_norm_of_hifoo(
    plant: PerformancePlant, published: float
) -> None:
    found = design_fixed_order([plant], starts=4)
    assert found.value == pytest.approx(published, rel=0.01)
    loop = plant.closed(found.matrix)
    a, b, c, d = loop.parts
    assert np.linalg.eigvals(a).real.max() < 0.0
    w = np.concatenate(([0.0], np.geomspace(1e-4, 1e4, 20_000)))
    inverse = np.linalg.solve(1j * w[:, None, None] * np.eye(len(a)) - a, b)
    sizes = np.linalg.norm(c @ inverse + d, 2, axis=(1, 2))
    assert sizes.max() <= found.value * (1.0 + 1e-9)
    assert sizes.max() >= found.value * (1.0 - 1e-3)


def test_a_higher_order_comes_nearer_to_the_optimum_of_all_orders() -> None:
    plant = plants.ac8()
    rows, columns = plant.d.shape
    parts = [np.asfortranarray(part) for part in (plant.a, plant.b, plant.c, plant.d)]
    found = ctrlsys.sb10ad(1, 9, columns, rows, 1, 5, *parts, 2.1, 1e-6, 0.0)
    assert not found[-1]
    optimum = found[8]
    assert optimum == pytest.approx(1.62, rel=0.01)  # also printed for HIFOO, of full order
    values = [design_fixed_order([plant], order, starts=2).value for order in (0, 1)]
    assert optimum < values[1] < values[0]
    assert values[1] < 1.08 * optimum


def test_full_order_reaches_the_smallest_h2_norm_of_the_riccati_equations() -> None:
    """A noisy plant of second order, whose optimum of all orders is a filter and a regulator."""
    a, b = np.array([[0.0, 1.0], [1.0, -0.2]]), np.array([[0.0], [1.0]])
    seen, eye = np.array([[1.0, 0.0]]), np.eye(1)
    plant = PerformancePlant(
        a, np.hstack((b, 0.0 * b, b)), np.vstack((seen, 0.0 * seen, seen)),
        np.array([[0.0, 0.0, 0.0], [0.0, 0.0, 1.0], [0.0, 1.0, 0.0]]), 1, 1,
    )  # fmt: skip
    regulator = b.T @ solve_continuous_are(a, b, seen.T @ seen, eye)
    gain = solve_continuous_are(a.T, seen.T, b @ b.T, eye) @ seen.T
    k = np.block([[np.zeros((1, 1)), -regulator], [gain, a - b @ regulator - gain @ seen]])
    smallest = h_two(plant.extended(2).closed(k)).value
    found = design_fixed_order([plant], 2, h_two, starts=3, direct=False)
    assert smallest * (1.0 - 1e-6) <= found.value < 1.01 * smallest


def test_one_controller_serves_two_plants() -> None:
    plant = plants.he1()
    other = PerformancePlant(1.2 * plant.a, plant.b, plant.c, plant.d, 2, 1)
    both = design_fixed_order([plant, other], starts=2)
    assert both.value > 0.99 * 0.1538  # the norm of HIFOO for one of them alone
    for one in (plant, other):
        loop = one.closed(both.matrix)
        assert stability(loop).value < 0.0
        assert h_infinity(loop).value <= both.value * (1.0 + 1e-9)


def test_a_plant_that_no_controller_stabilises_is_refused() -> None:
    plant = PerformancePlant(
        np.diag([1.0, -1.0]), np.array([[1.0, 0.0], [0.0, 1.0]]),
        np.array([[1.0, 1.0], [0.0, 1.0]]), np.zeros((2, 2)), 1, 1,
    )  # fmt: skip
    with pytest.raises(BadInput, match="no stable loop with a controller of order 0 from 2 starts"):
        design_fixed_order([plant], starts=2)
