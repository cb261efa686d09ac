"""First-order equations x' = A x + B u exactly as M q'' + D q' + K q = E u with the joints first.

Rows T of as many coordinates q = T x as half of the states, with T B = 0, have q' = T A x; where
[T; T A] is regular, q'' = T A^2 x + T A B u = -K' q - D' q' + B' u. The joints' positions are rows
of T. Where their mobility B'_j, the first rows of B', is symmetric and positive definite,
    M = [ J, L; L^T, 1 ],  L^T = -B'_m B'_j^-1,  J = B'_j^-1 + L L^T
has M B' = [1; 0]: efforts act on the joints alone, as of any mechanism with motors in its joints.
The other coordinates are the motions with the joints held, about where these rest: shifted by
K_mm^-1 K_mj of the joints (Craig and Bampton's static shapes), and scaled such that M and K are
symmetric where the plant is a mechanism's.
"""

from collections.abc import Iterator
from itertools import pairwise
from typing import NamedTuple

import numpy as np
from scipy.linalg import eig, null_space

from flexslew_plant.arrays import Matrix
from flexslew_plant.errors import BadInput
from flexslew_plant.testbeds.linear.blocks import blocks

_SAME = 1e-9  # of its size: what rounding leaves of a zero
_RECIPROCAL = 1e-10  # of a mobility, by which it may differ from a symmetric one
_REGULAR = 1e10  # largest condition of [T; T A], rows of equal size
_REAL = 1e-9  # of the largest, imaginary part of a squared frequency that is real
_TRIALS = 20  # choices of T, where the natural one is not regular


class SecondOrder(NamedTuple):
    """M q'' + D q' + K q = E u and where its state is that of the first-order equations."""

    joints: Matrix  # J, (m, m)
    coupling: Matrix  # L, (m, k)
    stiffness: Matrix  # K, (n, n)
    damping: Matrix  # D, (n, n)
    effort: Matrix  # E, (n, m); [1; 0] of efforts in the joints
    states: Matrix  # [q, q'] of x, (2 n, states)
    decoupled: bool  # whether the modes are those with the joints held, rising


def second_order(a: Matrix, b: Matrix, position: Matrix, others: Matrix) -> SecondOrder:
    """Return the second-order form of a plant.

    Args:
        a: its state matrix, shape (states, states).
        b: its input matrix, shape (states, m).
        position: rows of the joints' positions, shape (m, states), with position b = 0.
        others: rows of what else is measured, shape (k, states).

    Raises:
        BadInput: no rows T have the properties above, or an effort does not move its joint.
    """
    m = len(position)
    rows = _coordinates(a, b, position, np.vstack((position, others)))
    stiffness, _, mobility = _accelerations(a, b, rows)
    least = np.diag(mobility[:m]).min()
    if least <= _SAME * np.abs(mobility).max(initial=0.0):
        k = int(np.diag(mobility[:m]).argmin())
        raise BadInput(
            f"input {k + 1} does not accelerate its joint forward at once (C A B = {least:.3g}); "
            "name it -effort.JOINT if it pushes back, name inputs by their joints, or leave the "
            "lag of the motors to `actuator`"
        )
    share = mobility[m:] @ np.linalg.pinv(mobility[:m])
    held = stiffness[m:, m:] - share @ stiffness[:m, m:]
    rows[m:] += np.linalg.pinv(held) @ (stiffness[m:, :m] - share @ stiffness[:m, :m]) @ rows[:m]
    shapes = _modes(held)
    if shapes is not None:
        rows[m:] = shapes @ rows[m:]
        stiffness, _, mobility = _accelerations(a, b, rows)
        rows[m:] *= _scales(stiffness, mobility)[:, None]
    stiffness, damping, mobility = _accelerations(a, b, rows)
    joints, coupling, in_joints = _masses(mobility, m)
    mass = np.block([[joints, coupling], [coupling.T, np.eye(len(rows) - m)]])
    effort = np.eye(len(rows), m) if in_joints else mass @ mobility
    return SecondOrder(
        joints,
        coupling,
        mass @ stiffness,
        mass @ damping,
        effort,
        np.vstack((rows, rows @ a)),
        shapes is not None,
    )


def _accelerations(a: Matrix, b: Matrix, rows: Matrix) -> tuple[Matrix, Matrix, Matrix]:
    """Return K', D' and B' of q'' = -K' q - D' q' + B' u."""
    rates = rows @ a
    found = np.linalg.solve(np.vstack((rows, rates)).T, (rates @ a).T).T
    slopes = -np.asarray(found, dtype=np.float64)
    n = len(rows)
    return slopes[:, :n], slopes[:, n:], rates @ b


