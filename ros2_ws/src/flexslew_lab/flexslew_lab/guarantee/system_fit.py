"""A system over a box as a polynomial, without motions that the loop hides."""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from scipy.linalg import block_diag

from flexslew_lab.guarantee.box import Box
from flexslew_lab.guarantee.modal_cell import MatrixTerms, terms_of
from flexslew_lab.guarantee.polynomial import checks, fit_error, polynomial_over
from flexslew_plant.arrays import Matrix, Vector

_FIT, _SAFETY = 1e-11, 2.0  # of S, as of A in dynamics_fit


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
    samples = checks(exact, box)
    fitted = polynomial_over(exact, box, samples, _FIT)
    terms, (kept, n) = terms_of(fitted), shown.shape
    rows, columns = (block_diag(shown, np.eye(size - n)) for size in terms.matrices.shape[1:])
    matrices = rows @ terms.matrices @ columns.T
    return SystemFit(box, MatrixTerms(terms.exponents, matrices), kept,
                     _SAFETY * fit_error(fitted, samples).largest * n)  # fmt: skip
