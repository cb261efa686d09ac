"""What the motors give of what is commanded, tick by tick, where they have a lag or a delay.

    z(k + 1) = A z(k) + B c(k),  e(k) = C z(k) + D c(k)

The matrices are those of analysis.linear_plant.motors: one model for plans, poles and margins.
"""

from typing import TypeAlias

import numpy as np

from flexslew_control.analysis.lti import Lti
from flexslew_plant.arrays import Matrix, Vector, compiled

Matrices: TypeAlias = tuple[Matrix, Matrix, Matrix, Matrix]


def matrices(motors: Lti) -> Matrices:
    """Return A, B, C and D as compiled code takes them."""
    a, b, c, d = (np.ascontiguousarray(one) for one in (motors.a, motors.b, motors.c, motors.d))
    return a, b, c, d


def at_once(joints: int) -> Matrices:
    """Return those of motors that give at once what is commanded."""
    none = np.zeros((0, joints))
    return np.zeros((0, 0)), none, none.T.copy(), np.eye(joints)


@compiled
def motor_step(motors: Matrices, z: Vector, u: Vector) -> None:
    """Turn commands into what the motors give, and their states into those of the next tick.

    Args:
        motors: A, B, C and D, of s states.
        z: the states, shape (s,); overwritten.
        u: commands; overwritten by the efforts, shape (joints,) [N m or N].
    """
    a, b, c, d = motors
    s, m = len(z), len(u)
    if s:
        effort, after = np.zeros(m), np.zeros(s)
        for j in range(m):
            for i in range(s):
                effort[j] += c[j, i] * z[i]
            for i in range(m):
                effort[j] += d[j, i] * u[i]
        for j in range(s):
            for i in range(s):
                after[j] += a[j, i] * z[i]
            for i in range(m):
                after[j] += b[j, i] * u[i]
        for j in range(s):
            z[j] = after[j]
        for j in range(m):
            u[j] = effort[j]
