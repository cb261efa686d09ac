"""A linear system as keys of a trial: A, B, C and D with the names of its signals."""

from typing import TypeAlias

import numpy as np

from flexslew_plant.arrays import Matrix
from flexslew_plant.errors import BadInput
from flexslew_plant.settings import NonNegative, section

Rows: TypeAlias = tuple[tuple[float, ...], ...]


@section
class StateSpace:
    """A linear system; a file of MATLAB calls the keys A, B, C, D and Ts."""

    a: Rows = ()  # A, rows of numbers; none: gains alone
    b: Rows = ()  # B
    c: Rows = ()  # C
    d: Rows | None = None  # D; null: zero
    period: NonNegative = 0.0  # Ts [s], of the samples; 0: continuous
    # signals; none: of a law `error.JOINT` of every joint, then `error_rate.JOINT`; of a plant
    # `effort.joint_1`, `effort.joint_2`, ...
    inputs: tuple[str, ...] = ()
    # none: of a law `effort.JOINT` of every joint; of a plant `position.JOINT` of every joint, then
    # `rate.JOINT`
    outputs: tuple[str, ...] = ()


def matrices(given: StateSpace, k: int, m: int) -> tuple[Matrix, Matrix, Matrix, Matrix]:
    """Return A, B, C and D for k inputs and m outputs, checked for their shape.

    Raises:
        BadInput: if a matrix has another shape.
    """
    n = len(given.a)
    found = []
    shapes = {"a": (n, n), "b": (n, k), "c": (m, n), "d": (m, k)}
    for name, shape in shapes.items():
        rows = getattr(given, name)
        if not rows and (0 in shape or name == "d"):
            found.append(np.zeros(shape))
            continue
        if len(rows) != shape[0] or any(len(row) != shape[1] for row in rows):
            raise BadInput(
                f"system.{name}: give {shape[0]} rows of {shape[1]} numbers, for {n} states, "
                f"{k} inputs and {m} outputs"
            )
        found.append(np.array(rows, dtype=np.float64).reshape(shape))
    return found[0], found[1], found[2], found[3]
