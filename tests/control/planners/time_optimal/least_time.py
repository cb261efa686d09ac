"""The least time of a slew of a linear model by linear programmes, for comparison.

The effort is constant on N equal intervals; the smallest largest effort that brings the model to
rest at the goal in a time T is a linear programme, and T is the least where that is the amplitude.
"""

import numpy as np
from scipy.linalg import expm
from scipy.optimize import linprog
from tests.present import present

from flexslew_plant.arrays import Vector
from flexslew_plant.testbeds.model import Model

_INTERVALS = 400


def least_time(model: Model, distance: float, amplitude: float, nothing: float) -> float:
    """Return the least time of a slew of joint 0 from rest to rest [s].

    Args:
        model: linearised at zero; joint 0 is driven.
        distance: how far it goes [rad].
        amplitude: largest effort [N m].
        nothing: how far each tip may still swing [m].
    """
    linear = model.linearise(model.rest({}))
    inertia = float(linear.mass[0, 0])
    rigid = 2.0 * np.sqrt(abs(distance) * inertia / amplitude)
    low, high = rigid, rigid + 2.0 * np.pi / float(linear.frequencies[0])
    while _needed(model, distance, high, nothing) > amplitude:
        low, high = high, 1.5 * high
    while high - low > 5e-4 * low:
        middle = 0.5 * (low + high)
        if _needed(model, distance, middle, nothing) > amplitude:
            low = middle
        else:
            high = middle
    return float(high)


def _needed(model: Model, distance: float, duration: float, nothing: float) -> float:
    """Return the smallest largest effort of a slew in a duration [N m]."""
    linear = model.linearise(model.rest({}))
    a, b = linear.state_matrix, linear.state_input_matrix[:, :1]
    size, step = len(a), duration / _INTERVALS
    held = expm(np.block([[a, b], [np.zeros((1, size + 1))]]) * step)
    ahead, column = held[:size, :size], held[:size, size]
    columns = np.empty((size, _INTERVALS))
    for k in range(_INTERVALS - 1, -1, -1):
        columns[:, k] = column
        column = ahead @ column
    goal = np.zeros(size)
    goal[0] = distance
    n = size // 2
    tip = np.abs(model.appendages.tip).max(axis=0)
    fastest = float(linear.frequencies[-1])
    room: Vector = np.concatenate(
        ([1e-9], nothing / tip, [1e-9], nothing * fastest * np.ones(n - 1) / tip)
    )
    scale = 1.0 / np.abs(columns).max(axis=1).clip(room)
    rows = columns * scale[:, None]
    with_largest = np.hstack((rows, np.zeros((size, 1))))
    bound = np.hstack((np.eye(_INTERVALS), -np.ones((_INTERVALS, 1))))
    other = np.hstack((-np.eye(_INTERVALS), -np.ones((_INTERVALS, 1))))
    found = linprog(
        np.append(np.zeros(_INTERVALS), 1.0),
        A_ub=np.vstack((with_largest, -with_largest, bound, other)),
        b_ub=np.concatenate(
            ((goal + room) * scale, -(goal - room) * scale, np.zeros(2 * _INTERVALS))
        ),
        bounds=[(None, None)] * _INTERVALS + [(0.0, None)],
        method="highs",
    )
    return present(found.fun) if found.success else np.inf
