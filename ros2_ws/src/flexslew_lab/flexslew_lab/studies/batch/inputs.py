"""What the members of a group are given: schedule, aim, gains, errors of the sensors."""

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
from flexslew_lab.metrics.metric import ReferenceManoeuvre
from flexslew_lab.studies.batch.benches.batch_faults import faults_of
from flexslew_lab.studies.batch.groups.batch_laws import BatchLaws, by_member
from flexslew_lab.studies.batch.groups.batch_trial import BatchTrial
from flexslew_lab.studies.batch.laws.efforts import Disturbances, LawNumbers
from flexslew_lab.studies.batch.loop import Schedule
from flexslew_lab.trial.trial import Trial
from flexslew_plant.arrays import EMPTY, Matrix, Tensor, Vector, read_only
from flexslew_plant.bench.wire import stamp_of
from flexslew_plant.hardware.actuator import minimum_impulse, motor_numbers
from flexslew_plant.hardware.disturbances import disturbance_effort
from flexslew_plant.hardware.sensor_step import SensorNumbers
from flexslew_plant.hardware.sensors import sensor_numbers
from flexslew_plant.testbeds.compiled.batch_kernel import BATCH_WIDTH
from flexslew_plant.testbeds.model import Model


class PlanTable(NamedTuple):
    """A plan tick by tick."""

    references: list[Reference]  # of every tick
    time: Vector  # stamps, (ticks + 1,) [s]
    over: NDArray[np.bool_]  # the manoeuvre is, (ticks + 1,)
    started: NDArray[np.bool_]  # it has, (ticks + 1,)
    position: Matrix  # of the joints, (ticks, joints)
    velocity: Matrix


def tabulate_plan(plan: Plan, ticks: int) -> PlanTable:
    """Return a plan tick by tick."""
    references = [plan.reference(k) for k in range(ticks)]
    time = _tick_times(plan.period, ticks)
    return PlanTable(
        references,
        time,
        time >= plan.start + plan.duration - 1e-9,
        time >= plan.start - 1e-9,
        np.array([r.position for r in references]),
        np.array([r.velocity for r in references]),
    )


def tabulate_hold(hold_position: Vector, period: float, ticks: int) -> PlanTable:
    """Return the course of a controller that has no plan and holds its first measured position.

    Args:
        hold_position: positions of the joints, shape (joints,) [rad or m].
        period: one tick [s].
        ticks: of the trial.
    """
    zero, always = np.zeros(hold_position.size), np.ones(ticks + 1, np.bool_)
    return PlanTable(
        [Reference(hold_position, zero, zero, EMPTY)] * ticks,
        _tick_times(period, ticks),
        always,
        always,
        np.tile(hold_position, (ticks, 1)),
        np.tile(zero, (ticks, 1)),
    )


@lru_cache(maxsize=4)
def _tick_times(period: float, ticks: int) -> Vector:
    """Return the stamps of ticks as the log has them, shape (ticks + 1,) [s]."""
    times = (stamp_of(k * period) for k in range(ticks + 1))
    return read_only(np.array([stamp.sec + stamp.nanosec * 1e-9 for stamp in times]))


def schedule_of(table: PlanTable) -> Schedule:
    """Return what is the same in every member, tick by tick."""
    return Schedule(*table[1:])


def disturbances_of(members: Sequence[BatchTrial], filled: int, ticks: int) -> Disturbances:
    """Return what disturbs and breaks a group, of which the first batches are filled."""
    found: list[Matrix] = []
    for before, member in zip([None, *members], members, strict=False):
        same = before is not None and before.happens.disturbances == member.happens.disturbances
        found.append(found[-1] if same else _disturbance(member, ticks))
    per_member = any(one is not found[0] for one in found)
    disturbance = np.stack(found, axis=-1) if per_member else found[0][:, :, None]
    return Disturbances(disturbance, faults_of(members[:filled], ticks))


def _disturbance(member: BatchTrial, ticks: int) -> Matrix:
    model, period = member.model, member.trial.period
    total = np.zeros((ticks, model.joints))
    for timed in member.happens.disturbances:
        if not any(map(is_dataclass, timed.shapes.values())):
            steady = disturbance_effort(timed, timed.start, model.joint_names, period)
            total[timed.start : int(min(timed.end, ticks))] += steady
            continue
        for k in range(timed.start, int(min(timed.end, ticks))):
            total[k] += disturbance_effort(timed, k, model.joint_names, period)
    return total


def target_of(member: BatchTrial, plan: Plan | None) -> tuple[Vector, ReferenceManoeuvre]:
    """Return what a group is measured against: rows `tip`, `goal`, displacement; as a record."""
    testbed, origin = member.trial.testbed, np.zeros(member.model.joints)
    goal = ReferenceManoeuvre(0.0, 0.0, None, origin)
    if plan is not None:
        goal = manoeuvre_of(plan.position, plan.velocity, plan.start, plan.duration, testbed)
    place = np.nan + origin if goal.goal is None else goal.goal
    tip = member.model.appendages.tip.ravel()
    return np.concatenate((tip, place, goal.displacement)), goal


def tips_measured(mode_shapes: Matrix) -> int:
    """Return how many of the first tips there are beyond which none bends further.

    Of two appendages that bend antisymmetrically it is the first one alone.

    Args:
        mode_shapes: of each mode in each tip, (tips, modes).
    """
    found = 0
    for k, entry in enumerate(mode_shapes):
        before = mode_shapes[:k]
        duplicate = (entry == before).all(axis=1) | (entry == -before).all(axis=1)
        if entry.any() and not duplicate.any():
            found = k + 1
    return found


