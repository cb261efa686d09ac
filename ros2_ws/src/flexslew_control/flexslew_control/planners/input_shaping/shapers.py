"""Input shapers: impulses that, convolved with a command, leave a mode of known frequency at rest.

The residual vibration of the impulses A_i at t_i, relative to one unit impulse at their end, is
    V = exp(-zeta w t_N) sqrt(C^2 + S^2),
    C, S = sum A_i exp(zeta w t_i) (cos, sin)(w_d t_i),   w_d = w sqrt(1 - zeta^2).
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal, TypeAlias

import numpy as np
from scipy.optimize import brentq, minimize_scalar

from flexslew_plant.arrays import Matrix, Vector
from flexslew_plant.errors import BadInput

ShaperName: TypeAlias = Literal[
    "none", "zv", "zvd", "zvdd", "mzv", "ei", "ei_two_hump", "ei_three_hump", "um_zv"
]


@dataclass(frozen=True)
class Shaper:
    """Impulses, their amplitudes summing to one so that a shaped command reaches its end."""

    times: Vector  # rising from zero [s]
    amplitudes: Vector  # [-]

    @property
    def duration(self) -> float:
        """How much longer a shaped command takes [s]."""
        return float(self.times[-1])

    @property
    def smoothing(self) -> float:
        """Standard deviation of the impulse times: by how much a step is spread [s].

        Of shapers with negative impulses, |A| weighs the times.
        """
        weights = np.abs(self.amplitudes) / np.abs(self.amplitudes).sum()
        mean = weights @ self.times
        return float(np.sqrt(weights @ (self.times - mean) ** 2))

    def convolve(self, other: "Shaper") -> "Shaper":
        """Return the shaper for the modes of both."""
        times = np.add.outer(self.times, other.times).ravel()
        amplitudes = np.multiply.outer(self.amplitudes, other.amplitudes).ravel()
        order = np.argsort(times, kind="stable")
        return Shaper(times[order], amplitudes[order])

    def residual(self, frequency: float | Vector, damping: float = 0.0) -> Vector:
        """Return V at one or more frequencies [rad/s]; zero where the mode is left at rest."""
        w = np.atleast_1d(np.asarray(frequency, dtype=np.float64))[:, None]
        pole = w * (damping + 1j * np.sqrt(1.0 - damping**2))
        vibration = (self.amplitudes * np.exp(pole * (self.times - self.duration))).sum(axis=1)
        return np.asarray(np.abs(vibration))

    def sensitivity(
        self, frequency: float, damping: float = 0.0, span: float = 0.3, points: int = 121
    ) -> Matrix:
        """Return [error, V] for relative frequency errors -span..span, shape (points, 2)."""
        errors = np.linspace(-span, span, points)
        return np.column_stack((errors, self.residual(frequency * (1.0 + errors), damping)))

    def shape(self, function: Callable[[Vector], Vector], times: Vector) -> Vector:
        """Return the values of a shaped function of time, sum A_i f(t - t_i)."""
        parts = zip(self.amplitudes.tolist(), self.times.tolist(), strict=True)
        return np.asarray(np.sum([amplitude * function(times - at) for amplitude, at in parts], 0))


UNSHAPED = Shaper(np.zeros(1), np.ones(1))


def make_shaper(
    name: ShaperName,
    frequency: float,
    damping: float = 0.0,
    tolerance: float = 0.05,
    negative: bool = False,
) -> Shaper:
    """Return the shaper of one mode.

    With K = exp(-zeta pi / sqrt(1 - zeta^2)) (Sung and Joo, eq. 50) at multiples of half the damped
    period: ZV is (1, K) / (1 + K), ZVD and ZVDD are ZV convolved with itself once and twice
    (Singer and Seering 1990). MZV has three impulses at multiples of 3/8 of the damped period
    (Klipper's shaper of this name). EI has one, two or three humps in its sensitivity curve
    (Singhose, Seering and Singer 1994, 1996).

    Undamped amplitudes A_i decay like the mode, A_i K^i: their sensitivity curve at one decay rate
    is the undamped one. The highest hump of EI is `tolerance` for any damping, or less where the
    highest possible one leaves less.

    Args:
        name: name of the shaper.
        frequency: undamped frequency of the mode [rad/s].
        damping: damping ratio of the mode [-].
        tolerance: V that an EI shaper admits at the nominal frequency [-].
        negative: whether negative impulses are requested; um_zv needs them.

    Raises:
        BadInput: if frequency, damping or tolerance is out of range, or a shaper needs negative
            impulses that are not requested.
    """
    if not (np.isfinite(frequency) and frequency > 0.0):
        raise BadInput("above 0 rad/s", "shaper", "frequency", frequency)
    if not 0.0 <= damping < 1.0:
        raise BadInput("at least 0, below 1", "shaper", "damping", damping)
    if not 0.0 < tolerance < 0.5:
        raise BadInput("above 0, below 0.5", "shaper", "tolerance", tolerance)
    if name == "none":
        return UNSHAPED
    root = np.sqrt(1.0 - damping**2)
    half, k = np.pi / (frequency * root), np.exp(-damping * np.pi / root)
    if name == "um_zv":
        if not negative:
            raise BadInput("shaper: um_zv has a negative impulse; set negative: true to accept it")
        return _unity_magnitude(frequency, damping)
    zv = Shaper(half * np.arange(2.0), np.array([1.0, k]) / (1.0 + k))
    if name in ("zv", "zvd", "zvdd"):
        out = zv
        for _ in range({"zv": 0, "zvd": 1, "zvdd": 2}[name]):
            out = out.convolve(zv)
        return _merged(out)
    if name == "mzv":
        return _decayed(
            np.array([1.0 - _ROOT_HALF, 2.0 * _ROOT_HALF - 1.0, 1.0 - _ROOT_HALF]),
            0.75 * half,
            k**0.75,
        )
    humps = _HUMPS[name]
    return _with_damping(humps(_hump_height(humps, tolerance, damping)), frequency, damping)


def _one_hump(v: float) -> Vector:
    return np.array([(1.0 + v) / 4.0, (1.0 - v) / 2.0, (1.0 + v) / 4.0])


def _two_humps(v: float) -> Vector:
    x = np.cbrt(v**2 * (np.sqrt(1.0 - v**2) + 1.0))
    first = (3.0 * x**2 + 2.0 * x + 3.0 * v**2) / (16.0 * x)
    return np.array([first, 0.5 - first, 0.5 - first, first])


def _three_humps(v: float) -> Vector:
    first, second = (1.0 + 3.0 * v + 2.0 * np.sqrt(2.0 * (v**2 + v))) / 16.0, (1.0 - v) / 4.0
    return np.array([first, second, 1.0 - 2.0 * (first + second), second, first])


# amplitudes without damping, by the height of the humps
_HUMPS: dict[str, Callable[[float], Vector]] = {
    "ei": _one_hump,
    "ei_two_hump": _two_humps,
    "ei_three_hump": _three_humps,
}
_ROOT_HALF = np.sqrt(0.5)
_HIGHEST = 0.5  # hump
_DAMPING_STEP = 0.02
_HUMP_POINTS = 201  # of the curve, between which its maximum is refined


def _hump_height(humps: Callable[[float], Vector], tolerance: float, damping: float) -> float:
    """Return the height without damping with which the highest hump with damping is `tolerance`.

    The humps lie between the outermost zeros of the undamped curve, sum A_i z^i = 0 on the unit
    circle. Damping lowers them.
    """

    def excess(height: float) -> float:
        amplitudes = humps(height)
        angles = np.angle(np.roots(amplitudes))
        first = float(angles[angles > 0.0].min()) / np.pi
        shaper = _with_damping(amplitudes, 1.0, damping)
        ratios = np.linspace(first, 2.0 - first, _HUMP_POINTS)
        at = float(ratios[shaper.residual(ratios, damping).argmax()])
        near, width = (first, 2.0 - first), 2.0 * float(ratios[1] - ratios[0])
        around = max(at - width, near[0]), min(at + width, near[1])
        peak = minimize_scalar(
            lambda w: -float(shaper.residual(w, damping)[0]),
            bounds=around,
            method="bounded",
            options={"xatol": 1e-10},
        )
        return -float(peak.fun) - tolerance

    if damping == 0.0:
        return tolerance
    if excess(_HIGHEST) <= 0.0:
        return _HIGHEST
    return float(brentq(excess, tolerance, _HIGHEST, xtol=1e-14))


def _with_damping(amplitudes: Vector, frequency: float, damping: float) -> Shaper:
    """Return undamped amplitudes at half damped periods, decayed like the mode."""
    root = np.sqrt(1.0 - damping**2)
    return _decayed(amplitudes, np.pi / (frequency * root), np.exp(-damping * np.pi / root))


def _decayed(amplitudes: Vector, interval: float, ratio: float) -> Shaper:
    """Return impulses at equal intervals that decay by a ratio from one to the next."""
    weights = amplitudes * ratio ** np.arange(amplitudes.size)
    return Shaper(interval * np.arange(float(amplitudes.size)), weights / weights.sum())


def convolve(shapers: list[Shaper]) -> Shaper:
    """Return one shaper for all modes."""
    out = UNSHAPED
    for shaper in shapers:
        out = out.convolve(shaper)
    return out


def _merged(shaper: Shaper) -> Shaper:
    """Add up impulses at the same time."""
    is_new = np.append(True, np.diff(shaper.times) > 1e-12 * max(shaper.duration, 1.0))
    groups = np.cumsum(is_new) - 1
    return Shaper(shaper.times[is_new], np.bincount(groups, shaper.amplitudes).astype(np.float64))


def _unity_magnitude(frequency: float, damping: float) -> Shaper:
    """Return the zero-vibration shaper with impulses 1, -1, 1, by Newton's method on V = 0.

    It starts from the closed form without damping, and raises the damping step by step.
    """
    signs = np.array([1.0, -1.0, 1.0])
    t = np.array([np.pi / 3.0, 2.0 * np.pi / 3.0])  # exact without damping
    for ratio in np.linspace(0.0, damping, 1 + int(np.ceil(damping / _DAMPING_STEP)))[1:]:
        pole = ratio + 1j * np.sqrt(1.0 - ratio**2)
        for _ in range(30):
            terms = signs * np.exp(pole * np.append(0.0, t))
            vibration, slopes = terms.sum(), (pole * terms)[1:]
            change = np.linalg.solve(
                np.vstack((slopes.real, slopes.imag)), [-vibration.real, -vibration.imag]
            )
            t = t + change
            if np.abs(change).max() < 1e-15:
                break
    return Shaper(np.append(0.0, t) / frequency, signs)
