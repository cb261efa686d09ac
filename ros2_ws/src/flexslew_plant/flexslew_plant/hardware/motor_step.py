"""Mean efforts of the motors over a tick, from the efforts that are demanded of them.

One set of steps serves the bench and the batches. Each step is about one motor. An effort that it
returns is the exact mean over the tick, so the impulse is that of the continuous response.
"""

from typing import NamedTuple

import numpy as np

from flexslew_plant.arrays import Matrix, Vector, called, compiled_once
from flexslew_plant.hardware.sensor_step import nearest_multiple

WHOLE = 1.0 + 1e-12  # 0.3 / 0.1 is less than 3: a quotient but for rounding


class MotorNumbers(NamedTuple):
    """The constants of all motors of a bench."""

    limit: Vector  # largest effort, (motors,) [N m or N]
    least: Vector  # smallest effort: -limit, or 0 of thrusters, (motors,) [N m or N]
    impulse: Vector  # of the shortest pulse; 0: it pushes continuously, (motors,) [N m s or N s]
    quantum: float  # [N m or N]; 0: none
    slew_rate: float  # [N m/s or N/s]; 0: no limit
    lag: float  # time constant [s]; 0: none
    rise: float  # part of a step that the torque has gone at the end of a tick [-]
    mean_rise: float  # the same in the mean over the tick [-]
    period: float  # one tick [s]


class Motor(NamedTuple):
    """The constants of one motor; see MotorNumbers."""

    limit: float
    least: float
    impulse: float
    quantum: float
    slew_rate: float
    lag: float
    rise: float
    mean_rise: float
    period: float


class MotorMemory(NamedTuple):
    """What a motor keeps from one tick to the next."""

    owed: float  # impulse that a thruster owes [N m s or N s]
    ramp: float  # torque at the end of the ramp [N m or N]
    torque: float  # the same behind the lag [N m or N]


SLEW_ROW, TORQUE_ROW = 1, 2  # of the memory of all motors


@called
def round_effort(effort: float, least: float, limit: float, quantum: float) -> tuple[float, float]:
    """Return the multiple of a quantum next to an effort, within the limits, and its margin [N m].

    See nearest_multiple for the margin.
    """
    most = quantum * np.floor(limit / quantum * WHOLE)
    multiple, margin = nearest_multiple(effort, quantum)
    within = min(max(multiple, -most), most)
    return min(max(within, least), limit), margin  # 3 times 0.1 is more than 0.3


@called
def pulse_effort(
    demand: float, residual_impulse: float, limit: float, minimum_impulse: float, period: float
) -> tuple[float, float]:
    """Return the mean effort of a thruster that is on or off, and the impulse that it owes.

    Pulse-width modulation, once a tick. A thruster pushes with its limit F for a time w of the tick
    T; its mean is F w / T. With d the demand and c what was owed, w = |d T + c| / F, at most T.
    Below the shortest pulse w is 0, and the impulse is owed: small demands come as rare pulses with
    the right mean. No more than one shortest pulse is ever owed.

    Args:
        demand: d [N m or N].
        residual_impulse: c [N m s or N s].
        limit: F [N m or N].
        minimum_impulse: impulse of the shortest pulse, above 0 [N m s or N s].
        period: T [s].
    """
    requested_impulse, most = demand * period + residual_impulse, limit * period
    impulse = min(max(requested_impulse, -most), most)
    impulse = 0.0 if abs(impulse) < minimum_impulse else impulse
    return impulse / period, min(
        max(requested_impulse - impulse, -minimum_impulse), minimum_impulse
    )


@called
def slew_limited_torque(
    demand: float, start: float, slew_rate: float, period: float
) -> tuple[float, float, float, float]:
    """Return the mean of a torque that ramps to the demand and holds it, and how it does so.

    Args:
        demand: [N m or N].
        start: torque u_0 at the start of the tick [N m or N].
        slew_rate: [N m/s or N/s].
        period: one tick [s].

    Returns:
        The mean and the torque at the end of the tick [N m or N], the duration of the ramp [s], and
        its rate [N m/s or N/s].
    """
    gap = demand - start
    slew_time = min(abs(gap) / slew_rate, period)
    rate = slew_rate * np.sign(gap)
    end = demand if slew_time < period else start + rate * period
    return end - 0.5 * slew_time / period * (end - start), end, slew_time, rate


