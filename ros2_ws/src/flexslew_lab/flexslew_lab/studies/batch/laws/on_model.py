"""Laws on the equations of motion in members, member after member as on the bench."""

from functools import lru_cache
from typing import NamedTuple

import numpy as np

from flexslew_control.controllers.linear_form import SurfaceGains, surface_terms
from flexslew_lab.studies.batch.laws.by_member import (
    MemberReadings,
    MemberSizes,
    by_member,
    equations,
)
from flexslew_lab.studies.batch.laws.observers import ObserverStep
from flexslew_plant.arrays import Matrix, Tensor, Vector, called
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
def on_model(kernels: Kernels, before: int, n: int, sizes: MemberSizes) -> ObserverStep:
    """Return what computes the efforts of linear_form.OnModelForm; it reads x and e as y.

    Args:
        kernels: the equations of the law.
        before: coordinates before the modes.
        n: coordinates.
        sizes: of the efforts.
    """
    it, states, terms_of = equations(kernels, before, n), 2 * n, called(surface_terms)
    derivative, jacobian, efforts = it.derivative, it.jacobian, sizes.estimate

    @called
    def step(
        numbers: BatchEfforts, row: int, memory: Vector, readings: MemberReadings, out: Vector
    ) -> None:
        if not np.isfinite(readings.y).all():
            out[:] = np.nan
            return
        tick, zero_effort = min(readings.tick, numbers.nominal.shape[1] - 1), np.zeros(efforts)
        x, innovation = readings.y[:states], readings.y[states:]
        gains = SurfaceGains(numbers.surface[row], numbers.reaching[row], numbers.innovation[row])
        packed, error = numbers.packed[row], x - numbers.nominal[row, tick]
        drift = derivative(packed, x, zero_effort)
        inverse = np.empty((efforts, efforts))
        inverse[:] = np.linalg.inv(gains.surface @ jacobian(packed, x, zero_effort, 0.0)[1])
        terms = terms_of(gains, inverse, numbers.slope[row, tick], drift, innovation, error)
        for i in range(efforts):
            out[i] = terms[0][i] + terms[1][i] + terms[2][i] + terms[3][i]

    return by_member(step, sizes)
