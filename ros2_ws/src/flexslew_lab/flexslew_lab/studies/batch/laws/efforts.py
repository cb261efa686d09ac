"""From what the laws of all members know to the efforts of their drives, as machine code.

The law and the drives are loops over members that become vector instructions. The torque of a law
on body axes is shared out among drives member after member, by the function of the bench.
"""

from collections.abc import Callable
from typing import Any, NamedTuple, cast

import numpy as np

from flexslew_control.allocation.sharing import AllocationNumbers, share
from flexslew_control.controllers.by_joint.integral_action import integral_step
from flexslew_control.controllers.by_joint.pd_feedforward import pd_step
from flexslew_control.controllers.controller import handover_effort
from flexslew_lab.studies.batch.benches.batch_faults import BatchFaults, effort_faults
from flexslew_lab.studies.batch.benches.readings import GUARD
from flexslew_lab.studies.batch.groups.rows import Rows, Sizes
from flexslew_lab.studies.batch.laws.observers import add_products
from flexslew_lab.studies.batch.laws.turned import RotationJoints
from flexslew_plant.arrays import Matrix, Tensor, Vector, called, compiled, put, vectorised
from flexslew_plant.hardware.motor_step import (
    Motor,
    MotorMemory,
    motor_step,
    speed_limited_effort,
)
from flexslew_plant.testbeds.compiled.batch_kernel import BATCH_WIDTH, member_rows, skip
from flexslew_plant.testbeds.orientation.attitude import joint_rotation_vector


class LawNumbers(NamedTuple):
    """The law of every member; tensors by batch_laws.by_member. See linear_form.LawForm."""

    position: Tensor  # that it follows, (ticks, axes, 1), or one tick of every member's
    velocity: Matrix  # (ticks, axes)
    from_state: Tensor
    from_output: Tensor
    to_integral: Tensor
    quadratic: Tensor
    demand: Tensor
    integrand: Tensor  # the same in all members
    integral: bool
    tracking_rate: float
    since: int  # tick at which it took over; -1: it was in charge from the start
    transition_ticks: int  # ticks in which the efforts of the one before are blended out
    allocation: Any  # sharing.AllocationNumbers; None: its efforts are those of the joints


class Disturbances(NamedTuple):
    """What disturbs the members, and what breaks in them."""

    disturbance: Tensor  # (ticks, joints, 1 or BATCH_WIDTH) [N m or N]
    faults: BatchFaults | None  # None: there are none


class FlightNumbers(NamedTuple):
    """The constants of a group in flight with one law."""

    dt: float  # one tick [s]
    steps: int  # of the kernel in a tick
    filled: int  # members in use, the first ones
    schedule: Any  # loop.Schedule
    disturbances: Disturbances
    law: LawNumbers
    noise: Matrix  # of the readings, (ticks + 1 or 0, outputs BATCH_WIDTH)
    sensor_check: Any  # judge.SensorCheck
    monitor: Any  # watch.Watch
    rotation_joints: RotationJoints
    instruments: Any  # senses.SensorData
    external_forces: Any  # see pushed
    friction: Any  # see batch_friction
    observer: Any  # as the ObserverStep takes it


class LawTerms(NamedTuple):
    """Which of the law's products there are; a loop computes no others."""

    own: bool  # each member has a demand of its own
    per_member: bool  # each member holds a position of its own
    state: bool
    output: bool
    integral: bool

    @classmethod
    def of(cls, law: LawNumbers) -> "LawTerms":
        """Return those of a law."""
        products = (law.from_state, law.from_output, law.to_integral)
        per_member = law.position.shape[2] > 1
        return cls(
            law.demand.shape[2] > 1, per_member, *(bool(product.any()) for product in products)
        )


_joint_effort, _integral = called(pd_step), called(integral_step)
_handover_effort = called(handover_effort)


