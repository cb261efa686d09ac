"""Controllers of fixed order for plants in standard form, as HIFOO designs them."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from flexslew_lab.tuning.closed_loop import PerformancePlant
from flexslew_lab.tuning.descent import Minimum, minimise
from flexslew_lab.tuning.norms import Measure, Norm, h_infinity, stability
from flexslew_plant.arrays import Matrix, Vector
from flexslew_plant.errors import BadInput

_STABILISING = 500  # evaluations of the growth rate from each start


@dataclass(frozen=True)
class FixedOrderDesign:
    """A controller of fixed order.

    Args:
        matrix: [[D, C], [B, A]] from (y, x) to (u, x+).
        order: number of its states.
        value: the largest norm over all plants.
        frequency: where it is [rad/s]; nan: no one frequency.
        starts: what each start reached; inf: no stable loop.
        optimality: see Minimum.
    """

    matrix: Matrix
    order: int
    value: float
    frequency: float
    starts: tuple[float, ...]
    optimality: float

    @property
    def parts(self) -> tuple[Matrix, Matrix, Matrix, Matrix]:
        """A, B, C and D of the controller u = C x + D y."""
        n, m = self.order, len(self.matrix) - self.order
        p = self.matrix.shape[1] - n
        return self.matrix[m:, p:], self.matrix[m:, :p], self.matrix[:m, p:], self.matrix[:m, :p]


def worst(plants: Sequence[PerformancePlant], norm: Norm, k: Matrix) -> tuple[Measure, Matrix]:
    """Return the largest measure over plants with a controller, and its gradient in K."""
    loops = [plant.closed(k) for plant in plants]
    found = [norm(loop) for loop in loops]
    which = int(np.argmax([measure.value for measure in found]))
    return found[which], loops[which].gradient(found[which].gradient)


def design_fixed_order(
    plants: Sequence[PerformancePlant],
    order: int = 0,
    norm: Norm = h_infinity,
    starts: int = 6,
    seed: int = 1,
    evaluations: int = 2000,
    direct: bool = True,
) -> FixedOrderDesign:
    """Return the controller of an order with the smallest norm from w to z, over all plants.

    Args:
        plants: with the same u and y.
        order: of the controller.
        norm: that is minimised.
        starts: random ones; the best result counts.
        seed: of the starts and of the sampled gradients.
        evaluations: of the norm from each start.
        direct: whether the controller has a direct path D; without one the H2 norm of a continuous
            loop is finite.

    Raises:
        BadInput: if no start leads to a stable loop.
    """
    extended = [plant.extended(order) for plant in plants]
    free = np.ones((extended[0].controls, extended[0].measurements), dtype=bool)
    free[: plants[0].controls, : plants[0].measurements] = direct
    best: Minimum | None = None
    values = []
    for number in range(starts):
        rng = np.random.default_rng((seed, number))
        growth = _flat(extended, stability, free)
        start = stabilised(growth, rng.standard_normal(int(free.sum())))
        if start is None:
            values.append(np.inf)
            continue
        found = minimise(_flat(extended, norm, free), start, evaluations, rng=rng)
        values.append(found.value)
        if best is None or found.value < best.value:
            best = found
    if best is None or not np.isfinite(best.value):
        raise BadInput(f"no stable loop with a controller of order {order} from {starts} starts")
    matrix = _placed(best.x, free)
    measure, _ = worst(extended, norm, matrix)
    return FixedOrderDesign(
        matrix, order, measure.value, measure.frequency, tuple(values), best.optimality
    )


def stabilised(growth: Callable[[Vector], tuple[float, Vector]], start: Vector) -> Vector | None:
    """Return parameters from which the growth rate is negative, or None.

    Args:
        growth: largest growth rate [1/s] and its gradient.
        start: shape (parameters,).
    """
    found = minimise(growth, start, _STABILISING, 0.0)
    return found.x if found.value < 0.0 else None


def _placed(x: Vector, free: NDArray[np.bool_]) -> Matrix:
    matrix = np.zeros(free.shape)
    matrix[free] = x
    return matrix


def _flat(
    plants: Sequence[PerformancePlant], norm: Norm, free: NDArray[np.bool_]
) -> Callable[[Vector], tuple[float, Vector]]:
    def function(x: Vector) -> tuple[float, Vector]:
        measure, gradient = worst(plants, norm, _placed(x, free))
        return measure.value, gradient[free]

    return function
