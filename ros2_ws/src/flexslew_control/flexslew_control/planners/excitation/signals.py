"""Signals that shake a bench: multisines, a chirp, a random binary sequence, an impulse.

All have a peak of 1 and a whole number of ticks, and are as long as one period.
"""

from typing import Literal, TypeAlias

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import dft

from flexslew_plant.arrays import Vector

Phases: TypeAlias = Literal["schroeder", "optimised", "random"]

_CLIP_ITERATIONS = 200  # of the search for a low crest factor
_CLIP = 0.85  # where the signal is cut in each, as a part of its peak


def lines_of(band: tuple[float, float], ticks: int, h: float) -> Vector:
    """Return the harmonics of a period that lie in a band, as whole numbers.

    Args:
        band: lowest and highest frequency [rad/s].
        ticks: of a period.
        h: one tick [s].
    """
    spacing = 2.0 * np.pi / (ticks * h)
    first, last = np.ceil(band[0] / spacing - 1e-9), np.floor(band[1] / spacing + 1e-9)
    return np.asarray(np.arange(max(first, 1.0), last + 1.0))


def multisine(
    lines: Vector, size: Vector, ticks: int, phases: Phases, rng: np.random.Generator
) -> Vector:
    """Return one period of a sum of sines with a peak of 1, (ticks,).

    Schroeder's phases -2 pi sum_(l < k) (k - l) p_l, with p the parts of the power (Schroeder
    1970), give a low crest factor; `optimised` goes on from there by clipping the signal and
    keeping the phases of what comes out (Van der Ouderaa, Schoukens and Renneboog 1988).

    Args:
        lines: harmonics, (n,).
        size: amplitude of each, (n,).
        ticks: of the period.
        phases: how they are chosen.
        rng: of random phases.
    """
    if phases == "random":
        angle = rng.uniform(0.0, 2.0 * np.pi, len(lines))
    else:
        power = size**2 / np.sum(size**2)
        angle = -2.0 * np.pi * (np.cumsum(np.cumsum(power)) - np.cumsum(power))
    spectrum = np.zeros(ticks // 2 + 1, dtype=np.complex128)
    place = lines.astype(int)
    spectrum[place] = size * np.exp(1j * angle)
    best = np.fft.irfft(spectrum, ticks)
    if phases == "optimised":
        now = best
        for _ in range(_CLIP_ITERATIONS):
            peak = np.abs(now).max()
            clipped = np.fft.rfft(np.clip(now, -_CLIP * peak, _CLIP * peak))[place]
            spectrum[place] = size * np.exp(1j * np.angle(clipped))
            now = np.fft.irfft(spectrum, ticks)
            if np.abs(now).max() < np.abs(best).max():
                best = now
    return np.asarray(best / np.abs(best).max())


def chirp(band: tuple[float, float], ticks: int, h: float) -> Vector:
    """Return a sine with a frequency that rises from one end of the band to the other, (ticks,)."""
    t = h * np.arange(ticks)
    rise = (band[1] - band[0]) / (ticks * h)
    return np.sin(band[0] * t + 0.5 * rise * t**2)


def random_binary(
    band: tuple[float, float], ticks: int, h: float, rng: np.random.Generator
) -> Vector:
    """Return a sequence of +1 and -1 that may change sign every pi/(2 highest frequency), (ticks,).

    Its mean is taken out by its last values, so that a free joint does not drift away.
    """
    length = max(round(0.5 * np.pi / band[1] / h), 1)
    count = -(-ticks // length)
    signs = np.ones(count)
    signs[: count // 2] = -1.0
    return np.asarray(np.repeat(rng.permutation(signs), length)[:ticks])


def impulse(band: tuple[float, float], ticks: int, h: float) -> Vector:
    """Return a push and a pull, each a quarter of the shortest period of the band, (ticks,).

    What is left is the free motion; push and pull leave a free joint at rest.
    """
    width = max(round(0.5 * np.pi / band[1] / h), 1)
    signal = np.zeros(ticks)
    signal[:width], signal[width : 2 * width] = 1.0, -1.0
    return signal


def orthogonal(joints: int) -> NDArray[np.complex128]:
    """Return the phase factor of each joint in each experiment, (experiments, joints).

    The columns of the discrete Fourier transform are orthogonal: as many experiments as joints
    separate the joints at every line (Dobrowiecki, Schoukens and Guillaume 2006). For two joints
    the factors are +1 and -1.
    """
    return np.asarray(dft(joints), dtype=np.complex128)
