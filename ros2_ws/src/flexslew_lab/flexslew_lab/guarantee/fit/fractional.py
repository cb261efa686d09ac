"""Linear fractional form: a system with known matrices, and real parameters fed back around it.

x(k + 1) = A x + B_w w + B_u u, v = C_v x + D_vw w + D_vu u, y = C_y x + D_yw w + D_yu u and
w = Delta v, Delta = diag(delta_1 I, ..., delta_m I, E) with |delta_i| <= 1 and a full block E,
|E| <= 1, for the error of the fit (Zhou, Doyle and Glover, Robust and Optimal Control, 1996, 10).
"""

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from scipy.linalg import block_diag, solve_discrete_lyapunov

from flexslew_lab.guarantee.box import Box
from flexslew_lab.guarantee.fit.polynomial import (
    MatrixSamples,
    Polynomial,
    Power,
    checks,
    fit_error,
    polynomial_over,
)
from flexslew_plant.arrays import Matrix, Vector

_RANK = 3e-8  # of the largest entry: what is less is left to the error
_ROUNDING = 1e-13  # of an error, of the largest entry
_SHARE = 0.3  # of the polynomial's error, which is no more exact
_ERROR_RANK, _SAFETY = 0.05, 2.0  # of the error's directions; of its size, known at points alone


@dataclass(frozen=True)
class Fractional:
    """A matrix S(Delta) = S + W (I - Delta D)^-1 Delta V of parameters in a box.

    Args:
        constant: S, shape (rows, columns).
        left: W, shape (rows, w).
        right: V, shape (v, columns).
        inner: D, shape (v, w).
        sizes: how often each parameter is repeated, shape (m,).
        error: rows and columns of the full block, behind all parameters; (0, 0): none.
        largest_error: measured, of the largest entry of S [-].
    """

    constant: Matrix
    left: Matrix
    right: Matrix
    inner: Matrix
    sizes: tuple[int, ...]
    error: tuple[int, int] = (0, 0)
    largest_error: float = 0.0

    @property
    def exact(self) -> bool:
        """Whether S is affine in all parameters, and the error of the fit rounding."""
        return not self.inner.any() and not any(self.error)

    def at(self, delta: Vector) -> Matrix:
        """Return S at normalised coordinates, shape (m,), the error zero."""
        each = np.repeat(delta, self.sizes)
        k = len(each)
        eye = np.eye(k)
        inner = np.linalg.solve(eye - each[:, None] * self.inner[:k, :k], each[:, None] * eye)
        return np.asarray(self.constant + self.left[:, :k] @ inner @ self.right[:k])


def fractional_over(function: Callable[[Vector], Matrix], box: Box) -> Fractional:
    """Return the linear fractional form of a matrix over a box, with its error as a block.

    Raises:
        BadInput: if the size of the matrix differs within the box, as of a delay over whole ticks.
    """
    samples = checks(function, box)
    return fractional_form(polynomial_over(function, box, samples), samples)


def fractional_form(polynomial: Polynomial, samples: MatrixSamples) -> Fractional:
    """Return a polynomial in linear fractional form, with its error at other points as a block.

    S = S_0 + sum of delta_i Q_i; the Q_i of all orders share their columns' space, Q_i = U_i R_i,
    so S = S_0 + U Delta_1 R, and R is a polynomial of one degree less, treated in the same way.

    Args:
        polynomial: S.
        samples: of the matrix that it stands for.
    """
    levels, m = [], polynomial.parameters
    terms = dict(polynomial.terms)
    scale = max(float(abs(samples.values).max()), 1e-300)
    least = max(_RANK * scale, _SHARE * fit_error(polynomial, samples).largest)
    constants = [terms.pop(())]
    while terms:
        left, rests, sizes = [], [], []
        for i in range(m):
            own = {power: s for power, s in terms.items() if power[0] == i}
            u, rest = _factors(own, least, constants[-1].shape[0])
            left.append(u)
            rests.append(rest)
            sizes.append(u.shape[1])
        levels.append((np.hstack(left), sizes))
        if not sum(sizes):
            break
        columns = constants[-1].shape[1]
        constants.append(np.vstack([rest.get((), np.zeros((k, columns)))
                                    for rest, k in zip(rests, sizes, strict=True)]))  # fmt: skip
        terms = _stacked(rests, sizes, columns)
    form = _assembled(constants, levels, m)
    for block in range(m):
        form = _balanced(form, block, least)
    return _with_error(form, samples, scale)


