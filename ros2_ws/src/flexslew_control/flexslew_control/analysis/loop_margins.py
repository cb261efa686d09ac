"""Margins of a sampled loop: gain, phase and delay per channel, disks, peaks of S and T.

python-control finds the margins of a discrete loop from polynomials, which for the forty and more
poles of these loops, many on the unit circle, keep no digit. Here crossings are found on a grid
that is dense near every pole, and then by Brent's method on the state space.
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.optimize import brentq, minimize

from flexslew_control.analysis.loop import Complex, ControlLoop
from flexslew_plant.arrays import Matrix, Vector

_SLOW, _LOWEST = 1e-4, 1e-7  # of pi / T: where the grid begins, and where at the earliest
_BELOW = 0.01  # of the slowest pole: where the grid begins, if that is before _SLOW
_POINTS, _A_DECADE = 600, 150  # of the grid above _SLOW, and in each decade before it
_FLAT = 0.01  # change of L over an octave, of its size, and its angle, where it is that at zero
_NEAR = np.concatenate((-np.geomspace(30.0, 1e-3, 40), np.geomspace(1e-3, 30.0, 40)))  # widths
_OFFSETS = np.geomspace(1e-9, 0.01, 80)  # of a crossover: where a delay margin may lie
_SCALING_STEPS = 20
_POWERS = (20.0, 200.0, 2000.0)  # of singular values, in norms that end near the largest one
_POLE = 1e8  # |L| beyond that is a pole on the circle, and no crossing


@dataclass(frozen=True)
class ChannelMargins:
    """Margins of one channel with all others closed.

    Args:
        name: of the channel.
        gain_up, gain_down: factors at which a pole is on the unit circle; inf and 0: none.
        up_frequency, down_frequency: of that pole [rad/s]; nan: none.
        phase: smallest angle, either way [rad]; inf: none.
        phase_frequency: where it is [rad/s].
        delay: that takes a pole to the circle [s]; inf: none.
        delay_frequency: of that pole [rad/s].
        crossovers: where |L| is one [rad/s].
    """

    name: str
    gain_up: float
    up_frequency: float
    gain_down: float
    down_frequency: float
    phase: float
    phase_frequency: float
    delay: float
    delay_frequency: float
    crossovers: tuple[float, ...]


@dataclass(frozen=True)
class LoopFrequencyResponse:
    """A loop's response over a grid of frequencies.

    Args:
        loop: the loop.
        grid: shape (k,) [rad/s].
        response: response at each frequency, see Loop.response.
    """

    loop: ControlLoop
    grid: Vector
    response: Complex

    def gain(self, names: tuple[str, ...]) -> Complex:
        """Return L of the loop cut at these places, shape (k, names, names)."""
        return self.loop.loop_gain(names, self.response)


def frequency_response(loop: ControlLoop) -> LoopFrequencyResponse:
    """Return the response of a loop over frequencies that show all of it."""
    grid = frequencies(loop)
    return LoopFrequencyResponse(loop, grid, loop.response(grid))


def frequencies(loop: ControlLoop) -> Vector:
    """Return a grid from below the slowest pole to half the sampling rate [rad/s].

    It is dense near every pole. Poles that are slower than _SLOWEST are rigid motions: in rounding
    they are not zero.
    """
    top = np.pi / loop.system.period
    z = np.concatenate([np.linalg.eigvals(loop.system.a), loop.poles])
    s = np.log(z[abs(z) > 1e-6].astype(complex)) / loop.system.period
    w = s.imag[s.imag > 0.0]
    width = np.maximum(abs(s.real[s.imag > 0.0]), 1e-5 * w)
    width = np.minimum(width, 0.03 * w)
    near = (w[:, None] + width[:, None] * _NEAR).ravel()
    first = _BELOW * min(abs(s[abs(s) > _LOWEST * top]), default=top)
    first, slow = max(first, _LOWEST * top), _SLOW * top
    before = np.zeros(0)
    if first < slow:
        before = np.geomspace(first, slow, 2 + int(_A_DECADE * np.log10(slow / first)))
    grid = np.concatenate((before, np.geomspace(slow, top * (1.0 - 1e-9), _POINTS), near))
    return np.unique(grid[(grid >= min(first, slow)) & (grid < top)])


def channel_margins(sweep: LoopFrequencyResponse, name: str) -> ChannelMargins:
    """Return the margins of an effort or a sensor, the others closed."""
    found = _Channel(sweep, name)
    gains = found.gain_crossovers()
    up = min(((g, w) for g, w in gains if g > 1.0), default=(np.inf, np.nan))
    down = max(((g, w) for g, w in gains if 0.0 < g < 1.0), default=(0.0, np.nan))
    crossovers = found.unit_crossovers()
    phases = [(abs(np.angle(-found(w))), w) for w in crossovers]
    phase = min(phases, default=(np.inf, np.nan))
    delay_margins = [found.delay(w) for w in crossovers]
    ends = [(d, w) for d, w in delay_margins if np.isfinite(d)]
    delay = min(ends, default=(np.inf, np.nan))
    return ChannelMargins(name, *up, *down, *phase, *delay, tuple(crossovers))


class _Channel:
    """L of one channel on the unit circle."""

    def __init__(self, sweep: LoopFrequencyResponse, name: str) -> None:
        self._loop, self._name, self._grid = sweep.loop, (name,), sweep.grid
        self._period = sweep.loop.system.period
        self._values = sweep.gain(self._name)[:, 0, 0]

    def __call__(self, w: float) -> complex:
        """Return L at a frequency [rad/s]."""
        try:
            return complex(self._at(np.array([w]))[0])
        except np.linalg.LinAlgError:  # a pole
            return complex(_POLE**2)

    def _at(self, w: Vector) -> Complex:
        return self._loop.loop_gain(self._name, self._loop.response(w))[:, 0, 0]

    def _roots(self, f: Callable[[Any], Any]) -> list[float]:
        sign = np.sign(f(self._values))
        return [
            float(brentq(lambda w: f(self(w)), self._grid[k], self._grid[k + 1], xtol=1e-13))
            for k in np.flatnonzero(sign[:-1] * sign[1:] < 0.0)
        ]

    def gain_crossovers(self) -> list[tuple[float, float]]:
        """Return every gain that puts a pole on the circle, and its frequency."""
        places = [*self._roots(lambda value: value.imag), np.pi / self._period]
        found = []
        at_zero = self._at_zero()
        if at_zero < 0.0:
            found.append((-1.0 / at_zero, 0.0))
        for w in places:
            value = self(w)
            if abs(value) < _POLE and value.real < 0.0:
                found.append((-1.0 / value.real, w))
        return found

    def _at_zero(self) -> float:
        """Return L at z = 1, where it is real; 0: it has a pole or a zero there, or is none.

        Below the slowest pole L is L(0) + c w^2 and an imaginary part that grows with w. Rigid
        motions that have no part in it make the equations singular at z = 1 itself.
        """
        near, far = self._at(self._grid[0] * np.array([1.0, 2.0]))
        if max(abs(far - near), abs(near.imag)) > _FLAT * abs(near):
            return 0.0
        return float((4.0 * near.real - far.real) / 3.0)

    def unit_crossovers(self) -> list[float]:
        """Return where |L| is one [rad/s]."""
        return self._roots(lambda value: abs(value) - 1.0)

    def _near_frequencies(self, w: float) -> Vector:
        """Return frequencies about a crossover, denser the nearer: a resonance may be narrow."""
        coarse = np.linspace(0.7, 1.3, 801)
        near = w * np.unique(np.concatenate((coarse, 1.0 - _OFFSETS, 1.0 + _OFFSETS)))
        return near[near < np.pi / self._period * (1.0 - 1e-9)]

    def delay(self, w: float) -> tuple[float, float]:
        """Return the delay that puts a pole on the circle near a crossover, and its frequency.

        L(z) ((1 - p) z^-k + p z^-(k + 1)) = -1 for k whole ticks and a part p.
        """
        h = self._period
        late = np.angle(-self(w)) % (2.0 * np.pi) / (w * h)
        near = self._near_frequencies(w)
        values = self._at(near)
        best = (np.inf, np.nan)
        for whole in range(max(0, int(late) - 2), int(late) + 3):

            def part(v: Any, value: Any, whole: int = whole) -> Any:
                return (-np.exp(1j * v * h * whole) / value - 1.0) / (np.exp(-1j * v * h) - 1.0)

            sign = np.sign(part(near, values).imag)
            for k in np.flatnonzero(sign[:-1] * sign[1:] < 0.0):
                v = float(brentq(lambda v: part(v, self(v)).imag, near[k], near[k + 1]))
                p = part(v, self(v)).real
                if -1e-9 <= p <= 1.0 + 1e-9:
                    best = min(best, ((whole + p) * h, v))
        return best


@dataclass(frozen=True)
class DiskMargins:
    """Disk margin of several channels that change at once.

    Args:
        names: of the channels.
        alpha: the symmetric disk's size [-].
        frequency: where it is smallest [rad/s].
        gain: all gains may be anything between 1 / gain and gain [-].
        phase: all phases within this at once [rad].
    """

    names: tuple[str, ...]
    alpha: float
    frequency: float
    gain: float
    phase: float


def disk_margins(sweep: LoopFrequencyResponse, names: tuple[str, ...]) -> DiskMargins:
    """Return the symmetric disk margin: the inverse of the largest mu of (S - T) / 2.

    P. Seiler, A. Packard and P. Gahinet, An Introduction to Disk Margins (2020). mu's upper bound
    is by diagonal scalings, so the margin is guaranteed.
    """
    m = _balanced(sweep, names)
    mu = mu_bounds(m)
    refined = np.zeros(len(mu), dtype=bool)
    while not refined[peak := int(np.argmax(mu))]:
        # the best scaling of one frequency is a good one at the neighbouring frequencies
        d = best_scaling(m[peak])
        mu[peak], refined[peak] = min(mu[peak], _scaled(m[peak], d)), True
        above = mu > mu[peak]
        mu[above] = np.minimum(mu[above], _scaled(m[above], d))
    alpha = 1.0 / mu[peak]
    gain = (1.0 + 0.5 * alpha) / (1.0 - 0.5 * alpha) if alpha < 2.0 else np.inf
    return DiskMargins(
        names, float(alpha), float(sweep.grid[peak]), float(gain),
        float(2.0 * np.arctan(0.5 * alpha)),
    )  # fmt: skip


def _balanced(sweep: LoopFrequencyResponse, names: tuple[str, ...]) -> Complex:
    """Return (S - T) / 2 over frequency, shape (count, k, k)."""
    # negative feedback of all channels at once, though u and y of one loop may stand among them
    # where u and y of one loop are both among them, cutting both leaves no loop: L of the pair
    eye = np.eye(len(names))
    return np.asarray(np.linalg.inv(eye + sweep.gain(names)) - 0.5 * eye, dtype=np.complex128)


def mu_bounds(m: Complex) -> Vector:
    """Return upper bounds of mu for complex numbers on the diagonal.

    The largest singular value of D M D^-1, with Osborne's D, which balances rows and columns; the
    best D is sought where this bound is largest.

    Args:
        m: matrices, shape (count, k, k).
    """
    size, d = abs(m), np.ones(m.shape[:2])
    off = size * (1.0 - np.eye(m.shape[1]))
    small = 1e-12 * size.max(axis=(1, 2))[:, None]
    for _ in range(_SCALING_STEPS):
        scaled = off * d[:, :, None] / d[:, None, :]
        rows, columns = np.linalg.norm(scaled, axis=2), np.linalg.norm(scaled, axis=1)
        d = d * np.sqrt((columns + small) / (rows + small))
    return np.minimum(_scaled(m, d), _scaled(m, np.ones_like(d)))


def _scaled(m: Complex, d: Matrix | Vector) -> Vector:
    """Return the largest singular values of D M D^-1, an upper bound of mu for any D.

    Args:
        m: matrices, shape (..., k, k).
        d: the diagonal of D, one for each or for all, shape (..., k) or (k,).
    """
    scaled = m * d[..., :, None] / d[..., None, :]
    return np.asarray(np.linalg.norm(scaled, 2, axis=(-2, -1)), dtype=np.float64)


def best_scaling(m: Complex) -> Vector:
    """Return the D of the least upper bound of mu, shape of m (k, k).

    The logarithm of the bound is convex in log D, but has edges where singular values are equal, as
    those of a loop that is cut in several places often are at its minimum. So norms of all singular
    values are minimised that come nearer and nearer to the largest one.
    """
    log_d = np.zeros(len(m))
    for power in _POWERS:

        def size(log_d: Vector, power: float = power) -> tuple[float, Vector]:
            d = np.exp(log_d)
            left, values, right = np.linalg.svd(m * d[:, None] / d)
            share = (values / values[0]) ** power
            value = np.log(values[0]) + np.log(share.sum()) / power
            slope = (abs(left) ** 2 - abs(right.T) ** 2) @ share / share.sum()
            return float(value), slope

        log_d = minimize(size, log_d, jac=True, method="BFGS").x
    return np.asarray(np.exp(log_d), dtype=np.float64)


def peaks(sweep: LoopFrequencyResponse, names: tuple[str, ...]) -> tuple[float, float]:
    """Return the largest singular values of S and of T over frequency."""
    s = np.linalg.inv(np.eye(len(names)) + sweep.gain(names))
    t = np.eye(len(names)) - s
    return (
        float(np.linalg.norm(s, 2, axis=(1, 2)).max()),
        float(np.linalg.norm(t, 2, axis=(1, 2)).max()),
    )
