"""The closed loop over a box as a polynomial, without motions that it hides."""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from scipy.linalg import block_diag, null_space, schur

from flexslew_control.analysis.loop import Complex
from flexslew_lab.guarantee.box import Box
from flexslew_lab.guarantee.fit.polynomial import (
    FitError,
    MatrixTerms,
    checks,
    fit_error,
    polynomial_over,
)
from flexslew_plant.arrays import Matrix, Vector

_FIT = 1e-11  # error at which the fit ends, of the largest entry [-]
_SAFETY = 2.0  # of the fit's error, which is known at points alone
_CIRCLE, _ONE = 1e-9, 1e-5  # from the circle, from z = 1: poles of motions that a loop may hide
_HIDDEN = 1e-9  # of the largest entry: what is less does not act on such a motion


class DynamicsFit(NamedTuple):
    """A over a box.

    Args:
        box: of the parameters.
        shown: orthonormal rows that leave hidden rigid motions out, shape (k, n).
        terms: of shown A shown^T in normalised coordinates.
        error: of each entry, measured and doubled.
        quality: of the fit before hidden motions are left out.
    """

    box: Box
    shown: Matrix
    terms: MatrixTerms
    error: float
    quality: FitError

    def poles(self, delta: Matrix) -> Complex:
        """Return the poles in z at normalised coordinates, shape (points, m), one row for each."""
        powers = np.prod(delta[:, None, :] ** self.terms.exponents, axis=2)
        return np.asarray(np.linalg.eigvals(np.tensordot(powers, self.terms.matrices, 1)))


def dynamics_fit(dynamics: Callable[[Vector], Matrix], box: Box) -> DynamicsFit:
    """Return A over a box as a polynomial, without hidden rigid motions.

    Args:
        dynamics: A at values of the parameters, shape (n, n).
        box: of the parameters.

    Raises:
        BadInput: if the size of A differs within the box.
    """
    terms, quality = _terms_over(dynamics, box)
    shown = np.eye(terms.matrices.shape[1])
    for transposed in (False, True):
        shown = _without_hidden(shown, terms, transposed) @ shown
    return DynamicsFit(
        box, shown, MatrixTerms(terms.exponents, shown @ terms.matrices @ shown.T),
        _SAFETY * quality.largest * len(terms.matrices[0]), quality,
    )  # fmt: skip


class SystemFit(NamedTuple):
    """[[A, B], [C, D]] over a box, without hidden motions; outputs of the response last.

    Args:
        box: of the parameters.
        terms: in normalised coordinates.
        states: that are left.
        error: of each entry.
    """

    box: Box
    terms: MatrixTerms
    states: int
    error: float


def system_fit(exact: Callable[[Vector], Matrix], box: Box, shown: Matrix) -> SystemFit:
    """Return a system over a box as a polynomial.

    Args:
        exact: [[A, B], [C, D]] at values.
        box: of these.
        shown: rows that leave hidden motions out, see DynamicsFit.
    """
    (terms, quality), (kept, n) = _terms_over(exact, box), shown.shape
    rows, columns = (block_diag(shown, np.eye(size - n)) for size in terms.matrices.shape[1:])
    matrices = rows @ terms.matrices @ columns.T
    return SystemFit(
        box, MatrixTerms(terms.exponents, matrices), kept, _SAFETY * quality.largest * n
    )


def _terms_over(function: Callable[[Vector], Matrix], box: Box) -> tuple[MatrixTerms, FitError]:
    samples = checks(function, box)
    fitted = polynomial_over(function, box, samples, _FIT)
    return fitted.arrays, fit_error(fitted, samples)


def _without_hidden(shown: Matrix, terms: MatrixTerms, transposed: bool) -> Matrix:
    """Return rows that leave out motions on the circle which no parameter touches.

    N is the largest space of them that A_0 keeps and every other A_a maps to zero: nothing reads
    them. Transposed: nothing moves them. Their poles are those of A_0, whatever the parameters are.
    """
    parts = shown @ terms.matrices @ shown.T
    if transposed:
        parts = np.swapaxes(parts, 1, 2)
    constant = terms.exponents.sum(axis=1) == 0.0
    n = parts.shape[1]
    triangular, basis, kept = schur(parts[constant][0], sort=_on_circle)
    if not kept:
        return np.eye(n)
    motions, powers = basis[:, :kept], [np.eye(kept)]
    for _ in range(kept - 1):
        powers.append(triangular[:kept, :kept] @ powers[-1])
    effects = np.vstack([part @ motions @ power for power in powers for part in parts[~constant]])
    _, sizes, rows = np.linalg.svd(effects)
    rank = int(np.count_nonzero(sizes > _HIDDEN * max(float(abs(parts).max()), 1.0)))
    hidden = motions @ rows[rank:].T
    return np.asarray(null_space(hidden.T).T) if hidden.shape[1] else np.eye(n)


def _on_circle(real: float, imaginary: float = 0.0) -> bool:
    z = complex(real, imaginary)
    return abs(z) > 1.0 - _CIRCLE or abs(z - 1.0) < _ONE
