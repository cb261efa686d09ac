"""Friction in the motors, integrated with the dynamics: stable at any period, also at rest.

Each motor, of a joint or of a reaction wheel, slides under f(v) = c v + F tanh(v / v_c), which is
stiff near rest. Over a tick the rest of the dynamics accelerates it by its mean g, so that
v' = g - a f(v), with v its rate and a its mobility: of B^T v and of B^T M^-1 B, its entries. That
scalar equation is solved to its end; the impulse that it takes is the mean friction, with which
the testbed is integrated over the tick. g is the one that this gives.
The method is of second order and exact in steady sliding and in steady creep.
"""

from collections.abc import Callable, Mapping

import numpy as np

from flexslew_plant.arrays import Matrix, Vector, compiled, compiled_once
from flexslew_plant.errors import BadInput
from flexslew_plant.hardware.actuator import ActuatorSettings
from flexslew_plant.testbeds.model import Model, Motors

MAX_ITERATIONS = 30  # at most, of integrations of a tick
_MAX_JOINT_ITERATIONS = 200  # at most, over the joints
CLOSE = 1e-12  # change of the friction at which it is found, of its size


@compiled
def friction_velocity(
    v: float, g: float, viscous: float, coulomb: float, speed: float, dt: float
) -> float:
    """Return v after dt of v' = g - viscous v - coulomb tanh(v / speed).

    Exponential Rosenbrock steps of order 2 in v / speed, with the error estimated by order 3.

    Args:
        v: [rad/s or m/s].
        g: acceleration without friction [rad/s^2 or m/s^2].
        viscous: c a [1/s].
        coulomb: F a [rad/s^2 or m/s^2].
        speed: v_c [rad/s or m/s].
        dt: [s].
    """
    s, push, kappa = v / speed, g / speed, coulomb / speed
    left, step = dt, dt
    for _ in range(100_000):
        step = min(step, left)
        friction_ratio = np.tanh(s)
        slope = -viscous - kappa * (1.0 - friction_ratio * friction_ratio)
        z = slope * step
        if z < -1e-2:
            phi_1 = np.expm1(z) / z
            phi_3 = (phi_1 - 1.0 - 0.5 * z) / (z * z)
        else:
            phi_1 = 1.0 + z * (1.0 / 2.0 + z * (1.0 / 6.0 + z * (1.0 / 24.0 + z / 120.0)))
            phi_3 = 1.0 / 6.0 + z * (1.0 / 24.0 + z * (1.0 / 120.0 + z / 720.0))
        change = step * phi_1 * (push - viscous * s - kappa * friction_ratio)
        rest = -kappa * (
            np.tanh(s + change) - friction_ratio - (1.0 - friction_ratio * friction_ratio) * change
        )
        error = 2.0 * step * phi_3 * rest
        size = abs(error) / (1e-7 + 1e-13 * abs(s))
        if size <= 1.0 or step <= 1e-14 * dt:
            s += change + error
            left -= step
            if left <= 0.0:
                break
        step *= min(5.0, max(0.1, 0.9 * (size + 1e-30) ** (-1.0 / 3.0)))
    return s * speed


@compiled_once()
def balanced(
    r: Vector,
    free: Vector,
    mobility: Matrix,
    v: Vector,
    law: Matrix,
    speed: float,
    dt: float,
) -> Vector:
    """Return the mean friction on each joint, shape (m,), in balance with that on the others.

    Joint after joint (Gauss and Seidel): convex, as friction grows with the rate and the mobility
    is positive definite.

    Args:
        r: first guess, shape (m,) [N m or N].
        free: accelerations of the joints without friction, shape (m,).
        mobility: block of M^-1 of the joints, shape (m, m).
        v: their rates, shape (m,).
        law: c [N m s/rad or N s/m] and F [N m or N] of every joint, shape (2, m).
        speed: v_c [rad/s or m/s].
        dt: [s].
    """
    r, viscous, coulomb = r.copy(), law[0], law[1]
    for _ in range(_MAX_JOINT_ITERATIONS):
        change = 0.0
        for i in range(r.size):
            a = mobility[i, i]
            g = free[i] + mobility[i] @ r - a * r[i]
            after = friction_velocity(v[i], g, a * viscous[i], a * coulomb[i], speed, dt)
            found = ((after - v[i]) / dt - g) / a
            change = max(change, abs(found - r[i]))
            r[i] = found
        if change <= 0.1 * CLOSE * np.abs(r).max():
            break
    return r


