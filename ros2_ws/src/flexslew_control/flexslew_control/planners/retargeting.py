"""The planner of retargeting manoeuvres: what balances the inertial loading, and changing gains.

The turns of the hinges are the testbed's; the plan holds, tick by tick, the efforts -(B*)^+ d(t)
(Kwak 1989, (3-5)) and the gains of a regulator with an integral, with its Riccati equation solved
by perturbation or adiabatically ((3-25) to (3-56)).
"""

from itertools import pairwise
from typing import Any, Literal, NamedTuple

import numpy as np

from flexslew_control.controllers.lqr import disturbance_gain
from flexslew_control.linear.perturbation import (
    Change,
    EndCondition,
    Regulator,
    backward,
    regulator,
    require_positive_definite,
)
from flexslew_control.linear.small_motion import (
    Frozen,
    SmallMotion,
    last_rotation_end,
    require_full_rank,
    small_motion,
)
from flexslew_control.plan import Plan
from flexslew_control.planners.entry import PlannerEntry, PlanTask
from flexslew_control.planners.slew import require_effort, tick_times
from flexslew_control.shared_keys import Start, WholeModel
from flexslew_plant.arrays import Matrix, Vector
from flexslew_plant.errors import BadInput
from flexslew_plant.settings import Positive, plain, section
from flexslew_plant.testbeds import design_testbed

_AFTER = 1e-9  # the end of a turn, for good [s]
_TOO_WEAK = (
    "the turns need {:.4g} on {} to be balanced, the limit is {:g}; take more time for them or a "
    "higher limit"
)
_GAUSS = 0.5 * np.array([-1.0, 1.0]) / np.sqrt(3.0) + 0.5  # two places in a tick


@section
class VaryingWeights:
    """Q and R of the regulator of (eta, eta', p), p the whole modal force (3-32)."""

    # weight on every modal coordinate and rate, in the units of the testbed's section
    state: Positive = 1.0
    force: Positive = 1.0  # weight on every modal force
    force_rate: Positive = 0.01  # weight on the rate of every modal control force


@section
class Retargeting:
    """Efforts that balance antennas in prescribed turns, and gains along them."""

    method: Literal["retargeting"] = "retargeting"
    model: WholeModel = None
    start: Start = 0.0
    duration: Positive | None = None  # length of the plan [s]; null: until the last turn has ended
    # none, or disturbance_minimisation: the efforts -(B*)^+ d(t)
    feedforward: Literal["none", "disturbance_minimisation"] = "none"
    # gains for controller planned_gains at each tick
    gains: Literal["none", "constant", "perturbation", "adiabatic"] = "none"
    # of the perturbation at the end of the turns
    end_condition: EndCondition = "adiabatic"
    weights: VaryingWeights = VaryingWeights()  # of the regulator behind the gains


class _Ticks(NamedTuple):
    """The ticks of a manoeuvre and the small motions in their middle."""

    motion: SmallMotion
    period: float
    middle: list[Frozen]  # of every tick, then of what stays


def plan_retargeting(task: PlanTask) -> Plan:
    """Return the plan of a retargeting manoeuvre.

    Raises:
        BadInput: if the section has no duration and no hinge turns after the start, two efforts
            are dependent, or the gains have no solution.
        ExcessTorque: if it needs more effort than the drives have.
    """
    settings: Retargeting = task.settings
    plant = task.plant
    whole = settings.model is None
    testbed = (
        plant.testbed
        if whole
        else design_testbed(plant.testbed, settings.model, "plan: model", plant.trust)
    )
    until = last_rotation_end(testbed)
    duration = settings.duration or until - settings.start
    if not duration > 0.0:
        raise BadInput("no hinge turns after the start", "plan", "duration", "null")
    times = settings.start + tick_times(settings.start, duration, plant.period)
    motion = small_motion(testbed, max(until, float(times[-1])))
    ticks = len(times) - 1
    model = motion.model
    effort: Matrix = np.zeros((ticks, model.efforts))
    summary: dict[str, Any] = {"duration": duration}
    if settings.feedforward != "none":
        effort, left = balance_efforts(motion, times[:-1], plant.period)
        summary |= {"unbalanced": left}
        require_effort(_peak(effort), plant.effort_limit, model.joint_names, _TOO_WEAK)
    rows = np.zeros((0, 0))
    if settings.gains != "none":
        middle = [motion.at(t) for t in times[:-1] + 0.5 * plant.period]
        middle.append(motion.at(max(until, float(times[-1])) + _AFTER))
        rows, details = gain_schedule(settings, _Ticks(motion, plant.period, middle))
        summary |= details
    summary["peak_effort"] = _peak(effort).tolist()
    rest_state = np.concatenate((motion.rest, np.zeros(model.coordinates)))
    rest = np.tile(model.joint_state(rest_state)[0], (ticks + 1, 1))
    return Plan(
        method=settings.method,
        joint_names=model.joint_names,
        start=settings.start,
        period=plant.period,
        position=rest,
        velocity=np.zeros_like(rest),
        effort=effort,
        state=np.zeros((ticks + 1, 0)),
        duration=duration,
        gains=rows,
        request=plain(settings),
        summary=summary,
    )