@called
def first_order_slew_effort(
    slew_response: tuple[float, float, float, float],
    start: float,
    initial_torque: float,
    lag: float,
    period: float,
) -> tuple[float, float]:
    """Return the mean effort of a motor that lags behind a ramp, and its torque at the tick's end.

    The motor's torque is z' = (u - z) / lag. On the ramp z = u - rate lag + (z_0 - u_0 + rate lag)
    e^(-t/lag). The integral of z is that of u less lag times the change of z.

    Args:
        slew_response: what slew_limited_torque returns.
        start: u_0 [N m or N].
        initial_torque: z_0 [N m or N].
        lag: [s].
        period: one tick [s].
    """
    mean, end, slew_time, rate = slew_response
    steady_error = rate * lag  # of the torque, once the ramp has gone on for long
    z = end - steady_error + (initial_torque - start + steady_error) * np.exp(-slew_time / lag)
    z = end + (z - end) * np.exp(-(period - slew_time) / lag)
    return mean - lag / period * (z - initial_torque), z


def first_order_effort(
    demand: float, initial_torque: float, rise: float, mean_rise: float
) -> tuple[float, float]:
    """Return the mean effort of a motor with a lag, and its torque at the end of the tick.

    Args:
        demand: [N m or N].
        initial_torque: torque at the start of the tick [N m or N].
        rise: see MotorNumbers.
        mean_rise: see MotorNumbers.
    """
    gap = demand - initial_torque
    return initial_torque + mean_rise * gap, initial_torque + rise * gap


_first_order_effort = called(first_order_effort)


@called
def speed_limited_effort(effort: float, speed: float, share: float, max_speed: float) -> float:
    """Return the mean effort of a wheel's motor, which drives the wheel up to a speed at most.

    An effort u on the platform takes the speed W of a wheel with I W' = -u, so the impulse that
    takes it to its limit bounds the mean over a tick T:
        -I (W_max - W) / T <= u <= I (W_max + W) / T.
    Of a wheel that is beyond, the motor gives nothing that way: the platform's turn, too, changes
    its speed.

    Args:
        effort: u that the motor would give [N m].
        speed: W [rad/s].
        share: I / T [N m s/rad].
        max_speed: W_max [rad/s].
    """
    most = max(share * (max_speed + speed), 0.0)
    least = min(share * (speed - max_speed), 0.0)
    return min(max(effort, least), most)


@called
def motor_step(n: Motor, memory: MotorMemory, demand: float) -> tuple[float, MotorMemory, float]:
    """Return the mean effort of a motor over a tick, its memory, and the margin of the effort.

    The demand passes the limits, the quantum, the pulses, the slew rate and the lag, one after
    another. The margin is the distance to the edge at which the effort is another quantum, or a
    pulse comes or goes; infinite where there are neither [N m or N].
    """
    owed, ramp, torque = memory
    effort, margin = min(max(demand, n.least), n.limit), np.inf
    if n.quantum > 0.0:
        effort, margin = round_effort(effort, n.least, n.limit, n.quantum)
    if n.impulse > 0.0:
        requested = abs(effort * n.period + owed)
        margin = min(margin, abs(requested - n.impulse) / n.period)
        effort, owed = pulse_effort(effort, owed, n.limit, n.impulse, n.period)
    if n.slew_rate > 0.0:
        slew_response = slew_limited_torque(effort, ramp, n.slew_rate, n.period)
        start, effort, ramp = ramp, slew_response[0], slew_response[1]
        if n.lag > 0.0:
            effort, torque = first_order_slew_effort(slew_response, start, torque, n.lag, n.period)
    elif n.lag > 0.0:
        effort, torque = _first_order_effort(effort, torque, n.rise, n.mean_rise)
    return effort, MotorMemory(owed, ramp, torque), margin


@compiled_once("memory", "out")
def drive_motors(n: MotorNumbers, demand: Vector, memory: Matrix, out: Vector) -> bool:
    """Write the mean efforts of a tick; return whether a demand was beyond a limit.

    Args:
        n: constants.
        demand: shape (motors,) [N m or N].
        memory: MotorMemory of all motors, shape (3, motors); advanced by a tick.
        out: shape (motors,) [N m or N].
    """
    saturated = False
    _, _, _, quantum, slew_rate, lag, rise, mean_rise, period = n
    for i in range(out.size):
        limits = n.limit[i], n.least[i], n.impulse[i]
        motor = Motor(*limits, quantum, slew_rate, lag, rise, mean_rise, period)
        before = MotorMemory(memory[0, i], memory[1, i], memory[2, i])
        out[i], after, _ = motor_step(motor, before, demand[i])
        memory[0, i], memory[1, i], memory[2, i] = after
        saturated = saturated or not n.least[i] <= demand[i] <= n.limit[i]
    return saturated
