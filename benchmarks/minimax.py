"""How long minimax_feedforward plans, beside flights of its members measured in the same process.

Each plan is made by a process of its own, whose largest memory is counted, too.
"""

import resource
from multiprocessing import get_context
from time import process_time
from typing import Any, NamedTuple

from flexslew_control.planners import make_plan, plan_settings
from flexslew_control.planners.minimax.members import Ensemble, members_of
from flexslew_control.planners.slew import slew_of
from flexslew_lab.notebook import trial
from flexslew_lab.trial.trial import feedback_of, plant_of

_DURATIONS = (25.0, 30.0, 40.0, 60.0)  # of M1 [s]
_M1: dict[str, Any] = {"goal": {"base_yaw": 1.0, "hub_pitch": 0.5}, "model": {"modes": 3}}
_OSCILLATOR: dict[str, Any] = {"goal": {"mass": 1.0}, "duration": 10.0, "pieces": 60}
_MEBIBYTE = 1024.0  # of the kibibytes that the kernel counts


class _Cost(NamedTuple):
    seconds: float  # of processor time
    floor: float  # one flight of every member for each program that was solved [s]
    left: float  # worst residual [m]
    mebibytes: float  # largest resident memory of the process


def _cost(name: str, section: dict[str, Any]) -> _Cost:
    """Return what a plan takes, once the compiled code is loaded."""
    what = trial(name)
    plant, feedback = plant_of(what), feedback_of(what)
    values = {"method": "minimax_feedforward", **section}
    short = {"duration": 20.0, "pieces": 8, "max_steps": 2, "ensemble": {"vary": {}}}
    make_plan(plan_settings({**values, **short}, "bench"), plant, feedback)
    settings = plan_settings(values, "bench")
    start = process_time()
    plan = make_plan(settings, plant, feedback)
    seconds = process_time() - start
    slew = slew_of(settings, plant, feedback)
    at_start, effort = plan.state[0].copy(), plan.effort.copy()
    start = process_time()
    for member in members_of(Ensemble(), slew):
        member.model.path(at_start, effort, slew.period)
    floor = (process_time() - start) * max(int(plan.summary["iterations"]), 1)
    most = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / _MEBIBYTE
    return _Cost(seconds, floor, float(plan.summary["worst_residual"]), most)


def figures() -> dict[str, float]:
    """Return what it takes to plan M1 with three modes, and the oscillator, over 20 % of stiffness.

    minimax_m1_*_s: processor time for a slew of so many seconds; minimax_oscillator_s: of 10 s,
    with 60 pieces and 11 members [s].
    *_ratio: that over the floor, one bare flight of 11 members for each program solved [-].
    *_left_mm: the largest tip deflection that is left on any member [mm].
    *_mib: largest memory of the process that plans [MiB].
    """
    cases = {f"m1_{t:g}": ("m1", {**_M1, "duration": t}) for t in _DURATIONS}
    cases["oscillator"] = ("time_optimal_oscillator", _OSCILLATOR)
    found: dict[str, float] = {}
    for name, asked in cases.items():
        with get_context("spawn").Pool(1) as alone:
            cost = alone.apply(_cost, asked)
        found[f"minimax_{name}_s"] = cost.seconds
        found[f"minimax_{name}_ratio"] = cost.seconds / cost.floor
        found[f"minimax_{name}_left_mm"] = 1e3 * cost.left
        found[f"minimax_{name}_mib"] = cost.mebibytes
    return found
