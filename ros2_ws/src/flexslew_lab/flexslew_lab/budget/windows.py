"""Error metrics of ECSS-E-ST-60-10C as exact filters of the ticks of a run.

With windows of N ticks laid end to end, e(k) the error at tick k and m(w) its mean over window w:
    APE  e(k),    MPE  m(w),    RPE  e(k) - m(w),    PDE  m(w + s) - m(w),
s windows apart. The same of an error of knowledge are AKE, MKE, RKE and KDE. Nothing is
approximated: a white noise n of unit variance that acts from tick 0 on with the impulse response h
has e(k) = sum h(k - j) n(j), and each mean is a sum of the same n(j).
"""

from dataclasses import dataclass

import numpy as np

from flexslew_plant.arrays import Matrix, Tensor
from flexslew_plant.errors import BadInput

METRICS = ("APE", "MPE", "RPE", "PDE")
KNOWLEDGE = {"APE": "AKE", "MPE": "MKE", "RPE": "RKE", "PDE": "KDE"}


@dataclass(frozen=True)
class Windows:
    """The ticks that are observed, and the windows in them.

    Args:
        first: first tick that counts.
        last: last one.
        length: ticks of a window, N.
        apart: from a window to the one that PDE compares it with, s [windows].
    """

    first: int
    last: int
    length: int
    apart: int = 1

    @property
    def count(self) -> int:
        """Number of whole windows; a last one that is cut short does not count."""
        return (self.last - self.first + 1) // self.length

    def of_series(self, error: Matrix) -> dict[str, Matrix]:
        """Return the metrics of errors at all ticks of a run.

        Args:
            error: shape (ticks, axes), from tick 0 on.

        Returns:
            by metric, shape (points, axes): APE and RPE by tick, MPE by window, PDE by pair.
        """
        found = {"APE": error[self.first : self.last + 1]}
        if self.count:
            windows = self._split(error)
            mean = windows.mean(axis=1)
            found |= {"MPE": mean, "RPE": (windows - mean[:, None]).reshape(-1, error.shape[1])}
            if self.count > self.apart:
                found["PDE"] = mean[self.apart :] - mean[: -self.apart]
        return found

    def of_noise(self, response: Tensor) -> dict[str, Matrix]:
        """Return variances of the metrics under independent white noises of variance one.

        Args:
            response: impulse responses h, shape (ticks, axes, noises), from tick 0 on.

        Returns:
            by metric, shape (points, axes).
        """
        absolute = np.cumsum((response**2).sum(axis=2), axis=0)
        found = {"APE": absolute[self.first : self.last + 1]}
        if self.count:
            average = _moving_mean(response, self.length)
            mean = np.cumsum((average**2).sum(axis=2), axis=0)[self._ends]
            own = self._split(absolute) + mean[:, None]
            relative = np.maximum(own - 2.0 * self._covariances(response, average), 0.0)
            found |= {"MPE": mean, "RPE": relative.reshape(-1, response.shape[1])}
            if self.count > self.apart:
                shift = self.apart * self.length
                drift = average.copy()
                drift[shift:] -= average[:-shift]
                ends = self._ends[self.apart :]
                found["PDE"] = np.cumsum((drift**2).sum(axis=2), axis=0)[ends]
        return found

    def _covariances(self, response: Tensor, average: Tensor) -> Tensor:
        """Return the covariance of each error with the mean of its window.

        Of a tick s ticks before the end of its window it is the sum over i of h(i) g(i + s), with
        g the moving mean of h, as far as there was noise.

        Args:
            response: h, shape (ticks, axes, noises).
            average: g, likewise.

        Returns:
            shape (windows, N, axes).
        """
        found = np.zeros((self.count, self.length, response.shape[1]))
        for before_end in range(self.length):
            shifted = average[before_end:]
            products = np.einsum("kan,kan->ka", response[: len(shifted)], shifted)
            sums = np.cumsum(products, axis=0)
            found[:, self.length - 1 - before_end] = sums[self._ends - before_end]
        return found

    @property
    def _ends(self) -> "np.typing.NDArray[np.int64]":
        """Last tick of each window, shape (windows,)."""
        return self.first + self.length * np.arange(1, self.count + 1) - 1

    def _split(self, error: Matrix) -> Tensor:
        """Return the ticks of whole windows, shape (windows, N, axes)."""
        ticks = error[self.first : self.first + self.count * self.length]
        return ticks.reshape(self.count, self.length, error.shape[1])


def _moving_mean(response: Tensor, length: int) -> Tensor:
    """Return the mean over this and the N - 1 ticks before, zero before tick 0."""
    total = np.cumsum(response, axis=0)
    total[length:] = total[length:] - total[:-length].copy()
    return np.asarray(total / length)


def windows_of(
    first: int, last: int, period: float, seconds: float, apart: float | None = None
) -> Windows:
    """Return the windows of an observation.

    Args:
        first: its first tick.
        last: its last tick.
        period: one tick [s].
        seconds: length of a window [s].
        apart: from the begin of a window to that of the one for PDE [s]; None: the next window.

    Raises:
        BadInput: a window is shorter than a tick, or the two are not whole windows apart.
    """
    length = round(seconds / period)
    if length < 1:
        raise BadInput(f"at least a tick of {period:g} s", key="--window", value=seconds)
    shift = 1.0 if apart is None else apart / (length * period)
    if round(shift) < 1 or abs(shift - round(shift)) > 1e-6 * shift:
        words = f"a whole number of windows of {length * period:g} s"
        raise BadInput(words, key="--drift", value=apart)
    return Windows(first, last, length, round(shift))
