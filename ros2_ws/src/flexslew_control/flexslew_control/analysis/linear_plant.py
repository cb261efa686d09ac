"""The bench as a linear system about a rest: continuous, or exactly as it ticks."""

from dataclasses import dataclass

import numpy as np
from scipy.linalg import block_diag

from flexslew_control.analysis.lti import Lti, series
from flexslew_control.analysis.rest import Rest, linear_matrices, slopes
from flexslew_control.analysis.signals import APPLIED, inputs_of, outputs_of, states_of
from flexslew_control.linear.free_platform import rate_outputs
from flexslew_plant.arrays import Matrix, Vector
from flexslew_plant.hardware.actuator import IDEAL, ActuatorSettings, motor_numbers
from flexslew_plant.hardware.friction import coefficients
from flexslew_plant.hardware.motor_step import first_order_effort
from flexslew_plant.testbeds.compiled.dynamics import (
    STAGE_TIMES,
    STAGE_WEIGHTS,
    STAGES,
    STEP_WEIGHTS,
)

_STEP = 1e-3  # of the differences of what an accelerometer feels
_STATIC = 1e-9  # of the largest slope: what drifts less is at rest


@dataclass(frozen=True)
class PlantPath:
    """The path from a command to the motor's effort, tick by tick.

    Args:
        period: one tick [s].
        actuator: the motors.
        gain: gain of each motor's command, shape (efforts,) [-]; None: one.
        delay: delay of each command, shape (efforts,) [ticks]; None: none. A part of a tick
            counts by the mean over it.
        steps: number of equal integration steps in a tick.
    """

    period: float
    actuator: ActuatorSettings = IDEAL
    gain: Vector | None = None
    delay: Vector | None = None
    steps: int = 1

    def queue_lengths(self, efforts: int) -> "np.typing.NDArray[np.int64]":
        """Return how many commands to each motor a tick begins with, shape (efforts,)."""
        delay = np.zeros(efforts) if self.delay is None else self.delay
        return np.ceil(delay).astype(np.int64)


def continuous_plant(rest: Rest, friction: ActuatorSettings | None = None) -> Lti:
    """Return the small motions from efforts to sensors, all as deviations from the rest.

    x' = A x + B u, y = C x + D u with x = [displacement along v, v]; D is not zero for
    accelerometers alone. Names: see signals.
    """
    model = rest.model
    a, b = linear_matrices(rest, friction)
    c, d = _output_matrices(rest, a, b)
    return Lti(a, b, c, d, inputs_of(model), outputs_of(model), states_of(model))


def sampled_plant(rest: Rest, path: PlantPath, applied: bool = False) -> Lti:
    """Return what a controller commands and what it measures, tick by tick.

    x(k + 1) = F x(k) + G u(k) with the hold as the bench integrates it, and the motors' lag, gains
    and delay before it.

    Args:
        rest: about which.
        path: from the command to the motors' effort.
        applied: whether the effort of the last tick is an output too: see signals.applied_of.
    """
    model, period = rest.model, path.period
    f, g = _with_friction(rest, *_tick(rest, path), path)
    c, d = _output_matrices(rest, *linear_matrices(rest, path.actuator))
    outputs, states = outputs_of(model), states_of(model)
    efforts = inputs_of(model)
    memory = tuple(name.replace("effort.", f"{APPLIED}.") for name in efforts)
    m, n = len(efforts), len(f)
    if applied or d.any():  # sensors feel the effort of the tick that ends with the reading
        f, g = np.block([[f, np.zeros((n, m))], [np.zeros((m, n + m))]]), np.vstack((g, np.eye(m)))
        c, states = np.hstack((c, d)), (*states, *memory)
    if applied:
        c = np.vstack((c, np.hstack((np.zeros((m, n)), np.eye(m)))))
        outputs = (*outputs, *memory)
    ticks = Lti(f, g, c, np.zeros((len(c), m)), efforts, outputs, states, period)
    return series(motors(path, efforts), ticks)


def motors(path: PlantPath, efforts: tuple[str, ...]) -> Lti:
    """Return the way from commands to applied efforts.

    Each motor keeps the commands of as many ticks as it is late, the last one first, one motor
    after the other.
    """
    m, eye = len(efforts), np.eye(len(efforts))
    gain = np.ones(m) if path.gain is None else path.gain
    part = np.zeros(m) if path.delay is None else path.delay % 1.0
    kept = path.queue_lengths(m)
    shift = block_diag(*(np.eye(k, k=-1) for k in kept))
    entry = block_diag(*(g * np.eye(k, 1) for k, g in zip(kept, gain, strict=True)))
    out, direct = [], np.zeros(m)
    for k, ticks in enumerate(kept):
        weights = np.zeros(ticks + 1)  # of the command of so many ticks before
        weights[ticks] = 1.0
        if part[k] > 0.0:
            weights[ticks - 1 :] = 1.0 - part[k], part[k]
        out.append(weights[None, 1:])
        direct[k] = gain[k] * weights[0]
    names = tuple(
        f"{name}.before.{k + 1}" for name, ticks in zip(efforts, kept, strict=True)
        for k in range(ticks)
    )  # fmt: skip
    queue = Lti(
        shift, entry, block_diag(*out), np.diag(direct), efforts, efforts, names, path.period
    )
    values = motor_numbers(path.actuator, np.ones(m), path.period)
    (mean, rise), (mean_left, left) = (
        first_order_effort(demand, torque, values.rise, values.mean_rise)
        for demand, torque in ((1.0, 0.0), (0.0, 1.0))
    )
    if rise == mean == 1.0:
        return queue
    names = tuple(f"{name}.motor" for name in efforts)
    lag = Lti(
        left * eye, rise * eye, mean_left * eye, mean * eye, efforts, efforts, names, path.period
    )  # fmt: skip
    return series(queue, lag)


