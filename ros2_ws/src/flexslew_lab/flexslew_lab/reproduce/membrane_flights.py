"""Non-linear flights of the membrane antenna, example 5 of Kwak (1989), on the bench."""

from functools import lru_cache
from typing import Any, NamedTuple

import numpy as np

from flexslew_lab.reproduce.scole_flights import example_trial
from flexslew_lab.reproduce.trial_flights import states
from flexslew_plant.arrays import Matrix, Vector
from flexslew_plant.testbeds.contract import Motions, Pointing
from flexslew_plant.testbeds.spacecraft.shapes.shape import FlexibleShape
from flexslew_plant.testbeds.spacecraft.units import FOOT

_FREE = {"controllers": {"pd_feedforward": {"kp": [0.0], "kd": [0.0]}}, "active": "pd_feedforward"}


class MembraneFlight(NamedTuple):
    """What the platform and the membrane do."""

    motions: Motions
    modes: Matrix  # modal coordinates, (ticks, 10) [m]


@lru_cache
def membrane_flight(case: int, closed_loop: bool) -> MembraneFlight:
    """Return what the platform and the membrane do in one of the two cases."""
    changes: dict[str, Any] = {} if closed_loop else _FREE
    trial = example_trial(f"antenna_5_{case}", changes)
    position, velocity = states(trial)
    testbed = trial.testbed
    assert isinstance(testbed, Pointing)
    return MembraneFlight(
        testbed.motions(position, velocity, {}), position[:, -trial.testbed.modes :]
    )


def half_way(shape: FlexibleShape) -> Vector:
    """Return how the modes deflect the membrane at half its radius, 90 deg from x, (10,) [-].

    Modes come as waves 0, 1 (cos, sin), 2 (cos, sin), two rings each; the points of the shape's
    line lie at 0 deg.
    """
    middle = 0.5 * shape.line[:, 0].max()
    at_zero = shape.line_shape[abs(shape.line[:, 0] - middle).argmin(), 2]
    deflection = np.zeros(10)
    deflection[:2], deflection[4:6], deflection[6:8] = at_zero[:2], at_zero[2:4], -at_zero[6:8]
    return deflection


def membrane_peaks(case: int, closed_loop: bool) -> tuple[float, float, float, float]:
    """Return the peaks of R_y, R_z [ft], theta_x [rad] and the centre's deflection [ft]."""
    m = membrane_flight(case, closed_loop).motions
    place, centre = abs(m.place).max(axis=0) / FOOT, abs(m.tips["membrane"]).max() / FOOT
    return float(place[1]), float(place[2]), float(abs(m.turned[:, 0]).max()), float(centre)
