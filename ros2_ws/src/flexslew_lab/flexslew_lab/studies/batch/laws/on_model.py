"""Laws on the equations of motion in members, member after member as on the bench."""

from functools import lru_cache
from typing import NamedTuple, cast

import numpy as np

from flexslew_control.linear_form import SurfaceGains, surface_terms
from flexslew_lab.studies.batch.laws.by_member import BatchSteady, equations
from flexslew_lab.studies.batch.laws.observers import BatchSignals, ObserverStep
from flexslew_plant.arrays import Matrix, Tensor, Vector, called, compiled
from flexslew_plant.testbeds.compiled.batch_kernel import BATCH_WIDTH
from flexslew_plant.testbeds.kernels import Kernels


class BatchEfforts(NamedTuple):
    """linear_form.OnModelForm without its observer, of the members side by side."""

    packed: Matrix  # (members, size)
    surface: Tensor  # G, (members, m, 2 n)
    reaching: Tensor  # R, (members, m, 2 n)
    innovation: Tensor  # W, (members, m, l)
    nominal: Tensor  # x*, (members, ticks, 2 n)
    slope: Tensor  # x*', (members, ticks, 2 n)


@lru_cache
def on_model(
    kernels: Kernels, before: int, n: int, first: ObserverStep, known: int
) -> ObserverStep:
    """Return an observer and the efforts of linear_form.OnModelForm after it, as one.

    Args:
        kernels: the equations of the law.
        before: coordinates before the modes.
        n: coordinates.
        first: the observer; its constants are the first of two.
        known: size of its flat state.
    """
    it, states, terms_of = equations(kernels, before, n), 2 * n, called(surface_terms)
    derivative, jacobian = it.derivative, it.jacobian

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
        batch = constants[1]
        count, m, outputs = batch.innovation.shape
        x, innovation, zero_effort = np.empty(states), np.empty(outputs), np.zeros(m)
        tick, after = min(k, batch.nominal.shape[1] - 1), states + outputs
        inverse = np.empty((m, m))
        for member in range(filled):
            one = member if count > 1 else 0
            for i in range(states):
                x[i] = z[i * BATCH_WIDTH + member]
            for i in range(outputs):
                innovation[i] = z[(states + i) * BATCH_WIDTH + member]
            if not (np.isfinite(x).all() and np.isfinite(innovation).all()):
                for i in range(m):
                    z[(after + i) * BATCH_WIDTH + member] = np.nan
                continue
            gains = SurfaceGains(batch.surface[one], batch.reaching[one], batch.innovation[one])
            packed, error = batch.packed[one], x - batch.nominal[one, tick]
            drift = derivative(packed, x, zero_effort)
            inverse[:] = np.linalg.inv(gains.surface @ jacobian(packed, x, zero_effort, 0.0)[1])
            terms = terms_of(gains, inverse, batch.slope[one, tick], drift, innovation, error)
            for i in range(m):
                effort = terms[0][i] + terms[1][i] + terms[2][i] + terms[3][i]
                z[(after + i) * BATCH_WIDTH + member] = effort

    return cast(ObserverStep, observer_step)
