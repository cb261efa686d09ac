"""A matrix that depends on parameters, as a polynomial over a box."""

from collections.abc import Callable, Sequence
from itertools import combinations_with_replacement
from typing import NamedTuple

import numpy as np

from flexslew_control.analysis.loop import Complex
from flexslew_lab.guarantee.box import Box, corners_and_inner
from flexslew_plant.arrays import Matrix, Tensor, Vector
from flexslew_plant.errors import BadInput

Power = tuple[int, ...]  # numbers of the parameters in a product, in ascending order

EXACT = 1e-8  # error at which a fit ends, of the largest entry [-]
_MOST_TERMS = 130
_DEGREE = 8
_ROUNDING = 1e-13  # of the largest entry
_SPREAD = 1.6  # points of a fit for each term
_INSIDE = 1.0 - 1e-6  # a delay changes the number of states at whole ticks, the sides of a box
_CHECKS, _MOST_CORNERS = 24, 64


class MatrixTerms(NamedTuple):
    """A polynomial as arrays: exponents, shape (k, m), and matrices, shape (k, n, n)."""

    exponents: Matrix
    matrices: Complex

    def derivative(self, at: Vector, axes: Sequence[int]) -> Vector:
        """Return the derivative of each product of powers at a point, shape (k,)."""
        left, factor = self.exponents.copy(), np.ones(len(self.exponents))
        for axis in axes:
            factor *= left[:, axis]
            left[:, axis] -= 1.0
        return np.asarray(factor * np.prod(at ** np.maximum(left, 0.0), axis=1))


class Polynomial(NamedTuple):
    """S(delta) = sum of S_a delta^a over a box.

    Args:
        terms: S_a by the parameters in the product delta^a; () is the constant.
        parameters: their number.
    """

    terms: dict[Power, Matrix]
    parameters: int

    def at(self, delta: Vector) -> Matrix:
        """Return S at normalised coordinates, shape (m,)."""
        return np.asarray(sum(_product(delta, power) * s for power, s in self.terms.items()))

    @property
    def arrays(self) -> MatrixTerms:
        """The terms as arrays."""
        exponents = np.array([[p.count(i) for i in range(self.parameters)] for p in self.terms])
        return MatrixTerms(exponents.astype(float), np.array(list(self.terms.values())))


class MatrixSamples(NamedTuple):
    """A matrix at points of a box that no fit has used."""

    delta: Matrix  # shape (k, m)
    values: Tensor  # shape (k, rows, columns)


def checks(function: Callable[[Vector], Matrix], box: Box) -> MatrixSamples:
    """Return a matrix at corners of a box, and at random points within.

    Raises:
        BadInput: if its size differs within the box, as of a delay over whole ticks.
    """
    rng = np.random.default_rng(2)
    delta = _INSIDE * corners_and_inner(len(box.centre), _MOST_CORNERS, _CHECKS, rng)
    values = [function(box.at(d)) for d in delta]
    if len({value.shape for value in values}) > 1:
        raise size_differs()
    return MatrixSamples(delta, np.array(values))


def size_differs() -> BadInput:
    """Return the error of a loop whose number of states differs within a box."""
    why = "the number of states changes within these ranges; keep a delay between whole ticks"
    return BadInput(why, key="vary")


def polynomial_over(
    function: Callable[[Vector], Matrix], box: Box, samples: MatrixSamples, exact: float = EXACT
) -> Polynomial:
    """Return the polynomial of least degree that has an error of `exact`, else the nearest one.

    Least squares at points denser towards the sides of the box, as Chebyshev's are. The degree
    rises until the error at other points is `exact`, or the terms are too many.

    Args:
        function: from values, shape (m,), to a matrix.
        box: of the values.
        samples: of the function at other points of the box.
        exact: error at which the degree stops rising, of the largest entry [-].
    """
    m, rng = len(box.centre), np.random.default_rng(1)
    points: Matrix = np.zeros((1, m))
    values = [function(box.at(points[0]))]
    scale = max(float(abs(samples.values).max()), 1e-300)
    best, least = Polynomial({(): values[0]}, m), np.inf
    for degree in range(1, _DEGREE + 1):
        powers = [p for d in range(degree + 1) for p in combinations_with_replacement(range(m), d)]
        if len(powers) > _MOST_TERMS:
            break
        missing = int(np.ceil(_SPREAD * len(powers))) + 2 * m - len(values)
        more = _INSIDE * np.cos(np.pi * rng.uniform(size=(missing, m)))
        points = np.vstack((points, more))
        values += [function(box.at(delta)) for delta in more]
        rows = np.array([[_product(delta, power) for power in powers] for delta in points])
        flat = np.array([value.ravel() for value in values])
        found = np.linalg.lstsq(rows, flat, rcond=None)[0]
        fitted = Polynomial(
            {p: row.reshape(values[0].shape) for p, row in zip(powers, found, strict=True)}, m
        )
        error = fit_error(fitted, samples).largest
        if error < least:
            best, least = fitted, error
        if least <= exact * scale:
            break
    return best


class FitError(NamedTuple):
    """Quality of a fit at points that it has not used.

    Args:
        largest: error of an entry.
        points: their number.
        exact: whether the polynomial is affine, and the error rounding.
    """

    largest: float
    points: int
    exact: bool

    @property
    def words(self) -> str:
        """The quality in words."""
        if self.exact:
            return "exact: affine in all parameters"
        return f"largest error {self.largest:.1e}, measured at {self.points} points"


def fit_error(fitted: Polynomial, samples: MatrixSamples) -> FitError:
    """Return the quality of a fit at points that it has not used."""
    largest = max(
        float(abs(fitted.at(d) - s).max())
        for d, s in zip(samples.delta, samples.values, strict=True)
    )
    rounding = _ROUNDING * float(abs(samples.values).max())
    affine = all(len(power) <= 1 for power in fitted.terms)
    return FitError(largest, len(samples.delta), affine and largest <= rounding)


def _product(delta: Vector, power: Power) -> float:
    return float(np.prod(delta[list(power)])) if power else 1.0
