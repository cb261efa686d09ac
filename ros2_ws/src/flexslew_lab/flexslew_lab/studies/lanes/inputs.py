"""What the lanes of a group are given: schedule, aim, gains, errors of the sensors."""

from collections.abc import Sequence
from dataclasses import is_dataclass
from functools import lru_cache
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from flexslew_control.controllers.controller import Controller
from flexslew_control.law import Reference
from flexslew_control.plan import Plan
from flexslew_lab.metrics.from_bag import manoeuvre_of
from flexslew_lab.metrics.metric import FlownManoeuvre
from flexslew_lab.studies.lanes.benches.lane_faults import faults_of
from flexslew_lab.studies.lanes.groups.lane_laws import Beside, by_lane
from flexslew_lab.studies.lanes.groups.lane_trial import LaneTrial, read_channels
from flexslew_lab.studies.lanes.laws.efforts import LawNumbers, Troubles
from flexslew_lab.studies.lanes.loop import Schedule
from flexslew_lab.trial.trial import Trial
from flexslew_plant.arrays import NOTHING, Matrix, Tensor, Vector, kept
from flexslew_plant.bench.wire import stamp_of
from flexslew_plant.hardware.actuator import motor_numbers, shortest_impulses
from flexslew_plant.hardware.disturbances import disturbance_effort
from flexslew_plant.testbeds.compiled.lanes import LANES
from flexslew_plant.testbeds.model import Model


class LaneCourse(NamedTuple):
    """A plan tick by tick."""

    references: list[Reference]  # of every tick
    time: Vector  # stamps, (ticks + 1,) [s]
    over: NDArray[np.bool_]  # the manoeuvre is, (ticks + 1,)
    started: NDArray[np.bool_]  # it has, (ticks + 1,)
    position: Matrix  # of the joints, (ticks, joints)
    velocity: Matrix


def course_of(plan: Plan, ticks: int) -> LaneCourse:
    """Return a plan tick by tick."""
    references = [plan.reference(k) for k in range(ticks)]
    time = _stamps(plan.period, ticks)
    return LaneCourse(
        references,
        time,
        time >= plan.start + plan.duration - 1e-9,
        time >= plan.start - 1e-9,
        np.array([r.position for r in references]),
        np.array([r.velocity for r in references]),
    )


def resting_course(hold: Vector, period: float, ticks: int) -> LaneCourse:
    """Return the course of a controller that has no plan and holds its first measured position.

    Args:
        hold: positions of the joints, shape (joints,) [rad or m].
        period: one tick [s].
        ticks: of the trial.
    """
    still, always = np.zeros(hold.size), np.ones(ticks + 1, np.bool_)
    return LaneCourse(
        [Reference(hold, still, still, NOTHING)] * ticks,
        _stamps(period, ticks),
        always,
        always,
        np.tile(hold, (ticks, 1)),
        np.tile(still, (ticks, 1)),
    )


@lru_cache(maxsize=4)
def _stamps(period: float, ticks: int) -> Vector:
    """Return the stamps of ticks as the log has them, shape (ticks + 1,) [s]."""
    stamps = (stamp_of(k * period) for k in range(ticks + 1))
    return kept(np.array([stamp.sec + stamp.nanosec * 1e-9 for stamp in stamps]))


def schedule_of(course: LaneCourse) -> Schedule:
    """Return what is the same in every lane, tick by tick."""
    return Schedule(*course[1:])


def troubles_of(lanes: Sequence[LaneTrial], filled: int, ticks: int) -> Troubles:
    """Return what disturbs and breaks a group, of which the first lanes are filled."""
    found: list[Matrix] = []
    for before, lane in zip([None, *lanes], lanes, strict=False):
        alike = before is not None and before.happens.disturbances == lane.happens.disturbances
        found.append(found[-1] if alike else _disturbance(lane, ticks))
    apart = any(one is not found[0] for one in found)
    disturbance = np.stack(found, axis=-1) if apart else found[0][:, :, None]
    return Troubles(disturbance, faults_of(lanes[:filled], ticks))


