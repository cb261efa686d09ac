"""What the laws of all members know of their benches, tick by tick: z of linear_form.

z and readings are flat, row after row with BATCH_WIDTH neighbours each, as in loop.
"""

from collections.abc import Callable
from functools import lru_cache
from typing import Any, NamedTuple, TypeAlias, cast

from flexslew_control.controllers.linear_form import LinearObserver
from flexslew_control.estimators.gained_filter import GainFilter
from flexslew_plant.arrays import Indices, Tensor, Vector, put, vectorised
from flexslew_plant.testbeds.compiled.batch_kernel import BATCH_WIDTH


class BatchSignals(NamedTuple):
    """What an observer receives, flat."""

    y: Vector  # readings of this tick
    previous: Vector  # of the one before
    effort: Vector  # that was held in between
    demand: Vector  # of the law for it, within the limits


# (k, t, dt, constants, Signals, z, memory, filled): takes z to tick k at t [s], at least in the
# first `filled` members; where z has an innovation, its variances stand at the end of the memory.
# Of those that may start again in flight the constants are (the tick at which they did, (1,); ...)
ObserverStep: TypeAlias = Callable[
    [int, float, float, Any, BatchSignals, Vector, Vector, int], None
]


@vectorised
def add_products(
    weights: Tensor, k: int, i: int, given: Vector, first: int, by: float, out: Vector, to: int
) -> None:
    """Add by * weights[k, i, j] * given, row j after row from `first`, to the row of out at `to`.

    weights is by batch_laws.by_member. No views of it: each would cost as much as a product.
    """
    tick = min(k, weights.shape[0] - 1)
    if weights.shape[3] == 1:
        for j in range(weights.shape[2]):
            weight = by * weights[tick, i, j, 0]
            if weight != 0.0:
                for member in range(BATCH_WIDTH):
                    out[to + member] += weight * given[first + j * BATCH_WIDTH + member]
    else:
        for j in range(weights.shape[2]):
            for member in range(BATCH_WIDTH):
                weight = by * weights[tick, i, j, member]
                out[to + member] += weight * given[first + j * BATCH_WIDTH + member]


@vectorised
def _add_all(weights: Tensor, k: int, given: Vector, out: Vector) -> None:
    """Add the products of all rows to the rows of out."""
    for i in range(weights.shape[1]):
        add_products(weights, k, i, given, 0, 1.0, out, i * BATCH_WIDTH)


@lru_cache
def linear(states: int) -> ObserverStep:
    """Return the observer with the matrices of linear_form.LinearObserver."""

    @vectorised
    def observer_step(
        k: int,
        t: float,
        dt: float,
        given: tuple[Indices, LinearObserver],
        signals: BatchSignals,
        z: Vector,
        after: Vector,
        filled: int,
    ) -> None:
        if states == 0:  # known to the compiler
            return
        law = given[1]
        if k == given[0][0]:
            for i in range(states * BATCH_WIDTH):
                after[i] = 0.0
            _add_all(law.start, 0, signals.y, after)
        else:
            tick = min(k, law.constant.shape[0]) - 1
            unit = 1 if law.constant.shape[2] > 1 else 0
            for i in range(states):
                for member in range(BATCH_WIDTH):
                    after[i * BATCH_WIDTH + member] = law.constant[tick, i, member * unit]
            _add_all(law.state, k - 1, z, after)
            _add_all(law.effort, k - 1, signals.effort, after)
            _add_all(law.before, k - 1, signals.previous, after)
            _add_all(law.demand, k - 1, signals.demand, after)
        for i in range(states * BATCH_WIDTH):
            z[i] = after[i]

    return cast(ObserverStep, observer_step)


@lru_cache
def combine_observer(
    first: ObserverStep, rows: int, kept: int, then: ObserverStep, in_series: bool
) -> ObserverStep:
    """Return two observers as one: their states and memories stand one behind the other's.

    Args:
        first: the first one; its constants are the first of two.
        rows: size of its flat state.
        kept: size of its flat memory.
        then: the other one.
        in_series: whether the other one reads the state of the first as others read y; then the
            memory begins with that of the tick before.
    """

    @vectorised
    def observer_step(
        k: int,
        t: float,
        dt: float,
        constants: tuple[object, object],
        signals: BatchSignals,
        z: Vector,
        memory: Vector,
        filled: int,
    ) -> None:
        seen, own = signals, memory[rows * in_series :]
        if in_series:  # known to the compiler
            put(z[:rows], memory[:rows])
            seen = BatchSignals(z[:rows], memory[:rows], signals.effort, signals.demand)
        first(k, t, dt, constants[0], signals, z[:rows], own[:kept], filled)
        then(k, t, dt, constants[1], seen, z[rows:], own[kept:], filled)

    return cast(ObserverStep, observer_step)


@lru_cache
def gain_filter(states: int) -> ObserverStep:
    """Return the filter with the matrices of gained_filter.GainFilter by batch_laws.by_member."""

    @vectorised
    def observer_step(
        k: int,
        t: float,
        dt: float,
        given: tuple[Indices, GainFilter],
        signals: BatchSignals,
        z: Vector,
        memory: Vector,
        filled: int,
    ) -> None:
        x, innovation = z[: states * BATCH_WIDTH], z[states * BATCH_WIDTH :]
        prediction, variance = memory[: states * BATCH_WIDTH], memory[states * BATCH_WIDTH :]
        law, elapsed = given[1], k - given[0][0]
        for i in range(variance.size):
            variance[i] = law.variance[elapsed, i // BATCH_WIDTH, 0]
        if elapsed == 0:
            for i in range(z.size):
                z[i] = 0.0
            _add_all(law.start, 0, signals.y, x)
            return
        for i in range(x.size):
            x[i] -= law.origin[0, i // BATCH_WIDTH, 0]
            prediction[i] = law.origin[0, i // BATCH_WIDTH, 0]
        _add_all(law.state, 0, x, prediction)
        _add_all(law.effort, 0, signals.effort, prediction)
        for i in range(x.size):
            x[i] = prediction[i]
            prediction[i] = -prediction[i]
        for i in range(innovation.size):
            innovation[i] = signals.y[i]
        _add_all(law.output, 0, prediction, innovation)
        _add_all(law.gains, elapsed, innovation, x)

    return cast(ObserverStep, observer_step)
