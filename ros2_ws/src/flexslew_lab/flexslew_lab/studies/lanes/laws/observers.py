"""What the laws of all lanes know of their benches, tick by tick: z of linear_form.

z and readings are flat, row after row with LANES neighbours each, as in loop.
"""

from collections.abc import Callable
from functools import lru_cache
from typing import Any, NamedTuple, TypeAlias, cast

import numpy as np

from flexslew_control.estimators.gained_filter import GainedFilter
from flexslew_control.estimators.kalman_tick import FilterBelief, kalman_tick, stated_variance
from flexslew_control.linear_form import LinearObserver
from flexslew_plant.arrays import Indices, Matrix, Tensor, Vector, compiled, vectorised
from flexslew_plant.testbeds.compiled.lanes import LANES
from flexslew_plant.testbeds.kernels import Kernels

# (k, t, dt, constants, Signals, z, memory, filled): takes z to tick k at t [s], at least in the
# first `filled` lanes; where z has an innovation, its variances stand at the end of the memory.
# Of those that may start again in flight the constants are (the tick at which they did, (1,); ...)
Observe: TypeAlias = Callable[..., None]


class LaneSignals(NamedTuple):
    """What an observer receives, flat."""

    y: Vector  # readings of this tick
    earlier: Vector  # of the one before
    effort: Vector  # that was held in between
    demand: Vector  # of the law for it, within the limits


@vectorised
def _add_product(matrix: Matrix, given: Vector, out: Vector) -> None:
    """Add matrix @ given to out, lane by lane."""
    for i in range(matrix.shape[0]):
        for j in range(matrix.shape[1]):
            weight = matrix[i, j]
            if weight != 0.0:
                for lane in range(LANES):
                    out[i * LANES + lane] += weight * given[j * LANES + lane]


@vectorised
def add_products(
    weights: Tensor, k: int, i: int, given: Vector, first: int, by: float, out: Vector, to: int
) -> None:
    """Add by * weights[k, i, j] * given, row j after row from `first`, to the row of out at `to`.

    weights is by lane_laws.by_lane. No views of it: each would cost as much as a product.
    """
    tick = min(k, weights.shape[0] - 1)
    if weights.shape[3] == 1:
        for j in range(weights.shape[2]):
            weight = by * weights[tick, i, j, 0]
            if weight != 0.0:
                for lane in range(LANES):
                    out[to + lane] += weight * given[first + j * LANES + lane]
    else:
        for j in range(weights.shape[2]):
            for lane in range(LANES):
                weight = by * weights[tick, i, j, lane]
                out[to + lane] += weight * given[first + j * LANES + lane]


@vectorised
def _add_all(weights: Tensor, k: int, given: Vector, out: Vector) -> None:
    """Add the products of all rows to the rows of out."""
    for i in range(weights.shape[1]):
        add_products(weights, k, i, given, 0, 1.0, out, i * LANES)


@lru_cache
def linear(states: int) -> Observe:
    """Return the observer with the matrices of linear_form.LinearObserver."""

    @vectorised
    def observe(
        k: int,
        t: float,
        dt: float,
        given: tuple[Indices, LinearObserver],
        signals: LaneSignals,
        z: Vector,
        after: Vector,
        filled: int,
    ) -> None:
        if states == 0:  # known to the compiler
            return
        law = given[1]
        if k == given[0][0]:
            for i in range(states * LANES):
                after[i] = 0.0
            _add_all(law.start, 0, signals.y, after)
        else:
            tick = min(k, law.constant.shape[0]) - 1
            unit = 1 if law.constant.shape[2] > 1 else 0
            for i in range(states):
                for lane in range(LANES):
                    after[i * LANES + lane] = law.constant[tick, i, lane * unit]
            _add_all(law.state, k - 1, z, after)
            _add_all(law.effort, k - 1, signals.effort, after)
            _add_all(law.before, k - 1, signals.earlier, after)
            _add_all(law.demand, k - 1, signals.demand, after)
        for i in range(states * LANES):
            z[i] = after[i]

    return cast(Observe, observe)