def _balanced(form: Fractional, block: int, tolerance: float) -> Fractional:
    """Return the form with a parameter repeated as often as its powers need.

    The powers of delta_i are the Markov parameters of a discrete system with the matrix D_ii; it is
    truncated in balanced coordinates, which turns a long polynomial into a short fraction.

    Args:
        form: linear fractional form without an error block.
        block: number of the parameter.
        tolerance: Hankel singular values that are left out.
    """
    first, size = sum(form.sizes[:block]), form.sizes[block]
    own = np.arange(first, first + size)
    others = np.setdiff1d(np.arange(len(form.inner)), own)
    a = form.inner[np.ix_(own, own)]
    b = np.hstack((form.right[own], form.inner[np.ix_(own, others)]))
    c = np.vstack((form.left[:, own], form.inner[np.ix_(others, own)]))
    if not size or abs(np.linalg.eigvals(a)).max() >= 1.0:
        return form
    reached = _root(solve_discrete_lyapunov(a, b @ b.T))
    seen = _root(solve_discrete_lyapunov(a.T, c.T @ c))
    left, values, right = np.linalg.svd(seen.T @ reached)
    kept = int(np.count_nonzero(values > tolerance))
    scale = 1.0 / np.sqrt(values[:kept])
    out, into = reached @ right[:kept].T * scale, (seen @ left[:, :kept] * scale).T
    before, after = np.eye(first), np.eye(len(form.inner) - first - size)
    out, into = block_diag(before, out, after), block_diag(before, into, after)
    sizes = (*form.sizes[:block], kept, *form.sizes[block + 1 :])
    return replace(form, left=form.left @ out, right=into @ form.right,
                   inner=into @ form.inner @ out, sizes=sizes)  # fmt: skip


def _root(gramian: Any) -> Matrix:
    values, vectors = np.linalg.eigh(gramian)
    return np.asarray(vectors * np.sqrt(np.maximum(values, 0.0)))


def _factors(
    terms: dict[Power, Matrix], least: float, rows: int
) -> tuple[Matrix, dict[Power, Matrix]]:
    """Return U and the polynomial R of delta_i Q_i = delta_i U R, for terms that begin with i."""
    if not terms:
        return np.zeros((rows, 0)), {}
    u, sizes, _ = np.linalg.svd(np.hstack(list(terms.values())), full_matrices=False)
    u = u[:, sizes > least]
    return u, {power[1:]: u.T @ s for power, s in terms.items()} if u.size else {}


def _stacked(
    rests: list[dict[Power, Matrix]], sizes: list[int], columns: int
) -> dict[Power, Matrix]:
    powers = {power for rest in rests for power in rest if power}
    return {
        power: np.vstack([rest.get(power, np.zeros((k, columns)))
                          for rest, k in zip(rests, sizes, strict=True)])
        for power in sorted(powers)
    }  # fmt: skip


def _assembled(
    constants: list[Matrix], levels: list[tuple[Matrix, list[int]]], m: int
) -> Fractional:
    """Return the nested form as one: channels of all levels, sorted by parameter.

    v_1 = R_0 x + U_2 w_2, w_1 = Delta_1 v_1, and so on.
    """
    levels = levels[: len(constants) - 1]
    owner = [i for _, sizes in levels for i, k in enumerate(sizes) for _ in range(k)]
    total, columns = len(owner), constants[0].shape[1]
    left, right = np.zeros((constants[0].shape[0], total)), np.zeros((total, columns))
    inner, first = np.zeros((total, total)), 0
    for number, (u, sizes) in enumerate(levels):
        here = slice(first, first + sum(sizes))
        if number == 0:
            left[:, here] = u
        else:
            before = slice(first - u.shape[0], first)
            inner[before, here] = u
        right[here] = constants[number + 1]
        first = here.stop
    order = np.argsort(owner, kind="stable")
    counts = tuple(int(np.count_nonzero(np.array(owner) == i)) for i in range(m))
    return Fractional(
        constants[0], left[:, order], right[order], inner[np.ix_(order, order)], counts
    )


def _with_error(form: Fractional, samples: MatrixSamples, scale: float) -> Fractional:
    """Return the form with a full block that covers its differences from the samples.

    Their directions are those of the stacked differences, their size is the largest times _SAFETY.
    """
    errors = [
        value - form.at(delta) for delta, value in zip(samples.delta, samples.values, strict=True)
    ]
    largest = max(float(abs(error).max()) for error in errors) / scale
    if largest <= _ROUNDING:
        return replace(form, largest_error=largest)
    u, sizes, _ = np.linalg.svd(np.hstack(errors), full_matrices=False)
    u = u[:, sizes > _ERROR_RANK * sizes[0]]
    _, sizes, v = np.linalg.svd(np.vstack(errors), full_matrices=False)
    v = v[sizes > _ERROR_RANK * sizes[0]]
    size = _SAFETY * max(float(np.linalg.norm(error, 2)) for error in errors)
    root = np.sqrt(size)
    return replace(
        form,
        left=np.hstack((form.left, root * u)),
        right=np.vstack((form.right, root * v)),
        inner=np.pad(form.inner, ((0, len(v)), (0, u.shape[1]))),
        error=(u.shape[1], len(v)),
        largest_error=largest,
    )
