"""The compiled loop that flies LANES trials at once: readings, law, drive, testbed, metrics.

It says in compiled form what Sensors, Controller, Drive, Actuator, Bench and the metrics
say for one run. Arrays with a lane are flat, row after row with LANES neighbours each.
"""

from collections.abc import Callable
from functools import lru_cache
from typing import Any, NamedTuple, cast

import numpy as np
from numpy.typing import NDArray

from flexslew_lab.studies.lanes.observers import Observe, Signals
from flexslew_plant.arrays import Matrix, Vector, vectorised
from flexslew_plant.testbeds.lanes import LANES, LaneKernel

MARGIN = 1.0 - 1e-12  # of the limit: an effort from there on is saturated, as in metrics.efforts


class Sizes(NamedTuple):
    """What the compiler builds in."""

    joints: int
    modes: int
    states: int  # z of linear_form
    outputs: int  # that the law reads: joints, rates, perhaps the first tip
    appendages: int


class Schedule(NamedTuple):
    """What is the same in every lane, tick by tick."""

    time: Vector  # stamps, (ticks + 1,) [s]
    over: NDArray[np.bool_]  # the manoeuvre is, (ticks + 1,)
    started: NDArray[np.bool_]  # it has, (ticks + 1,)
    position: Matrix  # reference, (ticks, joints)
    velocity: Matrix
    demand: Matrix  # f of linear_form, (ticks, joints)
    integrand: Matrix  # g, (ticks, joints)
    disturbance: Matrix  # (ticks, joints)


class Matrices(NamedTuple):
    """The law's; see linear_form.LawForm."""

    from_state: Matrix
    from_output: Matrix
    to_integral: Matrix


class Aim(NamedTuple):
    """What the metrics are measured against, and what limits the efforts."""

    goal: Vector  # (joints,)
    sign: Vector  # of the way to go, (joints,)
    band: Vector  # of settling, (joints,)
    limit: Vector  # of the drives, (joints,)
    law_limit: Vector  # of the law itself, (joints,)
    tip: Matrix  # (appendages, modes)


class Counted(NamedTuple):
    """What the metrics count, flat with LANES of each."""

    residual_tip: Vector
    peak_tip: Vector
    residual: Vector  # (joints)
    beyond: Vector  # (joints)
    outside: Vector  # (joints), last time outside of the band
    terminal: Vector
    peak_effort: Vector  # (joints)
    square_sum: Vector  # (joints)
    saturated: Vector


Loop = Callable[..., None]