def efforts_of(total: int, rows: Rows, sizes: Sizes, terms: LawTerms) -> Callable[..., None]:
    """Return what writes the efforts of a tick and takes the integral to the next one.

    It takes (k, t, FlightNumbers, z, w).

    Args:
        total: where the efforts stand that the kernel holds.
        rows: of the group.
        sizes: of the group.
        terms: of the law.
    """
    m, n, shared, quadratic = sizes.joints, sizes.axes, sizes.shared, sizes.quadratic
    member_demand, per_member, from_state, from_output, _ = terms
    reading, products, kp, kd = rows.reading, rows.products, rows.kp, rows.kd
    seen, effort = (rows.seen, rows.demand) if shared else (reading, rows.applied)
    (update_attitude, set_effort), drive = _sharing(rows, sizes), _drive(total, rows, sizes)
    multiply, apply_transition = _multiply(seen, rows, sizes), _transition(rows, sizes)
    integrate = _integrate(seen, effort, rows, sizes, terms)
    applied, initial_effort, taken = rows.applied, rows.held, m * BATCH_WIDTH * sizes.taken

    @vectorised
    def efforts(k: int, t: float, flight: FlightNumbers, z: Vector, w: Vector) -> None:
        law, dt, filled, disturbances = flight.law, flight.dt, flight.filled, flight.disturbances
        if k == law.since:
            for at in range(taken):
                w[initial_effort + at] = w[applied + at]
        update_attitude(flight.rotation_joints, w, filled)
        multiply(w)
        demand_of = law.demand
        for i in range(n):
            row = i * BATCH_WIDTH
            position, tick = law.position, 0 if per_member else k
            base, wanted, wanted_rate = demand_of[k, i, 0], position[tick, i, 0], law.velocity[k, i]
            for member in range(BATCH_WIDTH):
                at = row + member
                feedforward = demand_of[k, i, member] if member_demand else base
                error = (position[0, i, member] if per_member else wanted) - w[seen + at]
                rate_error = wanted_rate - w[seen + n * BATCH_WIDTH + at]
                w[effort + at], _, _ = _joint_effort(
                    w[kp + at], w[kd + at], feedforward, error, rate_error
                )
            if from_state:
                add_products(law.from_state, k, i, z, 0, 1.0, w, effort + row)
            if from_output:
                add_products(law.from_output, k, i, w, reading, 1.0, w, effort + row)
            if quadratic:
                add_products(law.quadratic, 0, i, w, products, 1.0, w, effort + row)
            if law.integral:
                integrate(k, i, dt, law, z, w)
            if not shared:
                apply_transition(k, i, law, w)
                drive(k, i, dt, disturbances, w, filled)
        if shared:
            set_effort(t, law.allocation, w, filled)
            for i in range(m):
                apply_transition(k, i, law, w)
                drive(k, i, dt, disturbances, w, filled)

    return cast(Callable[..., None], efforts)


def _multiply(seen: int, rows: Rows, sizes: Sizes) -> Callable[..., None]:
    """Return what writes the products of the rates that a law sees, two by two."""
    n, products = sizes.axes * sizes.quadratic, rows.products
    rates = seen + sizes.axes * BATCH_WIDTH

    @vectorised
    def multiply(w: Vector) -> None:
        for i in range(n):
            for j in range(n):
                for member in range(BATCH_WIDTH):
                    product = (
                        w[rates + i * BATCH_WIDTH + member] * w[rates + j * BATCH_WIDTH + member]
                    )
                    w[products + (i * n + j) * BATCH_WIDTH + member] = product

    return cast(Callable[..., None], multiply)


def _transition(rows: Rows, sizes: Sizes) -> Callable[..., None]:
    """Return what blends the efforts out that were applied before; see Controller."""
    effort, initial_effort, offset, taken = rows.applied, rows.held, rows.offset, sizes.taken

    @vectorised
    def apply_transition(k: int, i: int, law: LawNumbers, w: Vector) -> None:
        passed = k - law.since
        if not taken or passed >= law.transition_ticks:  # the first is known to the compiler
            return
        for at in range(i * BATCH_WIDTH, (i + 1) * BATCH_WIDTH):
            if passed == 0:
                w[offset + at] = w[initial_effort + at] - w[effort + at]
            w[effort + at] += _handover_effort(w[offset + at], passed, law.transition_ticks)

    return cast(Callable[..., None], apply_transition)


def _integrate(
    seen: int, effort: int, rows: Rows, sizes: Sizes, terms: LawTerms
) -> Callable[..., None]:
    """Return what adds the integral of an axis, within the limit, and takes it a tick on.

    Where the law takes over, the integral begins such that the effort is the one before.
    """
    total, ki, limit, to_integral = rows.integral, rows.ki, rows.law_limit, terms.integral
    m, initial_effort, taken, shared = sizes.joints, rows.held, sizes.taken, sizes.shared
    per_member = terms.per_member

    @vectorised
    def begin(i: int, law: LawNumbers, w: Vector) -> None:
        for member in range(BATCH_WIDTH):
            given = 0.0 if shared else w[initial_effort + i * BATCH_WIDTH + member]
            if shared:
                torque = law.allocation.torque
                for j in range(m):
                    share = torque[member if torque.shape[0] > 1 else 0, i, j]
                    given += share * w[initial_effort + j * BATCH_WIDTH + member]
            w[total + i * BATCH_WIDTH + member] = given - w[effort + i * BATCH_WIDTH + member]

    @vectorised
    def integrate(k: int, i: int, dt: float, law: LawNumbers, z: Vector, w: Vector) -> None:
        row, rate, position = i * BATCH_WIDTH, law.integrand[k, i, 0], law.position
        requested = position[0 if per_member else k, i, 0]
        if taken and k == law.since:
            begin(i, law, w)
        for member in range(BATCH_WIDTH):
            at = row + member
            error = (position[0, i, member] if per_member else requested) - w[seen + at]
            w[effort + at], w[total + at] = _integral(
                w[effort + at] + w[total + at],
                w[total + at],
                rate + w[ki + at] * error,
                w[limit + at],
                law.tracking_rate,
                dt,
            )
        if to_integral:
            add_products(law.to_integral, k, i, z, 0, dt, w, total + row)

    return cast(Callable[..., None], integrate)


