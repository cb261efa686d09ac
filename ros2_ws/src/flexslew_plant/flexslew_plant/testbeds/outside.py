"""Forces that no effort of a testbed gives, which bench and members alone apply."""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from flexslew_plant.arrays import Vector


class Outside(NamedTuple):
    """Generalised forces as machine code, and the numbers that it reads.

    `add(numbers, x, t, span, force)` adds the forces at the state x at t [s] to `force`, shape
    (n,): their mean from t to t + span, as far as they change fast. The span [s] may be negative.
    Testbeds with one function as `add` may be next to each other where they have equally many
    numbers.
    """

    add: Callable[[Vector, Vector, float, float, Vector], None]
    numbers: Vector
    coordinates: int  # n

    def __call__(self, x: Vector, t: float, span: float) -> Vector:
        """Return the forces, shape (n,)."""
        force = np.zeros(self.coordinates)
        self.add(self.numbers, x, t, span, force)
        return force
