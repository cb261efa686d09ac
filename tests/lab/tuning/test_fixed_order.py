"""Controllers of fixed order reach published norms, those of full order the Riccati equations'."""

import numpy as np
import pytest
from scipy.linalg import solve_continuous_are
from tests.lab.tuning import plants

from flexslew_lab.tuning.closed_loop import PerformancePlant
from flexslew_lab.tuning.descent import minimise, stabilised
from flexslew_lab.tuning.norms import Norm, h_infinity, h_two, stability
from flexslew_plant.arrays import Matrix, Vector

ctrlsys = pytest.importorskip("ctrlsys")


def designed(
    plants: list[PerformancePlant], order: int = 0, norm: Norm = h_infinity, starts: int = 2,
    direct: bool = True,
) -> tuple[float, Matrix]:  # fmt: skip
    """Return the smallest norm over all plants and the controller [[D, C], [B, A]], as HIFOO does.

    A controller without a direct path leaves the H2 norm of a continuous loop finite.
    """
    extended = [plant.extended(order) for plant in plants]
    free = np.ones((extended[0].controls, extended[0].measurements), dtype=bool)
    free[: plants[0].controls, : plants[0].measurements] = direct

    def matrix(x: Vector) -> Matrix:
        k = np.zeros(free.shape)
        k[free] = x
        return k

    def worst(x: Vector, measure: Norm) -> tuple[float, Vector]:
        loops = [plant.closed(matrix(x)) for plant in extended]
        found = [measure(loop) for loop in loops]
        k = int(np.argmax([one.value for one in found]))
        return found[k].value, loops[k].gradient(found[k].gradient)[free]

    best: tuple[float, Matrix] = np.inf, matrix(np.zeros(int(free.sum())))
    for number in range(starts):
        rng = np.random.default_rng((1, number))
        start = stabilised(lambda x: worst(x, stability), rng.standard_normal(int(free.sum())))
        if start is not None:
            found = minimise(lambda x: worst(x, norm), start, rng=rng)
            best = min(best, (found.value, matrix(found.x)), key=lambda one: one[0])
    return best


@pytest.mark.parametrize(
    ("plant", "published"),
    [(plants.ac8(), 2.005), (plants.he1(), 0.1538), (plants.rea2(), 1.149)],
    ids=["AC8", "HE1", "REA2"],
)
def test_static_output_feedback_reaches_the_norm_of_hifoo(
    plant: PerformancePlant, published: float
) -> None:
    value, k = designed([plant], starts=4)
    assert value == pytest.approx(published, rel=0.01)
    loop = plant.closed(k)
    a, b, c, d = loop.parts
    assert np.linalg.eigvals(a).real.max() < 0.0
    w = np.concatenate(([0.0], np.geomspace(1e-4, 1e4, 20_000)))
    inverse = np.linalg.solve(1j * w[:, None, None] * np.eye(len(a)) - a, b)
    sizes = np.linalg.norm(c @ inverse + d, 2, axis=(1, 2))
    assert sizes.max() <= value * (1.0 + 1e-9)
    assert sizes.max() >= value * (1.0 - 1e-3)


def test_a_higher_order_comes_nearer_to_the_optimum_of_all_orders() -> None:
    plant = plants.ac8()
    rows, columns = plant.d.shape
    parts = [np.asfortranarray(part) for part in (plant.a, plant.b, plant.c, plant.d)]
    found = ctrlsys.sb10ad(1, 9, columns, rows, 1, 5, *parts, 2.1, 1e-6, 0.0)
    assert not found[-1]
    optimum = found[8]
    assert optimum == pytest.approx(1.62, rel=0.01)  # also printed for HIFOO, of full order
    values = [designed([plant], order)[0] for order in (0, 1)]
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
    value, _ = designed([plant], 2, h_two, starts=3, direct=False)
    assert smallest * (1.0 - 1e-6) <= value < 1.01 * smallest


def test_one_controller_serves_two_plants() -> None:
    plant = plants.he1()
    other = PerformancePlant(1.2 * plant.a, plant.b, plant.c, plant.d, 2, 1)
    value, both = designed([plant, other])
    assert value > 0.99 * 0.1538  # the norm of HIFOO for one of them alone
    for one in (plant, other):
        loop = one.closed(both)
        assert stability(loop).value < 0.0
        assert h_infinity(loop).value <= value * (1.0 + 1e-9)


def test_a_plant_that_no_controller_stabilises_has_no_start() -> None:
    plant = PerformancePlant(
        np.diag([1.0, -1.0]), np.array([[1.0, 0.0], [0.0, 1.0]]),
        np.array([[1.0, 1.0], [0.0, 1.0]]), np.zeros((2, 2)), 1, 1,
    )  # fmt: skip
    assert designed([plant])[0] == np.inf
