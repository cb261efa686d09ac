"""The division of an excitation into experiments of whole periods, and its signal."""

from dataclasses import dataclass

import numpy as np

from flexslew_control.planners.excitation.section import Excitation
from flexslew_control.planners.excitation.signals import (
    chirp,
    impulse,
    lines_of,
    multisine,
    orthogonal,
    random_binary,
)
from flexslew_plant.arrays import Matrix, Vector
from flexslew_plant.errors import BadInput


@dataclass(frozen=True)
class Experiments:
    """How the ticks of a shaking are divided: taper, experiments of whole periods, taper.

    Args:
        period: ticks of one period.
        repeated: periods of an experiment.
        count: experiments, one per joint that is shaken.
        taper: ticks of the rise, and of the fall.
        after: ticks at rest after the fall, to a whole duration.
    """

    period: int
    repeated: int
    count: int
    taper: int
    after: int


def divide(settings: Excitation, joints: int, band: tuple[float, float], h: float) -> Experiments:
    """Return how the ticks of an excitation are divided.

    Raises:
        BadInput: they do not hold two periods for every joint.
    """
    ticks, taper = round(settings.duration / h), round(settings.taper / h)
    share = (ticks - 2 * taper) // joints
    if settings.resolution is None:
        period = share // 4
    else:
        period = round(2.0 * np.pi / settings.resolution / h)
    repeated = share // period if period > 0 else 0
    if repeated < 2 or not lines_of(band, period, h).size:
        lowest = 2.0 * np.pi / band[0]
        needed = 2.0 * joints * max(period * h, lowest) + 2.0 * settings.taper
        raise BadInput(
            f"plan: duration: {settings.duration:g} is not allowed: {joints} experiments of two "
            f"periods with lines in the band need {needed:.4g} s, or a coarser resolution"
        )
    return Experiments(
        period, repeated, joints, taper, ticks - 2 * taper - joints * repeated * period
    )


def signal(settings: Excitation, parts: Experiments, band: tuple[float, float], h: float) -> Matrix:
    """Return what shakes each joint, with a peak of 1, over all experiments and both tapers."""
    rng = np.random.default_rng(settings.seed)
    one = _one_period(settings, parts, band, h, rng)
    factors = orthogonal(parts.count)
    columns = []
    for joint in range(parts.count):
        periods = []
        for factor in factors[:, joint]:
            shifted = np.fft.irfft(np.fft.rfft(one) * factor, parts.period)
            periods.append(
                np.tile(shifted if abs(factor.imag) > 1e-9 else one * factor.real, parts.repeated)
            )
        whole = np.concatenate(periods)
        rise = 0.5 - 0.5 * np.cos(np.pi * (np.arange(parts.taper) + 0.5) / max(parts.taper, 1))
        before = np.resize(periods[0][::-1], parts.taper)[::-1] * rise
        after = np.resize(periods[-1], parts.taper) * rise[::-1]
        columns.append(np.concatenate((before, whole, after)))
    signal = np.column_stack(columns)
    return np.asarray(signal / np.abs(signal).max(axis=0))


def _one_period(
    settings: Excitation,
    parts: Experiments,
    band: tuple[float, float],
    h: float,
    rng: np.random.Generator,
) -> Vector:
    if settings.signal == "multisine":
        lines = lines_of(band, parts.period, h)
        size = (lines / lines[0]) ** settings.slope
        return multisine(lines, size, parts.period, settings.phases, rng)
    if settings.signal == "chirp":
        return chirp(band, parts.period, h)
    if settings.signal == "random_binary":
        return random_binary(band, parts.period, h, rng)
    return impulse(band, parts.period, h)