def _disturbance(lane: LaneTrial, ticks: int) -> Matrix:
    model, period = lane.model, lane.trial.period
    total = np.zeros((ticks, model.joints))
    for timed in lane.happens.disturbances:
        if not any(map(is_dataclass, timed.shapes.values())):
            steady = disturbance_effort(timed, timed.start, model.joint_names, period)
            total[timed.start : int(min(timed.end, ticks))] += steady
            continue
        for k in range(timed.start, int(min(timed.end, ticks))):
            total[k] += disturbance_effort(timed, k, model.joint_names, period)
    return total


def aim_of(lane: LaneTrial, plan: Plan | None) -> tuple[Vector, FlownManoeuvre]:
    """Return what a group is measured against: rows `tip`, `goal`, displacement; as a record."""
    testbed, nowhere = lane.trial.testbed, np.zeros(lane.model.joints)
    goal = FlownManoeuvre(0.0, 0.0, None, nowhere)
    if plan is not None:
        goal = manoeuvre_of(plan.position, plan.velocity, plan.start, plan.duration, testbed)
    place = np.nan + nowhere if goal.goal is None else goal.goal
    tip = lane.model.appendages.tip.ravel()
    return np.concatenate((tip, place, goal.displacement)), goal


def tips_measured(shares: Matrix) -> int:
    """Return how many of the first tips there are beyond which none bends further.

    Of two appendages that bend antisymmetrically it is the first one alone.

    Args:
        shares: of each mode in each tip, (tips, modes).
    """
    found = 0
    for k, own in enumerate(shares):
        before = shares[:k]
        again = (own == before).all(axis=1) | (own == -before).all(axis=1)
        if own.any() and not again.any():
            found = k + 1
    return found


def drives_of(lanes: list[LaneTrial]) -> Matrix:
    """Return of every lane limits, least efforts, shortest impulses, rows `motor` and `spin`."""
    found = list[Vector]()
    for before, lane in zip([None, *lanes], lanes, strict=False):
        alike = before is not None and _have_same_drives(before, lane)
        found.append(found[-1] if alike else _drives(lane.trial, lane.model))
    return np.array(found)


def _have_same_drives(one: LaneTrial, other: LaneTrial) -> bool:
    first, second = one.trial, other.trial
    settings = second.actuator, second.testbed.effort_limit
    if (first.actuator, first.testbed.effort_limit) != settings:
        return False
    own, spins = one.model.spins, other.model.spins
    return own is spins or all(
        a.tobytes() == b.tobytes()
        for a, b in ((own.inertia, spins.inertia), (own.fastest, spins.fastest))
    )


def _drives(trial: Trial, model: Model) -> Vector:
    limit = np.array(trial.testbed.effort_limit)
    impulse = shortest_impulses(trial.actuator, model.joint_names, limit, trial.period)
    motors = motor_numbers(trial.actuator, limit, trial.period, impulse, model.one_way)
    own, spins = model.spins, np.zeros((2, limit.size))
    spins[:, own.efforts] = own.inertia / trial.period, own.fastest
    return np.concatenate((*motors[:3], motors[3:-1], *spins))


def spun_by(lanes: Sequence[LaneTrial]) -> tuple[int, ...]:
    """Return which entry of the state is the speed of each joint's wheel, -1 of what has none.

    Where no wheel of any lane has a limit it is empty.
    """
    wheels = lanes[0].model.spins
    limited = np.isfinite([lane.model.spins.fastest for lane in lanes]).any(axis=0)
    rates = np.full(lanes[0].model.joints, -1)
    rates[wheels.efforts[limited]] = wheels.rate[limited]
    return tuple(rates.tolist()) if limited.any() else ()


