"""A law about the plan of a turning craft as matrices, tick by tick."""

from typing import NamedTuple

import numpy as np

from flexslew_control.controllers.linear_form import (
    Integration,
    LinearForm,
    LinearObserver,
    observed_form,
)
from flexslew_control.estimators.rotation_filter import RotationFilter
from flexslew_control.law import Reference
from flexslew_plant.arrays import Matrix, Tensor


class IntegralTerm(NamedTuple):
    """An integral of what is believed, s' = N x, which winds up as a law's integral does."""

    integrand: Matrix  # N, (joints, states)
    integration: Integration


def rotation_form(
    estimator: RotationFilter,
    gains: Tensor,
    references: list[Reference],
    integral: IntegralTerm | None = None,
) -> LinearForm:
    """Return u = u_d + L x + s of the x = [e, e', d] that a RotationFilter believes in.

    z is x before the measurement of its tick: x = z + K (y - y_d - C z), and a tick later
    z = F x + G (u - u_d). F, G and K are known from the plan. Behind it stands s without what
    takes it back at the limits.

    Args:
        estimator: the filter.
        gains: L of each tick, shape (ticks, joints, states); or of all, (joints, states).
        references: of every tick.
        integral: s; None: there is none.
    """
    along, c = estimator.along(references), estimator.static.matrices.c
    (outputs, k), period = c.shape, estimator.period
    plan_outputs = np.array([np.concatenate((r.position, r.velocity)) for r in references])
    effort = np.array([reference.effort for reference in references])
    m, correction = effort.shape[1], np.eye(k) - along.gains @ c  # x of z
    state, before = along.states @ correction, along.states @ along.gains
    of_state, of_reading, inputs = gains @ correction, gains @ along.gains, along.efforts
    constant = -_each(inputs, effort) - _each(before, plan_outputs)
    if integral is not None:
        ticks, integrand = len(references), period * integral.integrand
        read, one = integrand @ along.gains, np.tile(np.eye(m), (ticks, 1, 1))
        state = np.block([[state, np.zeros((ticks, k, m))], [integrand @ correction, one]])
        inputs = np.block([[inputs], [np.zeros((ticks, m, m))]])
        before = np.block([[before], [read]])
        constant = np.hstack((constant, -_each(read, plan_outputs)))
        of_state = np.block([of_state, one])
    observer = LinearObserver(np.zeros((state.shape[2], outputs)), state, inputs, before, constant)
    demand = effort - _each(of_reading, plan_outputs)
    form = observed_form(of_state, of_reading, demand, observer)
    if integral is None:
        return form
    return form._replace(law=form.law._replace(integration=integral.integration))


def _each(matrices: Tensor, vectors: Tensor) -> Tensor:
    """Return each matrix times its vector."""
    return (matrices @ vectors[:, :, None])[:, :, 0]
