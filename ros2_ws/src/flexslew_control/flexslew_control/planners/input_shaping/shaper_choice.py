"""Which shaper suits modes whose frequencies and damping are known within intervals."""

from collections.abc import Sequence
from typing import NamedTuple

from flexslew_control.planners.input_shaping.shaped_modes import ShapedMode
from flexslew_control.planners.input_shaping.shapers import (
    Shaper,
    ShaperName,
    convolve,
    make_shaper,
)

_CANDIDATES: tuple[ShaperName, ...] = (
    *("zv", "mzv", "zvd", "ei", "zvdd", "ei_two_hump", "ei_three_hump"),
)
_ROUNDING = 1e-9  # of a residual
_NEGATIVE: tuple[ShaperName, ...] = ("um_zv",)


class RankedShaper(NamedTuple):
    """A shaper and what it costs."""

    name: ShaperName
    shaper: Shaper
    delay: float  # that it adds to a command [s]
    smoothing: float  # standard deviation of its impulse times [s]
    residual: float  # largest residual vibration over all intervals, relative to no shaper [-]


def ranking(
    modes: Sequence[ShapedMode], tolerance: float, negative: bool = False
) -> list[RankedShaper]:
    """Return all shapers, the best first.

    Those that leave at most the tolerance over all intervals come first, the shortest delay before
    the others, then the rest by their residual.

    Args:
        modes: to shape, with their intervals.
        tolerance: largest residual vibration that is allowed [-].
        negative: whether negative impulses are allowed.
    """
    names = (*_CANDIDATES, *(_NEGATIVE if negative else ()))
    found = [_candidate(name, modes, tolerance, negative) for name in names]
    return sorted(found, key=lambda one: _order(one, tolerance))


def _order(one: RankedShaper, tolerance: float) -> tuple[bool, float, float]:
    """Return the key by which candidates are sorted."""
    above = _above(one, tolerance)
    return above, one.residual if above else 0.0, one.delay


def _above(one: RankedShaper, tolerance: float) -> bool:
    return one.residual > (1.0 + _ROUNDING) * tolerance


def reason(candidates: Sequence[RankedShaper], tolerance: float) -> str:
    """Return in one sentence why the first candidate is chosen."""
    best = candidates[0]
    left = f"at most {100.0 * best.residual:.2g} % of the vibration over the intervals"
    if _above(best, tolerance):
        return (
            f"{best.name} leaves the least, {left}; no shaper stays below {100.0 * tolerance:g} %: "
            "identify the modes more exactly, or allow a larger tolerance"
        )
    return (
        f"{best.name} has the shortest delay, {best.delay:.3g} s, of those that leave at most "
        f"{100.0 * tolerance:g} %: {left}"
    )


def worst_residual(shaper: Shaper, modes: Sequence[ShapedMode]) -> float:
    """Return the largest residual vibration of all modes over their intervals [-]."""
    residuals = [
        float(shaper.residual(frequencies, float(damping)).max())
        for frequencies, dampings in (mode.grid() for mode in modes)
        for damping in dampings
    ]
    return max(residuals, default=0.0)


def shaper_of(
    name: ShaperName, modes: Sequence[ShapedMode], tolerance: float, negative: bool
) -> Shaper:
    """Return one shaper for all modes.

    Raises:
        BadInput: it needs negative impulses that are not allowed.
    """
    return convolve(
        [make_shaper(name, mode.frequency, mode.damping, tolerance, negative) for mode in modes]
    )


def _candidate(
    name: ShaperName, modes: Sequence[ShapedMode], tolerance: float, negative: bool
) -> RankedShaper:
    shaper = shaper_of(name, modes, tolerance, negative)
    residual = worst_residual(shaper, modes)
    return RankedShaper(name, shaper, shaper.duration, shaper.smoothing, residual)