def drives_of(members: list[BatchTrial]) -> Matrix:
    """Return of every member limits, least efforts, shortest impulses, rows `motor` and `spin`."""
    found = list[Vector]()
    for before, member in zip([None, *members], members, strict=False):
        same = before is not None and _have_same_drives(before, member)
        found.append(found[-1] if same else _drives(member.trial, member.model))
    return np.array(found)


def _have_same_drives(one: BatchTrial, other: BatchTrial) -> bool:
    first, second = one.trial, other.trial
    settings = second.actuator, second.testbed.effort_limit
    if (first.actuator, first.testbed.effort_limit) != settings:
        return False
    entry, wheels = one.model.spins, other.model.spins
    return entry is wheels or all(
        a.tobytes() == b.tobytes()
        for a, b in ((entry.inertia, wheels.inertia), (entry.fastest, wheels.fastest))
    )


def _drives(trial: Trial, model: Model) -> Vector:
    limit = np.array(trial.testbed.effort_limit)
    impulse = minimum_impulse(trial.actuator, model.joint_names, limit, trial.period)
    motors = motor_numbers(trial.actuator, limit, trial.period, impulse, model.one_way)
    entry, wheels = model.spins, np.zeros((2, limit.size))
    wheels[:, entry.efforts] = entry.inertia / trial.period, entry.fastest
    return np.concatenate((*motors[:3], motors[3:-1], *wheels))


def wheel_rates_of(members: Sequence[BatchTrial]) -> tuple[int, ...]:
    """Return which entry of the state is the speed of each joint's wheel, -1 of what has none.

    Where no wheel of any member has a limit it is empty.
    """
    wheels = members[0].model.spins
    limited = np.isfinite([member.model.spins.fastest for member in members]).any(axis=0)
    rates = np.full(members[0].model.joints, -1)
    rates[wheels.efforts[limited]] = wheels.rate[limited]
    return tuple(rates.tolist()) if limited.any() else ()


def gains_of(controller: Controller) -> Vector:
    """Return kp, ki and kd of a law with gains that batches have for themselves."""
    built: Any = controller.law
    built = getattr(built, "law", built)  # of which the torque is allocated
    gains = getattr(built, "deviation", built)
    return np.concatenate((gains.kp, getattr(gains, "ki", np.zeros(gains.kp.size)), gains.kd))


def positions_of(members: Sequence[BatchTrial], schedule: Schedule) -> Tensor:
    """Return the reference positions, (ticks, joints, 1), or (1, joints, BATCH_WIDTH)."""
    hold_positions = [member.hold for member in members if member.hold is not None]
    if any(
        hold_position is not hold_positions[0] and (hold_position != hold_positions[0]).any()
        for hold_position in hold_positions
    ):
        return np.array(hold_positions).T[None].copy()
    return schedule.position[:, :, None]


def numbers_of(
    group: BatchLaws, position: Tensor, velocity: Matrix, since: int, transition_ticks: int
) -> LawNumbers:
    """Return the laws of a group for the loop.

    Args:
        group: the laws.
        position: that they follow, (ticks or 1, axes, 1 or BATCH_WIDTH).
        velocity: that they follow, (ticks, axes).
        since: tick at which they take over; -1: they are in charge from the start.
        transition_ticks: ticks in which the efforts of the one before are blended out.
    """
    laws = group.laws
    return LawNumbers(
        position,
        velocity,
        by_member(laws, "from_state", 2),
        by_member(laws, "from_output", 2),
        by_member(laws, "to_integral", 2),
        by_member(laws, "quadratic", 2),
        by_member(laws, "demand", 1),
        by_member(laws[:1], "integrand", 1),
        *laws[0].integration[:2],
        since,
        transition_ticks,
        group.allocation,
    )


class SensorErrors(NamedTuple):
    """The errors of what the law reads."""

    bias: Matrix  # (outputs, BATCH_WIDTH)
    quantum: Matrix  # (outputs, BATCH_WIDTH)
    noise: Matrix  # of each tick, (readings, outputs BATCH_WIDTH); without rows: none


def errors_of(members: Sequence[BatchTrial], outputs: int, readings: int) -> SensorErrors:
    """Return the errors of what the law reads, of so many ticks."""
    numbers, constants = list[SensorNumbers](), list[Matrix]()
    for before, member in zip([None, *members], members, strict=False):
        if before is None or not _have_same_sensors(before, member):
            found, each = sensor_numbers(member.trial.sensors, member.model), np.zeros((2, outputs))
            read = found.place < outputs
            each[:, found.place[read]] = found.bias[read], found.quantum[read]
        numbers.append(found)
        constants.append(each)
    noisy = any((one.column[one.place < outputs] >= 0).any() for one in numbers)
    noise = np.zeros((readings if noisy else 0, outputs, BATCH_WIDTH))
    for k, (member, found) in enumerate(zip(members, numbers, strict=True)):
        if noisy and k > 0 and member is members[k - 1]:  # which only fills up
            noise[:, :, k] = noise[:, :, k - 1]
        elif noisy:
            drawn = found.draw(np.random.default_rng([member.trial.seed, 0]), readings)  # epoch 0
            for at, column in zip(found.place, found.column, strict=True):
                if at < outputs and column >= 0:
                    noise[:, at, k] = drawn[:, column]
    bias, quantum = np.moveaxis(np.array(constants), 0, -1)
    return SensorErrors(bias, quantum, noise.reshape(len(noise), outputs * BATCH_WIDTH))


def _have_same_sensors(one: BatchTrial, other: BatchTrial) -> bool:
    same = one.model.appendages.errors is other.model.appendages.errors
    return same and one.trial.sensors is other.trial.sensors
