"""The nominal motion of a testbed with joints that follow a shaped command, and its efforts."""

import numpy as np

from flexslew_control.planners.slew import Slew
from flexslew_plant.arrays import Matrix, Vector, compiled
from flexslew_plant.testbeds.compiled import interface
from flexslew_plant.testbeds.contract import shaped_motion
from flexslew_plant.testbeds.kernels import Kernels
from flexslew_plant.testbeds.model import Model

FINE = 4  # intervals of the grid per tick


def clamped_frequencies(model: Model) -> tuple[float, ...]:
    """Return the frequencies of the modes with the joints held [rad/s]."""
    linear = model.linearise(np.zeros(model.coordinates))
    m = model.joints
    return tuple(
        float(w) for w in np.sqrt(np.diag(linear.stiffness)[m:] / np.diag(linear.mass)[m:])
    )


def nominal_motion(
    slew: Slew, path: Vector, rate: Vector, h: float, equal: bool = False
) -> tuple[Matrix, Matrix]:
    """Return positions and rates of joints and modes on the grid, each of shape (times, n).

    Args:
        slew: the requested slew.
        path, rate: the shaped command from 0 to 1 and its derivative, shape (times,).
        h: interval of the grid [s].
        equal: whether every mode swings at the first one's frequency and damping.

    Raises:
        BadInput: if the joints cannot move so.
    """
    model, m = slew.model, slew.model.joints
    motion = shaped_motion(slew.testbed, path, rate, slew.start, slew.goal, h)
    q, v = np.zeros((path.size, model.coordinates)), np.zeros((path.size, model.coordinates))
    q[:, :m], v[:, :m] = motion.position, motion.velocity
    linear = model.linearise(np.zeros(model.coordinates))
    for j in range(m, model.coordinates):
        mass, mode = linear.mass[j, j], m if equal else j
        spring = linear.stiffness[mode, mode] / linear.mass[mode, mode]
        damper = linear.damping[mode, mode] / linear.mass[mode, mode]
        force = -(motion.drive @ linear.mass[:m, j]) / mass
        response = _forced_response(spring, damper, force, h)
        q[:, j], v[:, j] = response[:, 0], response[:, 1]
    return q, v


def mean_efforts(model: Model, q: Matrix, v: Matrix, h: float) -> Matrix:
    """Return the efforts that a motion needs, their mean over each tick, shape (ticks, joints).

    Args:
        model: the equations of motion.
        q, v: the motion on the grid, FINE intervals per tick, shape (times, n).
        h: interval of the grid [s].
    """
    efforts = _efforts(model.kernels, model.packed, q, v, h, model.joints)
    return np.asarray(efforts.reshape(-1, FINE, model.joints).mean(axis=1))


@compiled
def _forced_response(spring: float, damper: float, force: Vector, h: float) -> Matrix:
    """Return [x, x'] of x'' + damper x' + spring x = force from rest, shape (intervals + 1, 2).

    Exact for a force that is constant over each interval of h [s]; underdamped.
    """
    decay = 0.5 * damper
    frequency = np.sqrt(spring - decay**2)
    decay_factor, c, s = (
        np.exp(-decay * h),
        np.cos(frequency * h),
        np.sin(frequency * h) / frequency,
    )
    a, b = decay_factor * (c + decay * s), decay_factor * s
    e, d = -spring * b, decay_factor * (c - decay * s)
    out = np.zeros((force.size + 1, 2))
    for k in range(force.size):
        rest = force[k] / spring
        x, rate = out[k, 0] - rest, out[k, 1]
        out[k + 1, 0] = rest + a * x + b * rate
        out[k + 1, 1] = e * x + d * rate
    return out


@compiled
def _efforts(kernels: Kernels, p: Vector, q: Matrix, v: Matrix, h: float, joints: int) -> Matrix:
    """Return the joints' rows of M a + h, the mean over each interval of h [s].

    From the change of the rates over the interval, at the state midway: of second order, and with
    the right impulse where an acceleration jumps. Shape (intervals, joints).
    """
    n, m = q.shape[1], joints
    block, coupling, modal = np.empty((m, m)), np.empty((m, n - m)), np.empty(n - m)
    bias, x, out = np.empty(n), np.empty(2 * n), np.empty((len(q) - 1, m))
    for k in range(len(q) - 1):
        for i in range(n):
            x[i] = 0.5 * (q[k, i] + q[k + 1, i])
            x[n + i] = 0.5 * (v[k, i] + v[k + 1, i])
        interface.terms(kernels, p, (k + 0.5) * h, x, block, coupling, modal, bias)
        for i in range(m):
            total = bias[i] * h
            for j in range(m):
                total += block[i, j] * (v[k + 1, j] - v[k, j])
            for j in range(n - m):
                total += coupling[i, j] * (v[k + 1, m + j] - v[k, m + j])
            out[k, i] = total / h
    return out
