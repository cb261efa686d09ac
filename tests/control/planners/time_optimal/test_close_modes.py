"""Robust slews of modes that are close: their end conditions are nearly the same."""

from typing import Any

import numpy as np
import pytest
from tests.plants import plant

from flexslew_control.planners import make_plan
from flexslew_control.planners.time_optimal.time_optimal import TimeOptimal
from flexslew_plant.arrays import Vector
from flexslew_plant.testbeds.identified import FreeMode, IdentifiedTestbed

PHI = 0.05  # how far the hub moves per unit of each mode


def planned(frequencies: tuple[float, ...], phi: tuple[float, ...], **more: Any) -> Any:
    modes = zip(frequencies, phi, strict=True)
    found = tuple(FreeMode(frequency=w, joints=(p,), tips=(1.0,)) for w, p in modes)
    testbed: Any = IdentifiedTestbed(free_modes=found, modes=len(found))
    return make_plan(TimeOptimal(robust=True, **more), plant(0.01, (10.0,), testbed))


def left(switches: Vector, duration: float, w: float) -> complex:
    """Return what bang-bang efforts of one leave of a free mode, in closed form."""
    edges = np.concatenate(([0.0], switches, [duration]))
    signs = (-1.0) ** np.arange(edges.size - 1)
    phases = np.exp(1j * w * (duration - edges))
    return complex(signs @ (phases[:-1] - phases[1:]) / w)


@pytest.mark.parametrize("apart", [8e-3, 3e-3, 1e-3])
def test_a_slew_that_two_close_modes_leave_insensitive_is_found(apart: float) -> None:
    frequencies = 1.0, 1.0 + apart
    told = planned(frequencies, (PHI, PHI), goal={"hub": 1.0}).summary
    # between 14.3211 s at 1 % and 14.3798 s in the limit, where four derivatives vanish at once
    assert told["duration"] == pytest.approx(14.3798 - 5.87 * apart, abs=1e-3)
    assert told["optimal"]
    assert told["switches"] == 9
    for w in frequencies:
        for near in (w, w * 1.0001, w * 0.9999):  # one that is sensitive leaves 1e-3
            assert abs(left(told["switch_times"], told["duration"], near)) < 1e-6


@pytest.mark.slow
def test_a_search_whose_steps_make_things_worse_does_not_run_away() -> None:
    # Newton's method stepped on where no share of a step helped, until numbers overflowed
    frequencies = 0.5578467243498518, 0.6434073337766815, 1.4442534981735462
    phi = 0.06692891674401907, 0.07389289040944053, 0.0524645043037026
    gains = {"kp": (100.0,), "kd": (200.0,)}
    told = planned(frequencies, phi, goal={"hub": 2.215540026853595}, feedback=gains, reserve=0.2)
    assert told.summary["optimal"]
    for w in frequencies:
        assert abs(left(told.summary["switch_times"], told.summary["duration"], w)) < 1e-8
