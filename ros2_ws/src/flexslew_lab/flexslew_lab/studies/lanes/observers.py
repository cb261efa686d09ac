"""What the laws of all lanes know of their benches, tick by tick: z of linear_form.

z and readings are flat, row after row with LANES neighbours each, as in loop.
"""

from collections.abc import Callable
from functools import lru_cache
from typing import Any, NamedTuple, TypeAlias, cast

import numpy as np

from flexslew_control.estimators.kalman_tick import FilterBelief, kalman_tick
from flexslew_control.linear_form import LinearForm, LinearObserver
from flexslew_plant.arrays import Vector, compiled, vectorised
from flexslew_plant.testbeds.compiled.lanes import LANES
from flexslew_plant.testbeds.kernels import Kernels

# (k, t, dt, constants, Signals, z, memory, filled): takes z to tick k at t [s], at least in the
# first `filled` lanes
Observe: TypeAlias = Callable[..., None]


class LaneSignals(NamedTuple):
    """What an observer is told, flat."""

    y: Vector  # readings of this tick
    earlier: Vector  # of the one before
    effort: Vector  # that was held in between


class Beginning(NamedTuple):
    """An observer before its first tick."""

    observe: Observe
    constants: tuple[Any, ...]
    z: Vector  # flat
    memory: Vector  # what it keeps besides, flat


def beginning(form: LinearForm) -> Beginning:
    """Return the observer of a controller, the same for all lanes."""
    found = form.observer
    if isinstance(found, LinearObserver):
        k = len(found.constant)
        matrices = LinearObserver(*map(np.ascontiguousarray, found))
        return Beginning(linear(k), matrices, np.zeros(k * LANES), np.empty(k * LANES))
    k, outputs = len(found.matrices.origin), len(found.matrices.c)
    constants = FilterBelief(found.model.packed, *map(np.ascontiguousarray, found.matrices))
    memory = np.empty(LANES * (k + k * k))
    model = found.model
    observe = kalman(model.kernels, model.before_modes, model.coordinates, found.linear)
    return Beginning(observe, constants, np.zeros((k + outputs) * LANES), memory)


@lru_cache
def linear(states: int) -> Observe:
    """Return the observer whose matrices linear_form.Observer holds."""

    @vectorised
    def observe(
        k: int,
        t: float,
        dt: float,
        law: LinearObserver,
        signals: LaneSignals,
        z: Vector,
        after: Vector,
        filled: int,
    ) -> None:
        joints, outputs = law.effort.shape[1], law.start.shape[1]
        for i in range(states):
            base = law.constant[i] if k > 0 else 0.0
            for lane in range(LANES):
                after[i * LANES + lane] = base
            if k == 0:
                for j in range(outputs):
                    weight = law.start[i, j]
                    for lane in range(LANES):
                        after[i * LANES + lane] += weight * signals.y[j * LANES + lane]
                continue
            for j in range(states):
                weight = law.state[i, j]
                for lane in range(LANES):
                    after[i * LANES + lane] += weight * z[j * LANES + lane]
            for j in range(joints):
                weight = law.effort[i, j]
                for lane in range(LANES):
                    after[i * LANES + lane] += weight * signals.effort[j * LANES + lane]
            for j in range(outputs):
                weight = law.before[i, j]
                for lane in range(LANES):
                    after[i * LANES + lane] += weight * signals.earlier[j * LANES + lane]
        for i in range(states * LANES):
            z[i] = after[i]

    return cast(Observe, observe)


@lru_cache
def kalman(kernels: Kernels, before: int, n: int, by_matrices: bool) -> Observe:
    """Return the Kalman filter, lane after lane as on the bench.

    Args:
        kernels: the equations that it believes in.
        before: coordinates before the modes.
        n: coordinates.
        by_matrices: whether it predicts by matrices.
    """
    tick = kalman_tick(kernels, n, before, by_matrices)

    @compiled
    def observe(
        k: int,
        t: float,
        dt: float,
        belief: FilterBelief,
        signals: LaneSignals,
        z: Vector,
        memory: Vector,
        filled: int,
    ) -> None:
        outputs, states = belief.c.shape
        m, each = belief.g.shape[1], states + states * states
        read, held, innovation = np.empty(outputs), np.empty(m), np.zeros(outputs)
        for lane in range(filled):
            own = memory[lane * each : (lane + 1) * each]
            x, p = own[:states], own[states:].reshape((states, states))
            for i in range(outputs):
                read[i] = signals.y[i * LANES + lane]
            for i in range(m):
                held[i] = signals.effort[i * LANES + lane]
            if k == 0:
                x[:] = 0.0
                for i in range(m):
                    x[i], x[n + i] = read[i], read[m + i]
                for i in range(states):
                    for j in range(states):
                        p[i, j] = belief.first[i, j]
            else:
                tick(belief, t - dt, dt, held, read, x, p, innovation)
            for i in range(states):
                z[i * LANES + lane] = x[i]
            for i in range(outputs):
                z[(states + i) * LANES + lane] = innovation[i]

    return cast(Observe, observe)
