"""Non-linear flights of the membrane antenna, example 5 of Kwak (1989), on the bench."""

from functools import lru_cache
from typing import Any

import numpy as np

from flexslew_lab.reproduce.scole_flights import shipped
from flexslew_lab.trial.in_process import Observer, fly
from flexslew_lab.trial.trial import bench_settings, build_controllers
from flexslew_plant.bench.bench import Bench, Truth
from flexslew_plant.testbeds.spacecraft.motions import Motions, Pointing
from flexslew_plant.testbeds.spacecraft.units import FOOT

_FREE = {"controllers": {"pd_feedforward": {"kp": [0.0], "kd": [0.0]}}, "active": "pd_feedforward"}


class _States(Observer):
    def __init__(self) -> None:
        self.rows: list[Truth] = []

    def truth(self, truth: Truth) -> None:
        """Keep the state."""
        self.rows.append(truth)


@lru_cache
def membrane_flight(case: int, controlled: bool) -> Motions:
    """Return what the platform and the membrane's centre do in one of the two cases."""
    changes: dict[str, Any] = {} if controlled else _FREE
    trial = shipped(f"antenna_5_{case}", changes)
    bench, seen = Bench(bench_settings(trial)), _States()
    controllers = build_controllers(trial, bench, trial.name)
    fly(bench, {trial.active: controllers[trial.active]}, seen)
    testbed = trial.testbed
    assert isinstance(testbed, Pointing)
    position = np.array([row.position for row in seen.rows])
    velocity = np.array([row.velocity for row in seen.rows])
    return testbed.motions(position, velocity, {})


def membrane_peaks(case: int, controlled: bool) -> tuple[float, float, float, float]:
    """Return the peaks of R_y, R_z [ft], theta_x [rad] and the centre's deflection [ft]."""
    m = membrane_flight(case, controlled)
    place, centre = abs(m.place).max(axis=0) / FOOT, abs(m.tips["membrane"]).max() / FOOT
    return float(place[1]), float(place[2]), float(abs(m.turned[:, 0]).max()), float(centre)