def balance_efforts(
    motion: SmallMotion, begin: Vector, period: float
) -> tuple[Matrix, dict[str, float]]:
    """Return -(B*)^+ d, its mean over every tick, in SI, and the largest d that is left.

    Args:
        motion: what moves.
        begin: of every tick, shape (ticks,) [s].
        period: one tick [s].

    Raises:
        BadInput: B* has no full column rank.
    """
    effort = np.zeros((len(begin), motion.model.efforts))
    left = np.zeros(len(motion.kept))
    for k, t in enumerate(begin):
        for share in _GAUSS:
            frozen = motion.at(t + share * period)
            if not frozen.disturbance.any():
                continue
            require_full_rank(frozen, motion)
            b, d = frozen.input_matrix, frozen.disturbance
            u = -(disturbance_gain(b) @ d)
            effort[k] += 0.5 * u
            left = np.maximum(left, abs(d + b @ u))
    return effort * motion.units.efforts, dict(zip(motion.names, left.tolist(), strict=True))


def gain_schedule(settings: Retargeting, ticks: _Ticks) -> tuple[Matrix, dict[str, Any]]:
    """Return [Kp, Kd, Ki] on all coordinates for each tick and for all after, row by row, in SI.

    Raises:
        BadInput: there is not one effort for each coordinate, or no solution.
    """
    motion, w = ticks.motion, settings.weights
    before = motion.before(settings.start)
    k, m = before.input_matrix.shape
    if k != m:
        raise BadInput(
            f"it needs one effort for each motion, and {m} efforts move {k} coordinates "
            f"({', '.join(motion.names)})",
            "plan",
            "gains",
            settings.gains,
        )
    require_full_rank(before, motion)
    weight = np.diag([w.state] * (2 * k) + [w.force] * k)
    r = regulator(before, weight, w.force_rate * np.eye(k))
    if settings.gains == "constant":
        changes: list[Change | None] = [None] * len(ticks.middle)
        first: list[Matrix | None] = [None] * len(ticks.middle)
    else:
        changes = [r.change(frozen) for frozen in ticks.middle]
        first = list(_first_order(settings, r, changes, ticks.period))
    rows = []
    inverse = np.linalg.inv(r.modes)
    for frozen, change, p in zip(ticks.middle, changes, first, strict=True):
        gains = r.gains(change, p)
        requested = np.hstack(
            [g @ inverse for g in (gains.proportional, gains.rate, gains.integral)]
        )
        u = np.linalg.solve(r.modes.T @ frozen.input_matrix, requested)
        rows.append(motion.gains(u).ravel())
    details = {"frequencies": np.sqrt(r.squares).tolist(), "slowest_pole": _largest_real_part(r)}
    return np.array(rows), details


def _first_order(
    settings: Retargeting, r: Regulator, changes: list[Any], period: float
) -> list[Matrix]:
    """Return P1 in the middle of every tick, and after the last."""
    if settings.gains == "adiabatic":
        found = [r.adiabatic(change) for change in changes]
        require_positive_definite(r.riccati + found[-1], "gains: adiabatic")
        return found
    edges = backward(r, changes, period, settings.end_condition)
    return [0.5 * (a + b) for a, b in pairwise(edges)] + edges[-1:]


def _largest_real_part(r: Regulator) -> float:
    return float(np.linalg.eigvals(r.closed_loop).real.max())


def _peak(effort: Matrix) -> Vector:
    return np.asarray(abs(effort).max(axis=0, initial=0.0))


RETARGETING = PlannerEntry(
    Retargeting,
    plan_retargeting,
    slews=False,
    by_law={"feedforward": "none", "gains": "none"},
)
