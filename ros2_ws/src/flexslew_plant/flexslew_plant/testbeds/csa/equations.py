"""The equations of the CSA testbed as kernels: (4)-(11) of Gorinevsky and Vukovich (1998)."""

from typing import NamedTuple

import numpy as np

from flexslew_plant.arrays import Matrix, Vector
from flexslew_plant.testbeds.kernels import Kernels

# where the packed parameters lie, see testbed.packed
_COMPLETE, _J_A, _J_1, _J_2, _MODES = 0, 1, 2, 3, 4


class CsaNumbers(NamedTuple):
    """The numbers of the equations by name."""

    complete: bool
    j_a: float  # [kg m^2]
    j_1: float  # [kg m^2]
    j_2: float  # [kg m^2]
    coupling: Vector  # m_theta_q, (modes,) [kg m]
    mass: Vector  # diagonal of M_qq, (modes,) [kg]
    stiffness: Vector  # diagonal of K_qq, (modes,) [N/m]
    damping: Vector  # diagonal of C_qq, (modes,) [N s/m]


def unpack(p: Vector) -> CsaNumbers:
    """Return what packed has put together."""
    complete, j_a, j_1, j_2 = p[:_MODES]
    return CsaNumbers(complete > 0.5, j_a, j_1, j_2, *p[_MODES:].reshape(4, -1))


def highest_frequency(p: Matrix) -> Vector:
    """Return bounds of the highest frequencies with the joints free; see Model.

    max(K_qq / M_qq) / (1 - sum of m^2 / (M_qq J)) with J all that turns bounds their squares.

    Args:
        p: packed parameters of many testbeds, shape (4 + 4 modes, k).

    Returns:
        shape (k,) [rad/s].
    """
    n = (len(p) - _MODES) // 4
    m, mass, stiffness = p[_MODES:-n].reshape(3, n, -1)
    coupling_ratio = (m * (m / mass)).sum(axis=0) / (p[_J_A] + p[_J_1])
    found: Vector = np.sqrt((stiffness / mass).max(axis=0) / np.maximum(1.0 - coupling_ratio, 1e-3))
    return found


def scale_stiffness(p: Vector, factor: float) -> Vector:
    """Return the packed parameters with the bending stiffness multiplied by factor [-]."""
    n = (p.size - _MODES) // 4
    scaled = p.copy()
    scaled[_MODES + 2 * n : _MODES + 3 * n] *= factor
    scaled[_MODES + 3 * n :] *= np.sqrt(factor)
    return scaled


def terms(
    p: Vector, t: float, x: Vector, joints: Matrix, coupling: Matrix, modal: Vector, bias: Vector
) -> None:
    """Write M(q) and h(q, v) of M a + h = B u: (9)-(11), or their complete form.

    Args:
        p: packed parameters.
        x: state [q, v], shape (2 (2 + modes),).
        joints: out, the joint block of M, shape (2, 2) [kg m^2].
        coupling: out, M between joints and modes, shape (2, modes).
        modal: out, the diagonal M_qq, shape (modes,).
        bias: out, h, shape (2 + modes,).
    """
    n = x.size // 2 - 2
    j_a, c, s = p[_J_A], np.cos(x[1]), np.sin(x[1])
    yaw_rate, pitch_rate = x[2 + n], x[3 + n]
    deflection = 0.0  # m^T q
    deflection_rate = 0.0  # m^T q'
    for j in range(n):
        m = p[_MODES + j]
        deflection += m * x[2 + j]
        deflection_rate += m * x[4 + n + j]
        coupling[0, j] = c * m
        coupling[1, j] = 0.0
        modal[j] = p[_MODES + n + j]
    joints[0, 0] = p[_J_1] + j_a * c * c
    joints[1, 1] = p[_J_2]
    if p[_COMPLETE] > 0.5:
        joints[0, 1] = s * deflection
        bias[0] = -2.0 * c * s * j_a * yaw_rate * pitch_rate + c * pitch_rate**2 * deflection
        bias[1] = c * s * j_a * yaw_rate**2 + 2.0 * s * yaw_rate * deflection_rate
        coriolis = -2.0 * s * yaw_rate * pitch_rate
    else:
        joints[0, 1] = 0.0
        bias[0] = -2.0 * c * s * j_a * yaw_rate * pitch_rate - s * pitch_rate * deflection_rate
        bias[1] = c * s * j_a * yaw_rate**2 + s * yaw_rate * deflection_rate
        coriolis = -s * yaw_rate * pitch_rate
    joints[1, 0] = joints[0, 1]
    for j in range(n):
        stiffness, damping = p[_MODES + 2 * n + j], p[_MODES + 3 * n + j]
        bias[2 + j] = coriolis * p[_MODES + j] + stiffness * x[2 + j] + damping * x[4 + n + j]


