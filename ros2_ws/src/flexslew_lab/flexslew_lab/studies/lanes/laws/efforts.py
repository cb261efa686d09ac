"""From what the laws of all lanes know to the efforts of their drives, as machine code.

The law and the drives are loops over lanes that become vector instructions. The torque of a law on
body axes is shared out among drives lane after lane, by the function of the bench.
"""

from collections.abc import Callable
from typing import Any, NamedTuple, cast

import numpy as np

from flexslew_control.allocation.sharing import share
from flexslew_lab.studies.lanes.benches.lane_faults import LaneFaults, broken_demand, broken_motors
from flexslew_lab.studies.lanes.benches.quanta import GUARD, near_edge
from flexslew_lab.studies.lanes.groups.rows import Rows, Sizes
from flexslew_lab.studies.lanes.laws.observers import add_products
from flexslew_lab.studies.lanes.laws.turned import TurnedJoints
from flexslew_plant.arrays import Matrix, Tensor, Vector, compiled, vectorised
from flexslew_plant.hardware.motor_step import behind_ramp, delayed, quantised, ramped, within_speed
from flexslew_plant.hardware.motor_step import pulsed as pulsed_effort
from flexslew_plant.testbeds.compiled.lanes import LANES


class LawNumbers(NamedTuple):
    """The law of every lane; tensors by lane_laws.by_lane. See linear_form.LawForm."""

    position: Tensor  # that it follows, (ticks, axes, 1), or one tick of every lane's
    velocity: Matrix  # (ticks, axes)
    from_state: Tensor
    from_output: Tensor
    to_integral: Tensor
    quadratic: Tensor
    demand: Tensor
    integrand: Tensor  # the same in all lanes
    integral: bool
    unwinding: float
    since: int  # tick at which it took over; -1: it was in charge from the start
    blended: int  # ticks in which the efforts of the one before are blended out
    allocation: Any  # sharing.AllocationNumbers; None: its efforts are those of the joints


class Troubles(NamedTuple):
    """What disturbs the lanes, and what breaks in them."""

    disturbance: Tensor  # (ticks, joints, 1 or LANES) [N m or N]
    faults: LaneFaults | None  # None: there are none


class LawTerms(NamedTuple):
    """Which of the law's products there are; a loop computes no others."""

    own: bool  # each lane has a demand of its own
    apart: bool  # each lane holds a position of its own
    state: bool
    output: bool
    integral: bool

    @classmethod
    def of(cls, law: LawNumbers) -> "LawTerms":
        """Return those of a law."""
        products = (law.from_state, law.from_output, law.to_integral)
        apart = law.position.shape[2] > 1
        return cls(law.demand.shape[2] > 1, apart, *(bool(product.any()) for product in products))


