"""A Runge-Kutta-Nystrom scheme: for q'' = f(t, q, q') in fewer stages than for x' = f(t, x)."""

from typing import NamedTuple

import numpy as np

from flexslew_plant.arrays import Matrix, Vector


class Nystrom(NamedTuple):
    """An explicit Runge-Kutta-Nystrom scheme for q'' = f(t, q, q')."""

    of_place: Matrix  # weights h^2 a_ij, the last row those of the result, (stages + 1, stages)
    of_rate: Matrix  # weights h a_ij, likewise
    times: Vector  # (stages,)


# Nystrom's of order 5 (Hairer, Norsett and Wanner (1993), table II.14.2). Where the force reads the
# rates, too, these go by the one scheme of order 4 with the same weights and times.
NYSTROM = Nystrom(
    np.array(
        [
            [0.0, 0.0, 0.0, 0.0],
            [1 / 50, 0.0, 0.0, 0.0],
            [-1 / 27, 7 / 27, 0.0, 0.0],
            [3 / 10, -2 / 35, 9 / 35, 0.0],
            [14 / 336, 100 / 336, 54 / 336, 0.0],
        ]
    ),
    np.array(
        [
            [0.0, 0.0, 0.0, 0.0],
            [1 / 5, 0.0, 0.0, 0.0],
            [-17 / 27, 35 / 27, 0.0, 0.0],
            [13 / 5, -22 / 7, 54 / 35, 0.0],
            [14 / 336, 125 / 336, 162 / 336, 35 / 336],
        ]
    ),
    np.array([0.0, 1 / 5, 2 / 3, 1.0]),
)