@compiled_once()
def next_friction(
    r: Vector,
    v: Vector,
    after: Vector,
    way: Vector,
    mobility: Matrix,
    law: Matrix,
    speed: float,
    dt: float,
) -> Vector:
    """Return the mean friction, shape (m,), that goes with a tick flown under another one.

    It takes energy or none from every joint: one that turns round within the tick may come out with
    a mean friction along its way; then it gets what makes it end where it began.

    Args:
        r: under which the joints went their way, shape (m,) [N m or N].
        v: their rates before, shape (m,) [rad/s or m/s].
        after: their rates after it, shape (m,) [rad/s or m/s].
        way: from the beginning to the end, shape (m,) [rad or m].
        mobility: as in balanced, as are all that follow.
        law: c and F.
        speed: v_c.
        dt: one tick.
    """
    free = (after - v) / dt - mobility @ r
    found = balanced(r, free, mobility, v, law, speed, dt)
    reach = 0.5 * dt**2
    displacement = way + reach * (mobility @ (found - r))
    for i in range(found.size):
        if found[i] * displacement[i] > 0.0:
            stop_friction = found[i] - displacement[i] / (reach * mobility[i, i])
            found[i] = min(max(stop_friction, min(found[i], 0.0)), max(found[i], 0.0))
    return found


class Friction:
    """The friction of the motors.

    Args:
        motors: where they are among efforts and states.
        settings: the `actuator` section.
        period: one tick [s].

    Raises:
        BadInput: it names what is no motor.
    """

    def __init__(self, motors: Motors, settings: ActuatorSettings, period: float) -> None:
        self._motors = motors
        self._law = coefficients(motors, settings), settings.coulomb_speed
        self._period = period
        one = np.ones(1)
        next_friction(one, one, one, one, np.eye(1), np.ones((2, 1)), 1.0, period)  # before tick 0

    def advance(
        self, x: Vector, effort: Vector, mobility: Matrix, step: Callable[[Vector], Vector]
    ) -> Vector:
        """Return the state a tick later, friction included.

        Args:
            x: state [q, v].
            effort: of all actuators, held, shape (efforts,) [N m or N].
            mobility: of all actuators, B^T M^-1 B, shape (efforts, efforts).
            step: returns the state a tick later under a held effort.
        """
        indices, at, speed, sign, dt = *self._motors[1:], self._period
        mobility = np.ascontiguousarray(mobility[np.ix_(indices, indices)])
        v, r = sign * x[speed], np.zeros(len(indices))
        for _ in range(MAX_ITERATIONS):
            total = effort.astype(np.float64)
            total[indices] += r
            after = step(total)
            rate = sign * after[speed]
            if not np.isfinite(rate).all():
                break
            found = next_friction(r, v, rate, sign * (after[at] - x[at]), mobility, *self._law, dt)
            if np.abs(found - r).max() <= CLOSE * np.abs(found).max():
                break
            r = found
        return after


def coefficients(motors: Motors, settings: ActuatorSettings) -> Matrix:
    """Return viscous and Coulomb coefficient of every motor, shape (2, motors).

    Raises:
        BadInput: a name is that of no motor.
    """
    found = []
    for key in ("viscous_friction", "coulomb_friction"):
        given = getattr(settings, key)
        if not isinstance(given, Mapping):
            found.append(np.full(len(motors.names), given, dtype=np.float64))
            continue
        unknown = sorted(set(given) - set(motors.names))
        if unknown:
            words = f"names of motors: {', '.join(motors.names)}"
            raise BadInput(words, "actuator", key, unknown[0])
        found.append(np.array([given.get(name, 0.0) for name in motors.names], dtype=np.float64))
    return np.array(found)


def friction_of(settings: ActuatorSettings, model: Model, period: float) -> Friction | None:
    """Return the friction of the motors, or None where there is none.

    Raises:
        BadInput: no actuator is a motor, or a name is that of none.
    """
    if not (settings.viscous_friction or settings.coulomb_friction):
        return None
    if not model.resolved_motors.names:
        raise BadInput(
            "actuator: viscous_friction and coulomb_friction are not allowed here: no actuator of "
            "this testbed is a motor in a joint or a wheel; give 0.0"
        )
    return Friction(model.resolved_motors, settings, period)