def efforts_of(total: int, rows: Rows, sizes: Sizes, terms: LawTerms) -> Callable[..., None]:
    """Return what writes the efforts of a tick and takes the integral to the next one.

    It takes (k, t, dt, Troubles, LawNumbers, TurnedJoints, z, w, number of lanes in use).

    Args:
        total: where the efforts stand that the kernel holds.
        rows: of the group.
        sizes: of the group.
        terms: of the law.
    """
    m, n, shared, quadratic = sizes.joints, sizes.axes, sizes.shared, sizes.quadratic
    own, apart, from_state, from_output, _ = terms
    reading, products, kp, kd = rows.reading, rows.products, rows.kp, rows.kd
    seen, effort = (rows.seen, rows.demand) if shared else (reading, rows.applied)
    see, give, drive = _see(rows, sizes), _give(rows, sizes), _drive(total, rows, sizes)
    multiply, blend = _multiply(seen, rows, sizes), _blend(rows, sizes)
    integrate = _integrate(seen, effort, rows, sizes, terms)
    applied, held, taken = rows.applied, rows.held, m * LANES * sizes.taken

    @vectorised
    def efforts(
        k: int,
        t: float,
        dt: float,
        troubles: Troubles,
        law: LawNumbers,
        turned: TurnedJoints,
        z: Vector,
        w: Vector,
        filled: int,
    ) -> None:
        if k == law.since:
            for at in range(taken):
                w[held + at] = w[applied + at]
        see(turned, w)
        multiply(w)
        demand_of = law.demand
        for i in range(n):
            row = i * LANES
            position, tick = law.position, 0 if apart else k
            base, requested, turning = demand_of[k, i, 0], position[tick, i, 0], law.velocity[k, i]
            for lane in range(LANES):
                at = row + lane
                w[effort + at] = (
                    (demand_of[k, i, lane] if own else base)
                    + w[kp + at] * ((position[0, i, lane] if apart else requested) - w[seen + at])
                    + w[kd + at] * (turning - w[seen + n * LANES + at])
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
                blend(k, i, law, w)
                drive(k, i, dt, troubles, w, filled)
        if shared:
            give(t, law.allocation, w, filled)
            for i in range(m):
                blend(k, i, law, w)
                drive(k, i, dt, troubles, w, filled)

    return cast(Callable[..., None], efforts)


def _multiply(seen: int, rows: Rows, sizes: Sizes) -> Callable[..., None]:
    """Return what writes the products of the rates that a law sees, two by two."""
    n, products = sizes.axes * sizes.quadratic, rows.products
    rates = seen + sizes.axes * LANES

    @vectorised
    def multiply(w: Vector) -> None:
        for i in range(n):
            for j in range(n):
                for lane in range(LANES):
                    both = w[rates + i * LANES + lane] * w[rates + j * LANES + lane]
                    w[products + (i * n + j) * LANES + lane] = both

    return cast(Callable[..., None], multiply)


def _blend(rows: Rows, sizes: Sizes) -> Callable[..., None]:
    """Return what blends the efforts out that were applied before; see Controller."""
    effort, held, offset, taken = rows.applied, rows.held, rows.offset, sizes.taken

    @vectorised
    def blend(k: int, i: int, law: LawNumbers, w: Vector) -> None:
        passed = k - law.since
        if not taken or passed >= law.blended:  # the first is known to the compiler
            return
        left = 1.0 - passed / law.blended
        for at in range(i * LANES, (i + 1) * LANES):
            if passed == 0:
                w[offset + at] = w[held + at] - w[effort + at]
            w[effort + at] += left * w[offset + at]

    return cast(Callable[..., None], blend)


def _integrate(
    seen: int, effort: int, rows: Rows, sizes: Sizes, terms: LawTerms
) -> Callable[..., None]:
    """Return what adds the integral of an axis, within the limit, and takes it a tick on.

    Where the law takes over, the integral begins such that the effort is the one before.
    """
    total, ki, limit, to_integral = rows.integral, rows.ki, rows.law_limit, terms.integral
    m, held, taken, shared = sizes.joints, rows.held, sizes.taken, sizes.shared
    apart = terms.apart

    @vectorised
    def begin(i: int, law: LawNumbers, w: Vector) -> None:
        for lane in range(LANES):
            given = 0.0 if shared else w[held + i * LANES + lane]
            if shared:
                torque = law.allocation.torque
                for j in range(m):
                    share = torque[lane if torque.shape[0] > 1 else 0, i, j]
                    given += share * w[held + j * LANES + lane]
            w[total + i * LANES + lane] = given - w[effort + i * LANES + lane]

    @vectorised
    def integrate(k: int, i: int, dt: float, law: LawNumbers, z: Vector, w: Vector) -> None:
        row, rate, position = i * LANES, law.integrand[k, i, 0], law.position
        requested = position[0 if apart else k, i, 0]
        if taken and k == law.since:
            begin(i, law, w)
        for lane in range(LANES):
            at = row + lane
            demand = w[effort + at] + w[total + at]
            given = min(max(demand, -w[limit + at]), w[limit + at])
            back = law.unwinding * (given - demand)
            error = (position[0, i, lane] if apart else requested) - w[seen + at]
            w[effort + at] = given
            w[total + at] += dt * (rate + w[ki + at] * error + back)
        if to_integral:
            add_products(law.to_integral, k, i, z, 0, dt, w, total + row)

    return cast(Callable[..., None], integrate)


def _see(rows: Rows, sizes: Sizes) -> Callable[..., None]:
    """Return what writes the turn and the body rates of the joints; see AllocatedLaw."""
    m, shared, seen, reading = sizes.joints, sizes.shared, rows.seen, rows.reading

    @vectorised
    def see(turned: TurnedJoints, w: Vector) -> None:
        if not shared:  # known to the compiler
            return
        for i in range(6):
            row = seen + i * LANES
            for lane in range(LANES):
                w[row + lane] = 0.0
            for j in range(m):
                weight, read = turned.inverse[i % 3, j], reading + (i // 3 * m + j) * LANES
                for lane in range(LANES):
                    w[row + lane] += weight * w[read + lane]

    return cast(Callable[..., None], see)


def _give(rows: Rows, sizes: Sizes) -> Callable[..., None]:
    """Return what shares the torques of the first lanes out; see allocation.Allocator."""
    m, tips = sizes.joints, sizes.outputs - 2 * sizes.joints
    demand, effort, reading = rows.demand, rows.applied, rows.reading + 2 * m * LANES

    def nothing(t: float, allocation: Any, w: Vector, filled: int) -> None:
        pass

    def give(t: float, allocation: Any, w: Vector, filled: int) -> None:
        torque, readings, out = np.empty(3), np.empty(tips), np.empty(m)
        for lane in range(filled):
            for i in range(3):
                torque[i] = w[demand + i * LANES + lane]
            for i in range(tips):
                readings[i] = w[reading + i * LANES + lane]
            one = lane if allocation.torque.shape[0] > 1 else 0
            share(allocation, one, torque, readings, t, out)
            for i in range(m):
                w[effort + i * LANES + lane] = out[i]

    return compiled(give if sizes.shared else nothing)


def _drive(total: int, rows: Rows, sizes: Sizes) -> Callable[..., None]:
    """Return what a drive makes of a demand; see motor_step."""
    effort, limit, least, own = rows.applied, rows.limit, rows.least, rows.own
    pulsed, pulse, owed = sizes.pulsed, rows.pulse, rows.owed
    follow, stepped, doubt = _follow(rows, sizes), sizes.stepped, rows.doubt
    quantum = rows.motor
    apart, ask, give = sizes.apart, broken_demand(rows, sizes), broken_motors(rows, sizes)
    spin, stated = _spin(rows, sizes), LANES * sizes.remembered

    @vectorised
    def disturb(k: int, i: int, troubles: Troubles, w: Vector) -> None:
        row, disturbance = i * LANES, troubles.disturbance
        base = disturbance[k, i, 0]
        for lane in range(LANES):
            pushed = disturbance[k, i, lane] if apart else base
            w[total + row + lane] = w[effort + row + lane] + pushed

    @vectorised
    def drive(k: int, i: int, dt: float, troubles: Troubles, w: Vector, filled: int) -> None:
        for at in range(i * LANES, i * LANES + stated):
            w[own + at] = min(max(w[effort + at], -w[limit + at]), w[limit + at])
        ask(k, i, troubles.faults, w, filled)
        for at in range(i * LANES, (i + 1) * LANES):
            applied = min(max(w[effort + at], w[least + at]), w[limit + at])
            lane = at - i * LANES
            if stepped and w[quantum + lane] > 0.0:
                step = w[quantum + lane]
                near = near_edge(applied, w[limit + at], step)
                w[doubt + lane] = 1.0 if near else w[doubt + lane]
                applied = quantised(applied, w[least + at], w[limit + at], step)
            if pulsed:
                shortest, most = w[pulse + at], w[limit + at]
                near = abs(abs(applied * dt + w[owed + at]) - shortest) < GUARD * most * dt
                w[doubt + lane] = 1.0 if near and shortest > 0.0 else w[doubt + lane]
                given, still = pulsed_effort(applied, w[owed + at], most, shortest, dt)
                w[owed + at] = still if shortest > 0.0 else 0.0
                applied = given if shortest > 0.0 else applied
            w[effort + at] = applied
        follow(i, dt, w)
        give(k, i, troubles.faults, w, filled)
        spin(i, w)
        disturb(k, i, troubles, w)

    return cast(Callable[..., None], drive)


def _spin(rows: Rows, sizes: Sizes) -> Callable[..., None]:
    """Return what bounds the efforts of wheels near their largest speed; see motor_step."""
    effort, share, fastest = rows.applied, rows.spin, rows.spin + sizes.joints * LANES
    spun = sizes.spun

    def nothing(i: int, w: Vector) -> None:
        pass

    def hold(i: int, w: Vector) -> None:
        if spun[i] < 0:
            return
        for lane in range(LANES):
            at, speed = i * LANES + lane, w[spun[i] * LANES + lane]
            w[effort + at] = within_speed(w[effort + at], speed, w[share + at], w[fastest + at])

    return vectorised(hold if spun else nothing)


def _follow(rows: Rows, sizes: Sizes) -> Callable[..., None]:
    """Return what a motor's slew rate and lag make of an effort; see motor_step."""
    effort, start, torque = rows.applied, rows.ramp, rows.torque
    slewed, lagged = sizes.slewed, sizes.lagged
    _, rate_of, lag_of, rise_of, mean_of = (rows.motor + k * LANES for k in range(5))

    @vectorised
    def follow(i: int, dt: float, w: Vector) -> None:
        if slewed:  # known to the compiler, as the other one
            for lane in range(LANES):
                at, before = i * LANES + lane, w[start + i * LANES + lane]
                ramp = ramped(w[effort + at], before, w[rate_of + lane], dt)
                w[effort + at], w[start + at] = ramp[0], ramp[1]
                if lagged:
                    w[effort + at], w[torque + at] = behind_ramp(
                        ramp, before, w[torque + at], w[lag_of + lane], dt
                    )
        elif lagged:
            for lane in range(LANES):
                at = i * LANES + lane
                w[effort + at], w[torque + at] = delayed(
                    w[effort + at], w[torque + at], w[rise_of + lane], w[mean_of + lane]
                )

    return cast(Callable[..., None], follow)
