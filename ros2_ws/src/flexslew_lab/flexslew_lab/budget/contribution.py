"""What an error source adds to each metric, and the rules by which sources are summed.

At every point of a metric (a tick, a window, a pair of windows) the error of a source is
    d + c b + n,
d the same in every member of the ensemble, b drawn once per member and n a noise in time, both of
mean zero. The errors d have one time base and are added point by point, so their correlation is
exact and never above the linear sum of ECSS-E-ST-60-10C; b and n of different sources are
independent and their variances are added.

The value v of a metric at the level p is the smallest with
    mixed      mean over time of P(|d + c b + n| <= v) = p
    temporal   the same of |d| + n_p sd(c b) + n, in a member whose b are at their level p
    ensemble   P = p at every time, with its normal bound |d| + n_p sqrt(var(c b) + var n),
b and n normal and n_p the half width of a normal distribution that contains p. Mixed is the share p
of all points of all members; temporal the share p of the time in one of the worst members; ensemble
the share p of the members, at the worst time of all. A vibration or a drift d has its own
distribution over time, which no normal one replaces; of b and n alone mixed is n_p sigma.
"""

from collections.abc import Iterable, Mapping
from typing import NamedTuple

import numpy as np
from scipy.special import erf, erfinv, ndtr

from flexslew_lab.budget.parts import Interpretation
from flexslew_plant.arrays import Matrix, Vector
from flexslew_plant.errors import BadInput

_POINTS = 5000  # of a metric, of which a quantile is taken at most
_WIDEST = 10.0  # standard deviations that contain every level
_HALVINGS = 40  # of the interval of a quantile


class ErrorParts(NamedTuple):
    """A metric of a source at its points, each of shape (points, axes)."""

    fixed: Matrix  # d [rad or m]
    drawn: Matrix  # variance of b at the point [rad^2 or m^2]
    noise: Matrix  # variance of n [rad^2 or m^2]


class Contribution(NamedTuple):
    """A source's part in every metric."""

    name: str
    kind: str  # of error: noise, bias, ...
    about: str  # how it was found
    parts: Mapping[str, ErrorParts]  # by metric


class ErrorBound(NamedTuple):
    """A metric at a level of confidence, each of shape (axes,) [rad or m]."""

    mean: Vector  # mu
    deviation: Vector  # sigma
    value: Vector  # that is kept with the level of confidence


def fixed_parts(values: Mapping[str, Matrix]) -> dict[str, ErrorParts]:
    """Return the parts of an error that is the same in every member."""
    return {name: ErrorParts(d, 0.0 * d, 0.0 * d) for name, d in values.items()}


def drawn_parts(values: Mapping[str, Matrix]) -> dict[str, ErrorParts]:
    """Return the parts of errors of one standard deviation of what each member draws."""
    return {name: ErrorParts(0.0 * b, b**2, 0.0 * b) for name, b in values.items()}


def noise_parts(variances: Mapping[str, Matrix]) -> dict[str, ErrorParts]:
    """Return the parts of a noise in time."""
    return {name: ErrorParts(0.0 * v, 0.0 * v, v) for name, v in variances.items()}


def sum_parts(parts: Iterable[ErrorParts]) -> ErrorParts:
    """Return the parts of all sources together."""
    return ErrorParts(*(np.sum(values, axis=0) for values in zip(*parts, strict=True)))


def half_width(level: float) -> float:
    """Return n_p: +-n_p standard deviations contain the level of a normal distribution.

    Raises:
        BadInput: the level is not between 0 and 1.
    """
    if not 0.0 < level < 1.0:
        raise BadInput("a probability between 0 and 1", key="--level", value=level)
    return float(np.sqrt(2.0) * erfinv(level))


def bound_of(parts: ErrorParts, interpretation: Interpretation, width: float) -> ErrorBound:
    """Return a metric at a level of confidence.

    Args:
        parts: of one source, or of all.
        interpretation: see above.
        width: n_p [-].
    """
    d, b, n = parts
    if interpretation == "ensemble":
        deviation = np.sqrt(b + n)
        value = abs(d) + width * deviation
        worst, axes = value.argmax(axis=0), np.arange(d.shape[1])
        return ErrorBound(d[worst, axes], deviation[worst, axes], value[worst, axes])
    level = float(erf(width / np.sqrt(2.0)))
    mean, in_time = d.mean(axis=0), d.var(axis=0) + n.mean(axis=0)
    if interpretation == "temporal":
        shifted = abs(d) + width * np.sqrt(b)
        return ErrorBound(shifted.mean(axis=0), np.sqrt(in_time), _quantile(shifted, n, level))
    return ErrorBound(mean, np.sqrt(in_time + b.mean(axis=0)), _quantile(d, b + n, level))


def _quantile(mean: Matrix, variance: Matrix, level: float) -> Vector:
    """Return v with the mean over points of P(|x| <= v) = level, x normal at every point.

    Args:
        mean: of x, shape (points, axes).
        variance: of x, likewise.
        level: between 0 and 1.
    """
    some = np.unique(np.linspace(0, len(mean) - 1, min(len(mean), _POINTS)).astype(int))
    middle, deviation = mean[some], np.sqrt(variance[some])
    scale = np.where(deviation > 0.0, deviation, 1.0)
    low, high = np.zeros(mean.shape[1]), (abs(middle) + _WIDEST * deviation).max(axis=0)
    for _ in range(_HALVINGS):
        value = 0.5 * (low + high)
        normal = ndtr((value - middle) / scale) - ndtr((-value - middle) / scale)
        inside = np.where(deviation > 0.0, normal, abs(middle) <= value).mean(axis=0)
        low, high = np.where(inside < level, value, low), np.where(inside < level, high, value)
    return np.asarray(high)
