"""Whether a bang-bang slew is an extremal: Pontryagin's condition on its switching function."""

from typing import NamedTuple

import numpy as np

from flexslew_control.planners.time_optimal.all_drives import AllDrives
from flexslew_control.planners.time_optimal.arcs import costate_backwards, final_states
from flexslew_control.planners.time_optimal.bang_bang import BangBang
from flexslew_plant.arrays import Matrix, Vector

_ALLOWED = 1e-5  # wrong-signed part of the switching function, relative to its largest value


class Extremality(NamedTuple):
    """The switching functions sigma = lambda^T df/du along a slew, and their verdict."""

    times: Vector  # rising [s]
    sigma: Matrix  # positive for +amplitude; at each time, a column for every driven joint
    holds: bool  # whether sigma has the sign of the effort everywhere
    violation: float  # largest wrong-signed |sigma| / largest |sigma| of the joint
    at: float  # where that is [s]


def switching_function(slew: BangBang | AllDrives, durations: Vector) -> Extremality:
    """Return the switching function of the slew with these arcs.

    lambda(t_f) = C^T mu with (dr/dd)^T mu = 1: then H = 1 on every arc, which makes sigma zero at
    the switches. A robust slew has costates of its perturbed copies too.
    """
    jacobian = slew.residual_jacobian(durations)[1]
    multipliers = np.linalg.lstsq(jacobian.T, np.ones(durations.size), rcond=None)[0]
    efforts = slew.efforts(durations.size)
    final = final_states(slew.ensemble, slew.start, efforts, durations, slew.step).ravel()
    costate = slew.conditions.T @ multipliers
    times, values = costate_backwards(slew.ensemble, final, costate, efforts, durations, slew.step)
    active = efforts.any(axis=0)
    times, sigma = times[::-1], values[::-1, active]
    arc = np.searchsorted(np.cumsum(durations)[:-1], times, side="right")
    # at a switch the sample belongs to either arc
    signed = (sigma * np.sign(efforts[:, active])[arc] / np.abs(sigma).max(axis=0)).min(axis=1)
    index = int(np.argmin(signed))
    violation = float(max(0.0, -signed[index]))
    return Extremality(times, sigma, violation <= _ALLOWED, violation, float(times[index]))
