"""Least squares on the columns of a tall matrix, and the low frequencies to which it is cut."""

import numpy as np
from scipy.fft import dct, prev_fast_len
from scipy.linalg import LinAlgError, cho_factor, cho_solve
from scipy.signal import butter, sosfilt

from flexslew_plant.arrays import Matrix, Vector

_RIDGE = 1e-13
_ABOVE = 1.3  # frequencies that are kept, in parts of the end of the band
_PER_PERIOD = 5.0  # means in a period of the highest frequency that is kept


class LowFrequencies:
    """The part of signals below a frequency: the low end of the cosine transform of means.

    Both are orthonormal rows, so white noise stays white and keeps its size, and a fit is exact
    for any part left out. Frequencies above the band add no information, but most of the work.

    Args:
        samples: number of samples of a signal.
        period: time between them [s].
        highest: end of the band [rad/s].
        lowest: corner of a high pass of second order on all signals [rad/s]; 0: none. The rate of
            a free body sums every error of the effort; the filter removes it.

    Attributes:
        each: samples of a mean.
        rows: coefficients.
    """

    def __init__(self, samples: int, period: float, highest: float, lowest: float = 0.0) -> None:
        self.each = max(int(2.0 * np.pi / (_ABOVE * highest * _PER_PERIOD * period)), 1)
        # of a length with a large prime factor the transform takes fifteen times as long
        self._means = prev_fast_len(samples // self.each, real=True)
        requested = int(np.ceil(_ABOVE * highest * samples * period / np.pi)) + 1
        self.rows = min(self._means, requested)
        nyquist = np.pi / (self.each * period)
        self._high = butter(2, lowest / nyquist, "highpass", output="sos") if lowest else None

    def __call__(self, columns: Matrix) -> Matrix:
        """Return the coefficients of every column, (rows, columns)."""
        each, count = self.each, self._means
        return self.of_sums(columns[: each * count].reshape(count, each, -1).sum(axis=1))

    def of_sums(self, sums: Matrix) -> Matrix:
        """Return the coefficients of columns from their sums over `each` samples.

        Sums of samples behind the last that is transformed are left out.
        """
        means = np.ascontiguousarray(sums[: self._means].T) / np.sqrt(self.each)
        if self._high is not None:
            means = sosfilt(self._high, means, axis=1)
        found = dct(means, type=2, norm="ortho", axis=1)[:, : self.rows]
        return np.ascontiguousarray(found.T)


class Projection:
    """Least squares on the columns of a tall matrix, by Cholesky's factor of its Gram matrix.

    One correction with the residual brings back what squaring the condition number costs (corrected
    semi-normal equations, Bjorck 1987).

    Args:
        columns: of unit length, (rows, n).
    """

    def __init__(self, columns: Matrix) -> None:
        self._columns = columns
        gram = columns.T @ columns
        try:
            self._factor = cho_factor(gram)
        except LinAlgError:  # columns that depend on one another
            self._factor = cho_factor(gram + _RIDGE * np.eye(len(gram)))

    def coordinates(self, right: Matrix) -> Matrix:
        """Return the least-squares weights of the columns, (n, ...)."""
        return np.asarray(cho_solve(self._factor, self._columns.T @ right))

    def solve(self, right: Vector) -> tuple[Vector, Vector]:
        """Return the weights and the residual."""
        weights = self.coordinates(right)
        weights = weights + self.coordinates(right - self._columns @ weights)
        return weights, right - self._columns @ weights

    @property
    def inverse(self) -> Matrix:
        """Of the Gram matrix, (n, n)."""
        return np.asarray(cho_solve(self._factor, np.eye(self._columns.shape[1])))
