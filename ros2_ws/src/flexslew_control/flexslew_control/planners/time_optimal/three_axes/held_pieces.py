"""A flight with efforts held over pieces: the states between them, and their slopes."""

from typing import NamedTuple

import numpy as np

from flexslew_plant.arrays import Indices, Matrix, Tensor, Vector
from flexslew_plant.testbeds.model import Model


class Pieces(NamedTuple):
    """A flight over k pieces."""

    states: Matrix  # at their ends, (k + 1, size)
    by_state: Tensor  # of each end by its begin, (k, size, size); zero but in requested columns
    by_effort: Tensor  # of each end by its effort, (k, size, efforts)


def simulate_pieces(
    model: Model,
    start: Vector,
    efforts: Matrix,
    durations: Vector,
    step: float,
    columns: Indices | None = None,
) -> Pieces:
    """Return the flight with efforts held over pieces.

    Args:
        model: equations of motion, the same at all times.
        start: state [q, v].
        efforts: of the pieces, shape (k, efforts) [N m or N].
        durations: shape (k,) [s].
        step: longest one of the integration [s].
        columns: by which entries of the state derivatives are taken; None: all.
    """
    steps = np.maximum(1, np.ceil(abs(durations) / step)).astype(np.int64)
    states, t = np.empty((len(efforts) + 1, start.size)), 0.0
    states[0] = start
    for k, (duration, count) in enumerate(zip(durations.tolist(), steps.tolist(), strict=True)):
        states[k + 1] = model.advance(states[k], efforts[k], duration, count, t)
        t += duration
    slopes = model.slopes_of_pieces(states[:-1], efforts, durations, steps, columns)
    return Pieces(states, *slopes)
