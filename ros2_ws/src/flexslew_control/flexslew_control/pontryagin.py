"""Whether a bang-bang slew is an extremal: Pontryagin's condition on its switching function."""

from typing import NamedTuple

import numpy as np

from flexslew_control.arcs import costate_backwards, final_states
from flexslew_control.switching import BangBang
from flexslew_plant.arrays import Vector

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

    lambda(t_f) = C^T mu with (dr/dd)^T mu = 1: then H = 1 on every arc, which makes sigma zero at
    the switches. A robust slew has costates of its followers too.
    """
    jacobian = slew.linearised(durations)[1]
    multipliers = np.linalg.lstsq(jacobian.T, np.ones(durations.size), rcond=None)[0]
    efforts = slew.efforts(durations.size)
    final = final_states(*slew.flock, slew.start, efforts, durations, slew.step).ravel()
    costate = slew.conditions.T @ multipliers
    times, values = costate_backwards(*slew.flock, final, costate, efforts, durations, slew.step)
    sigma = values[:, slew.joint]
    times, sigma = times[::-1], sigma[::-1]
    arc = np.searchsorted(np.cumsum(durations)[:-1], times, side="right")
    signed = sigma * np.sign(efforts[arc, slew.joint])
    # at a switch the sample belongs to either arc
    worst = int(np.argmin(signed))
    violation = float(max(0.0, -signed[worst]) / np.abs(sigma).max())
    return Extremality(times, sigma, violation <= _ALLOWED, violation, float(times[worst]))