@lru_cache
def lane_loop(kernel: LaneKernel, sizes: Sizes, observe: Observe) -> Loop:
    """Return the loop for a testbed and a law of these sizes.

    It takes (w, dt, steps, Schedule, Matrices, Aim, gains, integral, unwinding, error, observer, z,
    memory, filled, Counted): w of lanes.Advance, beginning with the states; `gains` kp, ki, kd,
    flat; `error` of the readings, (ticks + 1 or 1, outputs LANES); w, z, memory and Counted in and
    out; `observer` as `observe` wants it, which is asked for the first `filled` lanes at least.
    """
    m, modes, nz, ny, tips = sizes
    n = m + modes
    advance = kernel.advance

    @vectorised
    def read(k: int, x: Vector, tip: Matrix, error: Matrix, y: Vector) -> None:
        """Write what the sensors say: joints, rates, perhaps the first tip."""
        row = k if error.shape[0] > 1 else 0
        for i in range(m):
            for lane in range(LANES):
                y[i * LANES + lane] = x[i * LANES + lane] + error[row, i * LANES + lane]
                j = (m + i) * LANES + lane
                y[j] = x[(n + i) * LANES + lane] + error[row, j]
        for i in range(2 * m, ny):
            for lane in range(LANES):
                y[i * LANES + lane] = error[row, i * LANES + lane]
            for j in range(modes):
                shape = tip[i - 2 * m, j]
                for lane in range(LANES):
                    y[i * LANES + lane] += shape * x[(m + j) * LANES + lane]

    @vectorised
    def effort(
        k: int,
        dt: float,
        schedule: Any,
        law: Any,
        aim: Any,
        gains: Vector,
        integral: bool,
        unwinding: float,
        y: Vector,
        z: Vector,
        s: Vector,
        u: Vector,
    ) -> None:
        """Write the efforts that the drives apply; take the integral to the next tick."""
        for i in range(m):
            base, wanted = schedule.demand[k, i], schedule.position[k, i]
            turning, most = schedule.velocity[k, i], aim.law_limit[i]
            for lane in range(LANES):
                at = i * LANES + lane
                u[at] = (
                    base
                    + gains[at] * (wanted - y[at])
                    + gains[2 * m * LANES + at] * (turning - y[m * LANES + at])
                )
            for j in range(nz):
                weight = law.from_state[i, j]
                for lane in range(LANES):
                    u[i * LANES + lane] += weight * z[j * LANES + lane]
            for j in range(ny):
                weight = law.from_output[i, j]
                for lane in range(LANES):
                    u[i * LANES + lane] += weight * y[j * LANES + lane]
            if integral:
                rate = schedule.integrand[k, i]
                for lane in range(LANES):
                    at = i * LANES + lane
                    demand = u[at] + s[at]
                    u[at] = min(max(demand, -most), most)
                    back = unwinding * (u[at] - demand)
                    error = wanted - y[at]
                    s[at] += dt * (rate + gains[m * LANES + at] * error + back)
                for j in range(nz):
                    weight = dt * law.to_integral[i, j]
                    for lane in range(LANES):
                        s[i * LANES + lane] += weight * z[j * LANES + lane]
            limit = aim.limit[i]
            for lane in range(LANES):
                u[i * LANES + lane] = min(max(u[i * LANES + lane], -limit), limit)

    @vectorised
    def measure(k: int, schedule: Any, aim: Any, x: Vector, u: Vector, seen: bool, c: Any) -> None:
        """Count the truth of a tick and the effort that was held before it."""
        time = schedule.time[k]
        held = time - schedule.time[k - 1] if k > 0 else 0.0
        over, started = schedule.over[k], schedule.started[k]
        for i in range(tips):
            for lane in range(LANES):
                at = 0.0
                for j in range(modes):
                    at += aim.tip[i, j] * x[(m + j) * LANES + lane]
                at = abs(at)
                c.peak_tip[lane] = max(c.peak_tip[lane], at)
                if over:
                    c.residual_tip[lane] = max(c.residual_tip[lane], at)
        for i in range(m):
            goal, sign, band = aim.goal[i], aim.sign[i], aim.band[i]
            for lane in range(LANES):
                at = i * LANES + lane
                error = x[at] - goal
                if over:
                    c.residual[at] = max(c.residual[at], abs(error))
                if started:
                    c.beyond[at] = max(c.beyond[at], error * sign)
                c.outside[at] = time if abs(error) > band else c.outside[at]
        if over and not seen:
            for i in range(2 * n):
                goal = aim.goal[i] if i < m else 0.0
                for lane in range(LANES):
                    c.terminal[lane] += (x[i * LANES + lane] - goal) ** 2
            for lane in range(LANES):
                c.terminal[lane] = np.sqrt(c.terminal[lane])
        for i in range(m):
            for lane in range(LANES):
                at = i * LANES + lane
                c.peak_effort[at] = max(c.peak_effort[at], abs(u[at]))
                c.square_sum[at] += held * u[at] * u[at]
        for lane in range(LANES):
            full = 0.0
            for i in range(m):
                full = held if abs(u[i * LANES + lane]) >= aim.limit[i] * MARGIN else full
            c.saturated[lane] += full

    @vectorised
    def loop(
        w: Vector,
        dt: float,
        steps: int,
        schedule: Any,
        law: Any,
        aim: Any,
        gains: Vector,
        integral: bool,
        unwinding: float,
        error: Matrix,
        observer: Any,
        z: Vector,
        memory: Vector,
        filled: int,
        counted: Any,
    ) -> None:
        ticks = schedule.demand.shape[0]
        x, total = w[: 2 * n * LANES], w[2 * n * LANES : (2 * n + m) * LANES]
        u = np.zeros(m * LANES)
        y, earlier = np.zeros(ny * LANES), np.zeros(ny * LANES)
        s = np.zeros(m * LANES)
        seen = False
        for k in range(ticks):
            measure(k, schedule, aim, x, u, seen, counted)
            seen = seen or schedule.over[k]
            for i in range(ny * LANES):
                earlier[i] = y[i]
            read(k, x, aim.tip, error, y)
            signals = Signals(y, earlier, u)
            observe(k, schedule.time[k], dt, observer, signals, z, memory, filled)
            effort(k, dt, schedule, law, aim, gains, integral, unwinding, y, z, s, u)
            for i in range(m):
                pushed = schedule.disturbance[k, i]
                for lane in range(LANES):
                    total[i * LANES + lane] = u[i * LANES + lane] + pushed
            advance(k * dt, dt, steps, w)
        measure(ticks, schedule, aim, x, u, seen, counted)

    return cast(Loop, loop)
