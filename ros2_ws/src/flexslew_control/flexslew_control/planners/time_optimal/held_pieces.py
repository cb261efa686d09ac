"""A flight whose efforts are held over pieces: the states between them, and their slopes.

The slopes are central differences of the bench's own integrator, so they hold for any model, with
quaternions, wheels and modes.
"""

from collections.abc import Callable
from functools import lru_cache
from typing import Any, NamedTuple, cast

import numpy as np
from numba import types

from flexslew_plant.arrays import Indices, Matrix, Tensor, Vector, compiled
from flexslew_plant.testbeds.compiled.bound import ADVANCE
from flexslew_plant.testbeds.model import Model

_CHANGE = 1e-6  # of a state and an effort


class Pieces(NamedTuple):
    """A flight over k pieces."""

    states: Matrix  # at their ends, (k + 1, size)
    by_state: Tensor  # of each end by its begin, (k, size, size); zero but in the columns asked for
    by_effort: Tensor  # of each end by its effort, (k, size, efforts)


def flown_pieces(
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
    which = np.arange(start.size) if columns is None else columns
    return Pieces(
        *_kernel()(
            model.integrate,
            model.packed,
            start,
            np.ascontiguousarray(efforts),
            np.ascontiguousarray(durations),
            step,
            model.before_modes,
            which,
        )
    )


@lru_cache
def _kernel() -> Callable[..., tuple[Matrix, Tensor, Tensor]]:
    """Return _flown as machine code, the same for all testbeds."""
    vector, matrix = types.Array(types.float64, 1, "C"), types.Array(types.float64, 2, "C")
    tensor, places = types.Array(types.float64, 3, "C"), types.Array(types.int64, 1, "C")
    kernel: Any = compiled(_flown)
    found = types.Tuple((matrix, tensor, tensor))
    given = vector, vector, matrix, vector, types.float64, types.int64, places
    kernel.compile(found(ADVANCE, *given))
    kernel.disable_compile()  # never for the type of one testbed's function
    return cast(Callable[..., tuple[Matrix, Tensor, Tensor]], kernel)


def _flown(
    advance: Callable[..., None],
    p: Vector,
    start: Vector,
    efforts: Matrix,
    durations: Vector,
    step: float,
    before_modes: int,
    columns: Indices,
) -> tuple[Matrix, Tensor, Tensor]:
    """Return the states and their slopes; see Pieces."""
    count, m = efforts.shape
    size, t = start.size, 0.0
    states = np.empty((count + 1, size))
    for i in range(size):
        states[0, i] = start[i]
    by_state, by_effort = np.zeros((count, size, size)), np.empty((count, size, m))
    ahead, back, u = np.empty(size), np.empty(size), np.empty(m)
    for k in range(count):
        h = durations[k]
        steps = max(1, int(np.ceil(abs(h) / step)))
        for j in range(m):
            u[j] = efforts[k, j]
        for i in range(size):
            states[k + 1, i] = states[k, i]
        advance(p, t, u, h, steps, before_modes, states[k + 1])
        for j in columns:
            for i in range(size):
                ahead[i] = back[i] = states[k, i]
            ahead[j] += _CHANGE
            back[j] -= _CHANGE
            advance(p, t, u, h, steps, before_modes, ahead)
            advance(p, t, u, h, steps, before_modes, back)
            for i in range(size):
                by_state[k, i, j] = (ahead[i] - back[i]) / (2.0 * _CHANGE)
        for j in range(m):
            for i in range(size):
                ahead[i] = back[i] = states[k, i]
            u[j] = efforts[k, j] + _CHANGE
            advance(p, t, u, h, steps, before_modes, ahead)
            u[j] = efforts[k, j] - _CHANGE
            advance(p, t, u, h, steps, before_modes, back)
            u[j] = efforts[k, j]
            for i in range(size):
                by_effort[k, i, j] = (ahead[i] - back[i]) / (2.0 * _CHANGE)
        t += h
    return states, by_state, by_effort