def _masses(mobility: Matrix, m: int) -> tuple[Matrix, Matrix, bool]:
    """Return J, L and whether efforts act in their joints; if not, what each moves alone and 0."""
    at_joints = mobility[:m]
    symmetric = 0.5 * (at_joints + at_joints.T)
    asymmetry = np.abs(at_joints - at_joints.T).max(initial=0.0)
    reciprocal = asymmetry <= _RECIPROCAL * np.abs(at_joints).max(initial=0.0)
    if not reciprocal or np.linalg.eigvalsh(symmetric).min() <= 0.0:
        return np.diag(1.0 / np.diag(at_joints)), np.zeros((m, len(mobility) - m)), False
    inverse = np.linalg.inv(symmetric)
    coupling = -(mobility[m:] @ inverse).T
    joints = inverse + coupling @ coupling.T
    return 0.5 * (joints + joints.T), coupling, True


def _modes(held: Matrix) -> Matrix | None:
    """Return the rows of the modes with the joints held, of rising frequency; None: none exist."""
    if not len(held):
        return held
    values, left = eig(held.T)
    size = float(np.abs(values).max(initial=0.0))
    if np.abs(values.imag).max(initial=0.0) > _REAL * size or np.linalg.cond(left.real) > _REGULAR:
        return None
    shapes: Matrix = left.real.T[np.argsort(values.real)]
    return shapes


def _scales(stiffness: Matrix, mobility: Matrix) -> Matrix:
    """Return the scale of each mode with which the joints push it as much as it pushes them."""
    m = mobility.shape[1]
    inverse = np.linalg.pinv(mobility[:m])
    share = mobility[m:] @ inverse
    squares = np.diag(stiffness[m:, m:] - share @ stiffness[:m, m:])
    on_joints = inverse @ stiffness[:m, m:]  # their effort per unit of each mode
    on_modes = (stiffness[m:, :m] - share @ stiffness[:m, :m]).T + share.T * squares
    product = (on_joints * on_modes).sum(axis=0)
    size = (on_modes**2).sum(axis=0)
    ratio = np.divide(product, size, out=np.ones_like(product), where=size > 0.0)
    sign = np.where(share.sum(axis=1) > 0.0, -1.0, 1.0)  # L is positive
    return np.asarray(sign * np.sqrt(np.where(ratio > 0.0, ratio, 1.0)))


def _coordinates(a: Matrix, b: Matrix, position: Matrix, outputs: Matrix) -> Matrix:
    """Return T, the joints' positions first, with T B = 0 and [T; T A] regular.

    Raises:
        BadInput: there are none.
    """
    n, m = len(a) // 2, len(position)
    best, condition = position, np.inf
    for rows in _choices(a, b, outputs, n):
        known = np.linalg.lstsq(rows.T, position.T, rcond=None)[0].T
        beside = np.linalg.qr(known.T, mode="complete")[0][:, m:].T @ rows
        beside -= beside @ b @ np.linalg.pinv(b)
        found = np.vstack((position, beside))
        if len(found) != n:
            break
        found[m:] /= np.linalg.norm(found[m:], axis=1)[:, None] + 1e-300
        both = np.vstack((found, found @ a))
        sizes = np.linalg.norm(both, axis=1)[:, None]
        now = np.linalg.cond(both / sizes) if sizes.all() else np.inf
        if now < condition:
            best, condition = found, now
        if condition < _REGULAR**0.5:
            break
    if condition > _REGULAR:
        raise BadInput(
            "has no second-order form: its states are no coordinates and their rates; reduce it to "
            "its minimal realisation, or add the lag of the actuators"
        )
    return best


def _choices(a: Matrix, b: Matrix, outputs: Matrix, n: int) -> Iterator[Matrix]:
    """Give rows of coordinates to try, each of shape (n, states): of each pair of poles first."""
    yield _natural(a, b, outputs)
    free = null_space(b.T).T if b.any() else np.eye(len(a))
    rng = np.random.default_rng(0)
    for _ in range(_TRIALS):
        pick = np.linalg.qr(rng.standard_normal((len(free), n)))[0].T
        yield pick @ free


def _natural(a: Matrix, b: Matrix, outputs: Matrix) -> Matrix:
    """Return half as many rows of each block as it has states, which no effort enters at once.

    Of a mode these are its displacement: what the outputs read and no effort changes at once.
    """
    parts, rows = blocks(a), []
    k = len(parts.first)
    edges = [0, k, *range(k + 2, len(a) + 1, 2)]
    for begin, end in pairwise(edges):
        where = slice(begin, end)
        entry, reading = parts.left[where] @ b, outputs @ parts.right[:, where]
        weights = _normalised(entry @ entry.T) - _normalised(reading.T @ reading)
        vectors = np.linalg.eigh(weights)[1][:, : (end - begin) // 2]
        rows.append(vectors.T @ parts.left[where])
    return np.vstack(rows)


def _normalised(square: Matrix) -> Matrix:
    size = float(np.linalg.norm(square))
    return square / size if size > 0.0 else square
