"""Observers and laws on the equations of motion in a batch, member after member as on the bench."""

from collections.abc import Callable
from functools import lru_cache
from typing import NamedTuple, cast

import numpy as np

from flexslew_lab.studies.batch.laws.observers import BatchSignals, ObserverStep
from flexslew_plant.arrays import Matrix, Tensor, Vector, compiled
from flexslew_plant.testbeds.compiled.batch_kernel import BATCH_WIDTH
from flexslew_plant.testbeds.compiled.bound import bound
from flexslew_plant.testbeds.kernels import Kernels


class BatchSteady(NamedTuple):
    """linear_form.SteadyForm of the members side by side; one entry: the same in all."""

    packed: Matrix  # the model's numbers, (members, size)
    gain: Tensor  # K, (members, 2 n, l)
    output: Tensor  # C, (members, l, 2 n)
    variance: Matrix  # of y - C x, (members, l)


class BatchEfforts(NamedTuple):
    """linear_form.OnModelForm without its observer, of the members side by side."""

    packed: Matrix  # (members, size)
    surface: Tensor  # G, (members, m, 2 n)
    reaching: Tensor  # R, (members, m, 2 n)
    innovation: Tensor  # W, (members, m, l)
    demand: Tensor  # r, (members, ticks, m)


@lru_cache
def steady(kernels: Kernels, before: int, n: int) -> ObserverStep:
    """Return the observer of linear_form.SteadyForm.

    Args:
        kernels: the equations that it believes in.
        before: coordinates before the modes.
        n: coordinates.
    """
    step = _step(kernels, before, n)

    @compiled
    def observer_step(
        k: int,
        t: float,
        dt: float,
        batch: BatchSteady,
        signals: BatchSignals,
        z: Vector,
        memory: Vector,
        filled: int,
    ) -> None:
        count, states, outputs = batch.gain.shape
        m = outputs // 2  # the tip, if it is read, is one more
        x, y, effort = np.zeros(states), np.empty(outputs), np.empty(m)
        for member in range(filled):
            one = member if count > 1 else 0
            gain, output = batch.gain[one], batch.output[one]
            for i in range(states):
                x[i] = z[i * BATCH_WIDTH + member]
            if k > 0 and np.isfinite(x).all():
                for i in range(outputs):
                    y[i] = signals.previous[i * BATCH_WIDTH + member]
                for i in range(m):
                    effort[i] = signals.effort[i * BATCH_WIDTH + member]
                step(batch.packed[one], gain, output, y, effort, dt, x)
            for i in range(outputs):
                y[i] = signals.y[i * BATCH_WIDTH + member]
            # after a reading that was no number it starts again, with one that is
            if k == 0 or (not np.isfinite(x).all() and np.isfinite(y).all()):
                x[:] = 0.0
                for i in range(m):
                    x[i], x[n + i] = y[i], y[m + i]
            innovation = y - output @ x
            for i in range(states):
                z[i * BATCH_WIDTH + member] = x[i]
            for i in range(outputs):
                z[(states + i) * BATCH_WIDTH + member] = innovation[i]
                memory[i * BATCH_WIDTH + member] = batch.variance[one, i]

    return cast(ObserverStep, observer_step)


def _step(kernels: Kernels, before: int, n: int) -> Callable[..., None]:
    """Return what takes x one tick on; see JointsAndModes.propagate."""
    derivative = bound(kernels, n, before).derivative

    @compiled
    def slope(
        packed: Vector, x: Vector, effort: Vector, gain: Matrix, output: Matrix, y: Vector
    ) -> Vector:
        return derivative(packed, 0.0, x, effort) + gain @ (y - output @ x)

    @compiled
    def step(
        packed: Vector,
        gain: Matrix,
        output: Matrix,
        y: Vector,
        effort: Vector,
        dt: float,
        x: Vector,
    ) -> None:
        k1 = slope(packed, x, effort, gain, output, y)
        k2 = slope(packed, x + 0.5 * dt * k1, effort, gain, output, y)
        k3 = slope(packed, x + 0.5 * dt * k2, effort, gain, output, y)
        k4 = slope(packed, x + dt * k3, effort, gain, output, y)
        x += dt / 6.0 * (k1 + 2.0 * (k2 + k3) + k4)

    return cast(Callable[..., None], step)


@lru_cache
def on_model(kernels: Kernels, before: int, n: int) -> Callable[..., None]:
    """Return what writes the efforts of linear_form.OnModelForm after its observer.

    Args:
        kernels: the equations of the law.
        before: coordinates before the modes.
        n: coordinates.
    """
    model = bound(kernels, n, before)
    derivative, jacobian, states = model.derivative, model.jacobian, 2 * n

    @compiled
    def act(k: int, batch: BatchEfforts, z: Vector, filled: int) -> None:
        count, m, outputs = batch.innovation.shape
        x, innovation, zero_effort = np.empty(states), np.empty(outputs), np.zeros(m)
        dx, du = np.empty((states, states)), np.empty((states, m))
        tick = min(k, batch.demand.shape[1] - 1)
        for member in range(filled):
            one = member if count > 1 else 0
            packed, surface = batch.packed[one], batch.surface[one]
            for i in range(states):
                x[i] = z[i * BATCH_WIDTH + member]
            for i in range(outputs):
                innovation[i] = z[(states + i) * BATCH_WIDTH + member]
            if not (np.isfinite(x).all() and np.isfinite(innovation).all()):
                for i in range(m):
                    z[(states + outputs + i) * BATCH_WIDTH + member] = np.nan
                continue
            drift = derivative(packed, 0.0, x, zero_effort)
            jacobian(packed, 0.0, x, zero_effort, dx, du)
            required_rate = batch.demand[one, tick] - surface @ drift
            required_rate -= batch.reaching[one] @ x + batch.innovation[one] @ innovation
            given = np.linalg.solve(surface @ du, required_rate)
            for i in range(m):
                z[(states + outputs + i) * BATCH_WIDTH + member] = given[i]

    return cast(Callable[..., None], act)


@lru_cache
def observer_with_law(first: ObserverStep, known: int, act: Callable[..., None]) -> ObserverStep:
    """Return an observer and what acts on its estimate as one.

    Args:
        first: the observer; its constants are the first of two.
        known: size of its flat state.
        act: see on_model.
    """

    @compiled
    def observer_step(
        k: int,
        t: float,
        dt: float,
        constants: tuple[BatchSteady, BatchEfforts],
        signals: BatchSignals,
        z: Vector,
        memory: Vector,
        filled: int,
    ) -> None:
        first(k, t, dt, constants[0], signals, z[:known], memory, filled)
        act(k, constants[1], z, filled)

    return cast(ObserverStep, observer_step)