def gains_of(controller: Controller) -> Vector:
    """Return kp, ki and kd of a law with gains that lanes have for themselves."""
    built: Any = controller.law
    built = getattr(built, "law", built)  # of which the torque is allocated
    gains = getattr(built, "deviation", built)
    return np.concatenate((gains.kp, getattr(gains, "ki", np.zeros(gains.kp.size)), gains.kd))


def positions_of(lanes: Sequence[LaneTrial], schedule: Schedule) -> Tensor:
    """Return the positions that joints shall have, (ticks, joints, 1), or (1, joints, LANES)."""
    holds = [lane.hold for lane in lanes if lane.hold is not None]
    if any(hold is not holds[0] and (hold != holds[0]).any() for hold in holds):
        return np.array(holds).T[None].copy()
    return schedule.position[:, :, None]


def numbers_of(
    group: Beside, position: Tensor, velocity: Matrix, since: int, blended: int
) -> LawNumbers:
    """Return the laws of a group for the loop.

    Args:
        group: the laws.
        position: that they follow, (ticks or 1, axes, 1 or LANES).
        velocity: that they follow, (ticks, axes).
        since: tick at which they take over; -1: they are in charge from the start.
        blended: ticks in which the efforts of the one before are blended out.
    """
    laws = group.laws
    return LawNumbers(
        position,
        velocity,
        by_lane(laws, "from_state", 2),
        by_lane(laws, "from_output", 2),
        by_lane(laws, "to_integral", 2),
        by_lane(laws, "quadratic", 2),
        by_lane(laws, "demand", 1),
        by_lane(laws[:1], "integrand", 1),
        laws[0].integral,
        laws[0].unwinding,
        since,
        blended,
        group.allocation,
    )


def quanta_of(lanes: Sequence[LaneTrial], outputs: int) -> Matrix:
    """Return the quanta of what the law reads, (outputs, LANES); 0: none."""
    m, tips = lanes[0].model.joints, outputs - 2 * lanes[0].model.joints
    channels = [read_channels(lane.trial) for lane in lanes]
    steps = np.array([[channel.quantisation for channel in own] for own in channels]).T
    return np.repeat(steps, (m, m, tips), axis=0)


def errors_of(lanes: list[LaneTrial], outputs: int, readings: int) -> Matrix:
    """Return bias and noise of what the law reads, (readings or 1, outputs LANES)."""
    m, tips = lanes[0].model.joints, len(lanes[0].model.appendages.names)
    widths = (m, m, tips, tips)
    channels = ("joint_position", "joint_velocity", "tip_deflection", "root_curvature")
    noisy = any(channel.noise for lane in lanes for channel in read_channels(lane.trial))
    error = np.zeros((readings if noisy else 1, outputs, LANES))
    for k, lane in enumerate(lanes):
        alike = not noisy and k > 0 and lane.trial.sensors is lanes[k - 1].trial.sensors
        if alike or (k > 0 and lane is lanes[k - 1]):  # which only fills up
            error[:, :, k] = error[:, :, k - 1]
            continue
        each = [getattr(lane.trial.sensors, name) for name in channels]
        drawn = [w if channel.noise else 0 for w, channel in zip(widths, each, strict=True)]
        noise = np.zeros((0, 0))
        if noisy:
            rng = np.random.default_rng([lane.trial.seed, 0])  # as Bench.reset, epoch 0
            own = lane.model.appendages.errors  # of single tips, drawn after those of all
            more = 0 if own is None or not own.any() else tips
            noise = rng.standard_normal((readings, sum(drawn) + more))
        at, column = 0, 0
        for width, channel, count in zip(widths, each, drawn, strict=True):
            read = min(width, outputs - at)
            if read > 0:
                error[:, at : at + read, k] = channel.bias
                if count:
                    each_tick = noise[:, column : column + read]
                    error[:, at : at + read, k] += channel.noise * each_tick
            at, column = at + width, column + count
    return error.reshape(len(error), outputs * LANES)
