"""A law about the plan of a turning craft as matrices, tick by tick."""

from typing import NamedTuple

import numpy as np

from flexslew_control.estimators.turning_filter import TurningFilter
from flexslew_control.law import Reference
from flexslew_control.linear_form import Integration, LinearForm, LinearObserver, observed_form
from flexslew_plant.arrays import Matrix, Tensor


class Integrated(NamedTuple):
    """An integral of what is believed, s' = N x, which winds up as a law's integral does."""

    integrand: Matrix  # N, (joints, states)
    integration: Integration


def turning_form(
    estimator: TurningFilter,
    gains: Tensor,
    references: list[Reference],
    integrated: Integrated | None = None,
) -> LinearForm:
    """Return u = u_d + L x + s of the x = [e, e', d] that a TurningFilter believes in.

    z is x before the measurement of its tick: x = z + K (y - y_d - C z), and a tick later
    z = F x + G (u - u_d). F, G and K are known from the plan. Behind it stands s without what
    takes it back at the limits.

    Args:
        estimator: the filter.
        gains: L of each tick, shape (ticks, joints, states); or of all, (joints, states).
        references: of every tick.
        integrated: s; None: there is none.
    """
    along, c = estimator.along(references), estimator.still.matrices.c
    (outputs, k), period = c.shape, estimator.period
    planned = np.array([np.concatenate((r.position, r.velocity)) for r in references])
    effort = np.array([reference.effort for reference in references])
    m, believed = effort.shape[1], np.eye(k) - along.gains @ c  # x of z
    state, before = along.states @ believed, along.states @ along.gains
    of_state, of_reading, held = gains @ believed, gains @ along.gains, along.efforts
    constant = -_each(held, effort) - _each(before, planned)
    if integrated is not None:
        ticks, integrand = len(references), period * integrated.integrand
        read, one = integrand @ along.gains, np.tile(np.eye(m), (ticks, 1, 1))
        state = np.block([[state, np.zeros((ticks, k, m))], [integrand @ believed, one]])
        held = np.block([[held], [np.zeros((ticks, m, m))]])
        before = np.block([[before], [read]])
        constant = np.hstack((constant, -_each(read, planned)))
        of_state = np.block([of_state, one])
    observer = LinearObserver(np.zeros((state.shape[2], outputs)), state, held, before, constant)
    demand = effort - _each(of_reading, planned)
    form = observed_form(of_state, of_reading, demand, observer)
    if integrated is None:
        return form
    return form._replace(law=form.law._replace(**integrated.integration._asdict()))


def _each(matrices: Tensor, vectors: Tensor) -> Tensor:
    """Return each matrix times its vector."""
    return (matrices @ vectors[:, :, None])[:, :, 0]
