"""Whether a bang-bang slew is an extremal: Pontryagin's condition on its switching function."""

from typing import NamedTuple

import numpy as np

from flexslew_control.arcs import costate_backwards
from flexslew_control.switching import STENCIL, BangBang
from flexslew_plant.arrays import Vector
from flexslew_plant.testbeds import with_stiffness

_ALLOWED = 1e-5  # wrong-signed part of the switching function, relative to its largest value


class Extremality(NamedTuple):
    """The switching function sigma = lambda^T df/du along a slew, and its verdict."""

    times: Vector  # rising [s]
    sigma: Vector  # positive asks for +amplitude; at each time
    holds: bool  # whether sigma has the sign of the effort everywhere
    violation: float  # largest wrong-signed |sigma| / largest |sigma|
    at: float  # where that is [s]


def switching_function(slew: BangBang, durations: Vector) -> Extremality:
    """Return the switching function of the slew with these arcs.

    lambda(t_f) solves (dr/dd)^T lambda = 1: then H = 1 on every arc, which makes sigma zero at
    the switches. A robust slew has costates of the sensitivities too: the same function on the
    models of the difference stencil, with its weights.
    """
    jacobian = slew.jacobian(durations)
    multipliers = np.linalg.lstsq(jacobian.T, np.ones(durations.size), rcond=None)[0]
    efforts = slew.efforts(durations.size)
    rows, modal = slew.rows, slew.modal_rows
    costate = np.zeros(slew.start.size)
    costate[rows] = multipliers[: rows.size]
    parts = [(1.0, costate)]
    if slew.robust:
        for factor, weight in STENCIL:
            c = np.zeros(slew.start.size)
            c[modal] = weight * multipliers[rows.size :]
            parts.append((factor, c))
    times, sigma = np.zeros(0), np.zeros(0)
    for factor, c in parts:
        model = with_stiffness(slew.model, factor)
        final = slew.final(durations, factor)
        times, values = costate_backwards(
            model.kind, model.packed, final, c, efforts, durations, slew.step
        )
        sigma = values[:, slew.joint] + (sigma if sigma.size else 0.0)
    times, sigma = times[::-1], sigma[::-1]
    arc = np.searchsorted(np.cumsum(durations)[:-1], times, side="right")
    signed = sigma * np.sign(efforts[arc, slew.joint])
    # at a switch the sample belongs to either arc
    worst = int(np.argmin(signed))
    violation = float(max(0.0, -signed[worst]) / np.abs(sigma).max())
    return Extremality(times, sigma, violation <= _ALLOWED, violation, float(times[worst]))