def _tick(rest: Rest, path: PlantPath) -> tuple[Matrix, Matrix]:
    """Return F and G of a tick with the effort held: the derivative of the bench's own step.

    Runge and Kutta's stages of the variations, with slopes where and when the bench has its own;
    without friction.

    Args:
        rest: of n coordinates.
        path: with period and steps of a tick.
    """
    if rest.model.kernels.advance is not None:
        return rest.model.held_maps(path.period)
    model, x, t, h = rest.model, rest.state, rest.time, path.period / path.steps
    steady = np.hstack(linear_matrices(rest))
    drift = model.derivative(x, rest.effort, t)
    varying = model.time_varying or abs(drift).max() > _STATIC * max(1.0, float(abs(steady).max()))
    k, after = len(steady), np.eye(steady.shape[1])
    for step in range(path.steps):
        stages, stage_map = np.zeros((STAGES, *steady.shape)), after.copy()
        for i in range(STAGES):
            slope = steady
            if varying:
                later = (step + STAGE_TIMES[i]) * h
                point = model.advance(x, rest.effort, later, step + 1, t)
                slope = np.hstack(slopes(model, point, rest.effort, t + later))
            stage_map[:k] = after[:k] + h * np.tensordot(STAGE_WEIGHTS[i], stages, 1)
            stages[i] = slope @ stage_map
        after[:k] = after[:k] + h * np.tensordot(STEP_WEIGHTS, stages, 1)
    return after[:k, :k], after[:k, k:]


def _with_friction(rest: Rest, f: Matrix, g: Matrix, path: PlantPath) -> tuple[Matrix, Matrix]:
    """Return F and G of a tick with the motors' friction: the derivative of hardware.friction.

    With c its slope at rest, r is the mean friction under which each rate v ends where
    v' = (v+ - v) / h - a r - a c v takes it, a its own mobility: stable at any c, as the bench is.
    """
    model, h, friction = rest.model, path.period, path.actuator
    if not (friction.viscous_friction or friction.coulomb_friction):
        return f, g
    viscous, coulomb = coefficients(model.resolved_motors, friction)
    _, columns, _, rate, sign = model.resolved_motors
    a = np.diag(model.mobility(rest.state, rest.effort, rest.time))[columns]
    exponent = a * (viscous + coulomb / friction.coulomb_speed) * h
    decay = -np.expm1(-exponent)
    mean = np.divide(decay, exponent, out=np.ones_like(decay), where=exponent > 0.0)
    by_rate, by_push = -decay / (a * h), (mean - 1.0) / a
    motors = np.zeros((len(columns), len(f)))
    # displacements are along v, not q
    motors[np.arange(len(columns)), rate - (model.positions - model.coordinates)] = sign
    values = np.diag(1.0 + by_push * a) - by_push[:, None] * (motors @ g[:, columns]) / h
    from_state = by_rate[:, None] * motors + by_push[:, None] * (motors @ f - motors) / h
    from_effort = by_push[:, None] * (motors @ g) / h
    r = np.linalg.solve(values, np.hstack((from_state, from_effort)))
    return f + g[:, columns] @ r[:, : len(f)], g + g[:, columns] @ r[:, len(f) :]


def _output_matrices(rest: Rest, a: Matrix, b: Matrix) -> tuple[Matrix, Matrix]:
    """Return C and D of the sensors' readings."""
    model, n, tips = rest.model, rest.model.coordinates, rest.model.appendages
    joints, first, count = model.joints, rest.model.before_modes, len(rest.model.appendages.names)
    seen = rate_outputs(model, rest.q)
    c, d = (
        np.zeros((2 * joints + 2 * count, 2 * n)),
        np.zeros((2 * joints + 2 * count, model.efforts)),
    )
    c[:joints, :n], c[joints : 2 * joints, n:] = seen, seen
    tip = slice(2 * joints, 2 * joints + count)
    c[tip, first:n], c[2 * joints + count :, first:n] = tips.tip, tips.curvature
    if tips.rate is not None:
        c[tip, n + first :] = tips.rate
    if tips.exact_reading is not None:
        acceleration_c, acceleration_d = _acceleration_outputs(rest)
        c[tip] += acceleration_c
        d[tip] += acceleration_d
    return c, d


def _acceleration_outputs(rest: Rest) -> tuple[Matrix, Matrix]:
    """Return how what accelerometers feel changes with state and effort, by differences."""
    model, acceleration = rest.model, rest.model.appendages.exact_reading
    assert acceleration is not None
    n, p = model.coordinates, model.positions
    into = np.zeros((p + n, 2 * n))
    into[:p, :n], into[p:, n:] = model.position_rates(rest.q, rest.time), np.eye(n)

    def at(x: Vector, effort: Vector) -> Vector:
        return acceleration(x, model.derivative(x, effort, rest.time), rest.time)

    def slope(dx: Vector, du: Vector) -> Vector:
        def point(s: float) -> Vector:
            return at(rest.state + s * dx, rest.effort + s * du)

        h = _STEP
        near, far = point(h) - point(-h), point(2.0 * h) - point(-2.0 * h)
        return np.asarray((8.0 * near - far) / (12.0 * h))

    no_x, no_u = np.zeros(p + n), np.zeros(model.efforts)
    columns = [slope(column, no_u) for column in into.T]
    efforts = [slope(no_x, one) for one in np.eye(model.efforts)]
    return np.array(columns).T, np.array(efforts).T