def _sharing(rows: Rows, sizes: Sizes) -> tuple[Callable[..., None], Callable[..., None]]:
    """Return what writes turn and body rates of the joints, and what shares torques out.

    Member after member; see AllocationLaw and Allocator.
    """
    if not sizes.shared:
        return skip, skip
    m, tips, reading = sizes.joints, sizes.outputs - 2 * sizes.joints, rows.reading
    rate, tip = reading + m * BATCH_WIDTH, reading + 2 * m * BATCH_WIDTH
    seen, demand, effort = rows.seen, rows.demand, rows.applied

    @compiled
    def update_attitude(rotation_joints: RotationJoints, w: Vector, filled: int) -> None:
        inverse = rotation_joints.inverse
        for member in range(filled):
            body = member_rows(w, seen, 6, member)
            position, velocity = member_rows(w, reading, m, member), member_rows(w, rate, m, member)
            body[0], body[1], body[2] = joint_rotation_vector(inverse, position)
            body[3], body[4], body[5] = joint_rotation_vector(inverse, velocity)

    @compiled
    def set_effort(t: float, allocation: AllocationNumbers, w: Vector, filled: int) -> None:
        torque, readings, out = np.empty(3), np.empty(tips), np.empty(m)
        for member in range(filled):
            put(member_rows(w, demand, 3, member), torque)
            put(member_rows(w, tip, tips, member), readings)
            one = member if allocation.torque.shape[0] > 1 else 0
            share(allocation, one, torque, readings, t, out)
            put(out, member_rows(w, effort, m, member))

    return cast(Callable[..., None], update_attitude), cast(Callable[..., None], set_effort)


def _drive(total: int, rows: Rows, sizes: Sizes) -> Callable[..., None]:
    """Return what a drive makes of a demand; see motor_step."""
    effort, limit, least, member_demand = rows.applied, rows.limit, rows.least, rows.own
    owed, ramp, torque = rows.residual_impulse, rows.ramp, rows.torque
    pulse, flags = rows.pulse, rows.doubt
    quantum, rate, lag, rise, mean_rise = (rows.motor + k * BATCH_WIDTH for k in range(5))
    has_pulse, discrete_effort = sizes.has_pulse, sizes.discrete_effort
    has_slew_rate, lagged = sizes.has_slew_rate, sizes.lagged
    per_member, stored_count = sizes.per_member, BATCH_WIDTH * sizes.needs_previous
    (change_request, change_effort), spin = effort_faults(rows, sizes), _spin(rows, sizes)

    @vectorised
    def move_motor(i: int, dt: float, w: Vector) -> None:
        for member in range(BATCH_WIDTH):  # all conditions but the margin's are of the compiler
            at = i * BATCH_WIDTH + member
            motor = Motor(
                w[limit + at],
                w[least + at],
                w[pulse + at] if has_pulse else 0.0,
                w[quantum + member] if discrete_effort else 0.0,
                w[rate + member] if has_slew_rate else 0.0,
                w[lag + member] if lagged else 0.0,
                w[rise + member],
                w[mean_rise + member],
                dt,
            )
            memory = MotorMemory(w[owed + at], w[ramp + at], w[torque + at])
            w[effort + at], memory, margin = motor_step(motor, memory, w[effort + at])
            w[owed + at], w[ramp + at], w[torque + at] = memory
            if discrete_effort or has_pulse:
                near = margin < GUARD * w[limit + at]
                w[flags + member] = 1.0 if near else w[flags + member]

    @vectorised
    def add_disturbance(k: int, i: int, disturbances: Disturbances, w: Vector) -> None:
        row, disturbance = i * BATCH_WIDTH, disturbances.disturbance
        base = disturbance[k, i, 0]
        for member in range(BATCH_WIDTH):
            external_effort = disturbance[k, i, member] if per_member else base
            w[total + row + member] = w[effort + row + member] + external_effort

    @vectorised
    def drive(
        k: int, i: int, dt: float, disturbances: Disturbances, w: Vector, filled: int
    ) -> None:
        for at in range(i * BATCH_WIDTH, i * BATCH_WIDTH + stored_count):
            w[member_demand + at] = min(max(w[effort + at], -w[limit + at]), w[limit + at])
        change_request(k, i, disturbances.faults, w, filled)
        move_motor(i, dt, w)
        change_effort(k, i, disturbances.faults, w, filled)
        spin(i, w)
        add_disturbance(k, i, disturbances, w)

    return cast(Callable[..., None], drive)


def _spin(rows: Rows, sizes: Sizes) -> Callable[..., None]:
    """Return what bounds the efforts of wheels near their largest speed; see motor_step."""
    effort, share, max_speed = rows.applied, rows.spin, rows.spin + sizes.joints * BATCH_WIDTH
    wheel_rates = sizes.wheel_rates

    @vectorised
    def limit_speed(i: int, w: Vector) -> None:
        if wheel_rates[i] < 0:
            return
        for member in range(BATCH_WIDTH):
            at, speed = i * BATCH_WIDTH + member, w[wheel_rates[i] * BATCH_WIDTH + member]
            w[effort + at] = speed_limited_effort(
                w[effort + at], speed, w[share + at], w[max_speed + at]
            )

    return limit_speed if wheel_rates else skip