def residual_jacobian(p: Vector, t: float, x: Vector, a: Vector, dq: Matrix, dv: Matrix) -> None:
    """Write the partial derivatives of r = M(q) a + h(q, v) at fixed a.

    Args:
        p, x: as in terms.
        a: accelerations, shape (2 + modes,).
        dq: out, dr/dq, shape (2 + modes, 2 + modes).
        dv: out, dr/dv, same shape.
    """
    n = x.size // 2 - 2
    j_a, c, s = p[_J_A], np.cos(x[1]), np.sin(x[1])
    w, r = x[2 + n], x[3 + n]  # yaw and pitch rates
    c2, s2 = c * c - s * s, 2.0 * c * s
    deflection, deflection_rate, deflection_acceleration = (
        0.0,
        0.0,
        0.0,
    )  # m^T q and its derivatives
    dq[:] = 0.0
    dv[:] = 0.0
    complete = p[_COMPLETE] > 0.5
    for j in range(n):
        m = p[_MODES + j]
        deflection += m * x[2 + j]
        deflection_rate += m * x[4 + n + j]
        deflection_acceleration += m * a[2 + j]
        dq[2 + j, 2 + j] = p[_MODES + 2 * n + j]
        dv[2 + j, 2 + j] = p[_MODES + 3 * n + j]
        if complete:
            dq[0, 2 + j] = (s * a[1] + c * r * r) * m
            dq[1, 2 + j] = s * a[0] * m
            dv[1, 2 + j] = 2.0 * s * w * m
            dq[2 + j, 1] = (-s * a[0] - 2.0 * c * w * r) * m
            dv[2 + j, 0] = -2.0 * s * r * m
            dv[2 + j, 1] = -2.0 * s * w * m
        else:
            dv[0, 2 + j] = -s * r * m
            dv[1, 2 + j] = s * w * m
            dq[2 + j, 1] = (-s * a[0] - c * w * r) * m
            dv[2 + j, 0] = -s * r * m
            dv[2 + j, 1] = -s * w * m
    dq[0, 1] = -j_a * s2 * a[0] - s * deflection_acceleration - 2.0 * c2 * j_a * w * r
    dq[1, 1] = c2 * j_a * w * w
    dv[0, 0] = -s2 * j_a * r
    dv[0, 1] = -s2 * j_a * w
    dv[1, 0] = s2 * j_a * w
    if complete:
        dq[0, 1] += (c * a[1] - s * r * r) * deflection
        dq[1, 1] += 2.0 * c * w * deflection_rate + c * a[0] * deflection
        dv[0, 1] += 2.0 * c * r * deflection
        dv[1, 0] += 2.0 * s * deflection_rate
    else:
        dq[0, 1] -= c * r * deflection_rate
        dq[1, 1] += c * w * deflection_rate
        dv[0, 1] -= s * deflection_rate
        dv[1, 0] += s * deflection_rate


def acceleration(p: Vector, t: float, x: Vector, effort: Vector, out: Vector) -> None:
    """Write a = M^-1 (B u - h) of `terms` in few operations: the modes are eliminated by hand.

    With S = sum of m^2 / M_qq, D = m^T q and r = c theta'' + coriolis, each mode is
    q'' = -(K q + C q' + m r) / M_qq, which leaves two equations for the joints.

    Args:
        p, x: as in terms.
        effort: of the drives, shape (2,) [N m].
        out: a, shape (2 + modes,).
    """
    n = x.size // 2 - 2
    j_a, c, s = p[_J_A], np.cos(x[1]), np.sin(x[1])
    yaw_rate, pitch_rate = x[2 + n], x[3 + n]
    deflection, deflection_rate, pull, share = 0.0, 0.0, 0.0, 0.0
    for j in range(n):
        m, inverse = p[_MODES + j], 1.0 / p[_MODES + n + j]
        stiffness, damping = p[_MODES + 2 * n + j], p[_MODES + 3 * n + j]
        deflection = m * x[2 + j] + deflection
        deflection_rate = m * x[4 + n + j] + deflection_rate
        pull = (m * inverse * stiffness) * x[2 + j] + pull
        pull = (m * inverse * damping) * x[4 + n + j] + pull
        share = share + m * m * inverse
    free = j_a - share
    yaw_component = s * yaw_rate
    if p[_COMPLETE] > 0.5:
        off, coriolis = s * deflection, -2.0 * yaw_component * pitch_rate
        first = effort[0] + c * (pull - free * coriolis - pitch_rate * (pitch_rate * deflection))
        second = effort[1] - yaw_component * (c * (j_a * yaw_rate) + 2.0 * deflection_rate)
    else:
        off, coriolis = 0.0, 0.0 - yaw_component * pitch_rate
        first = effort[0] + c * (pull + (share - 2.0 * j_a) * coriolis)
        first = first + s * pitch_rate * deflection_rate
        second = effort[1] - yaw_component * (c * (j_a * yaw_rate) + deflection_rate)
    pitch_inverse = 1.0 / p[_J_2]
    ratio = off * pitch_inverse
    out[0] = (first - ratio * second) / (p[_J_1] + free * (c * c) - off * ratio)
    out[1] = (second - off * out[0]) * pitch_inverse
    modal_input = c * out[0] + coriolis
    for j in range(n):
        inverse = 1.0 / p[_MODES + n + j]
        m, stiffness, damping = p[_MODES + j], p[_MODES + 2 * n + j], p[_MODES + 3 * n + j]
        stiffness_term = (stiffness * inverse) * x[2 + j] + (damping * inverse) * x[4 + n + j]
        out[2 + j] = 0.0 - ((m * inverse) * modal_input + stiffness_term)


def potential(p: Vector, t: float, q: Vector) -> float:
    """Return the strain energy of both beams (7) [J]."""
    n = q.size - 2
    energy = 0.0
    for j in range(n):
        energy += 0.5 * p[_MODES + 2 * n + j] * q[2 + j] ** 2
    return energy


KERNELS = Kernels(terms, residual_jacobian, potential, acceleration=acceleration)