@lru_cache
def one_after_another(first: Observe, rows: int, kept: int, then: Observe) -> Observe:
    """Return two observers as one: their states and memories stand one behind the other's.

    Args:
        first: the first one; its constants are the first of two.
        rows: size of its flat state.
        kept: size of its flat memory.
        then: the other one.
    """

    @vectorised
    def observe(
        k: int,
        t: float,
        dt: float,
        both: tuple[Any, Any],
        signals: LaneSignals,
        z: Vector,
        memory: Vector,
        filled: int,
    ) -> None:
        first(k, t, dt, both[0], signals, z[:rows], memory[:kept], filled)
        then(k, t, dt, both[1], signals, z[rows:], memory[kept:], filled)

    return cast(Observe, observe)


@lru_cache
def gained(states: int) -> Observe:
    """Return the filter with the matrices of gained_filter.GainedFilter."""

    @vectorised
    def observe(
        k: int,
        t: float,
        dt: float,
        given: tuple[Indices, GainedFilter],
        signals: LaneSignals,
        z: Vector,
        memory: Vector,
        filled: int,
    ) -> None:
        x, innovation = z[: states * LANES], z[states * LANES :]
        ahead, variance = memory[: states * LANES], memory[states * LANES :]
        law, age = given[1], k - given[0][0]
        for i in range(variance.size):
            variance[i] = law.variance[age, i // LANES]
        if age == 0:
            for i in range(z.size):
                z[i] = 0.0
            _add_product(law.start, signals.y, x)
            return
        for i in range(x.size):
            x[i] -= law.origin[i // LANES]
            ahead[i] = law.origin[i // LANES]
        _add_product(law.state, x, ahead)
        _add_product(law.effort, signals.effort, ahead)
        for i in range(x.size):
            x[i] = ahead[i]
            ahead[i] = -ahead[i]
        for i in range(innovation.size):
            innovation[i] = signals.y[i]
        _add_product(law.output, ahead, innovation)
        _add_product(law.gains[age], innovation, x)

    return cast(Observe, observe)


@lru_cache
def kalman(kernels: Kernels, before: int, n: int) -> Observe:
    """Return the Kalman filter that predicts by equations, lane after lane as on the bench.

    Its constants are a FilterBelief with an axis for lanes in front; one entry: the same in all.

    Args:
        kernels: the equations that it believes in.
        before: coordinates before the modes.
        n: coordinates.
    """
    tick = kalman_tick(kernels, n, before, False)

    @compiled
    def observe(
        k: int,
        t: float,
        dt: float,
        beliefs: FilterBelief,
        signals: LaneSignals,
        z: Vector,
        memory: Vector,
        filled: int,
    ) -> None:
        lanes, outputs, states = beliefs.c.shape
        m, each = beliefs.g.shape[2], states + states * states
        read, held, innovation = np.empty(outputs), np.empty(m), np.zeros(outputs)
        variance = np.empty(outputs)
        for lane in range(filled):
            one = lane if lanes > 1 else 0
            own = memory[lane * each : (lane + 1) * each]
            x, p = own[:states], own[states:].reshape((states, states))
            for i in range(outputs):
                read[i] = signals.y[i * LANES + lane]
            for i in range(m):
                held[i] = signals.effort[i * LANES + lane]
            # after a reading that was no number it starts again, with one that is
            if k == 0 or (not np.isfinite(x).all() and np.isfinite(read).all()):
                x[:] = 0.0
                innovation[:] = 0.0
                for i in range(m):
                    x[i], x[n + i] = read[i], read[m + i]
                for i in range(states):
                    for j in range(states):
                        p[i, j] = beliefs.first[one, i, j]
                stated_variance(p, beliefs.c[one], beliefs.r[one], variance)
            else:
                belief = FilterBelief(
                    beliefs.packed[one],
                    beliefs.f[one],
                    beliefs.g[one],
                    beliefs.q[one],
                    beliefs.c[one],
                    beliefs.r[one],
                    beliefs.origin[one],
                    beliefs.first[one],
                )
                tick(belief, t - dt, dt, held, read, x, p, innovation, variance)
            for i in range(states):
                z[i * LANES + lane] = x[i]
            for i in range(outputs):
                z[(states + i) * LANES + lane] = innovation[i]
                memory[(each + i) * LANES + lane] = variance[i]

    return cast(Observe, observe)
