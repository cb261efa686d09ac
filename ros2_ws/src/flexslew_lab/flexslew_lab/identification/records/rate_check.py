"""Warnings where the position and the rate of a joint disagree by a factor: units or times."""

from collections.abc import Mapping

import numpy as np

from flexslew_plant.arrays import Vector

_AGREE = 1.25  # factor up to which they agree
_FOLLOWS = 0.9  # correlation from which the two are the same motion in other units
_REMEDIES = {
    1e-3: "are the times in ms? --time-unit ms",
    1e-6: "are the times in us? --time-unit us",
    1e-9: "are the times in ns? --time-unit ns",
    180.0 / np.pi: "is the position in degrees? angles are in rad",
    np.pi / 180.0: "is the rate in degrees per second? rates are in rad/s",
    -1.0: "does the rate have the other sign?",
}
_OTHER = "check the units of both, and --time-unit"

Series = tuple[Vector, Vector]  # times [s] and values


def rate_notes(series: Mapping[str, Series]) -> list[str]:
    """Return a warning for each joint whose position is not the integral of its rate.

    Args:
        series: by the names of outputs; `position.JOINT` and `rate.JOINT` are compared.
    """
    notes = []
    for name, position in series.items():
        kind, _, joint = name.partition(".")
        rate = series.get(f"rate.{joint}")
        if kind != "position" or rate is None:
            continue
        factor = _factor(position, rate)
        if factor is None or 1.0 / _AGREE < factor < _AGREE:
            continue
        remedy = next(
            (words for one, words in _REMEDIES.items() if 1.0 / _AGREE < factor / one < _AGREE),
            _OTHER,
        )
        notes.append(f"{name} is {factor:.3g} times the integral of rate.{joint}: {remedy}")
    return notes


def _factor(position: Series, rate: Series) -> float | None:
    """Return the factor of a position in the integral of a rate; None: they do not correlate."""
    t, v = rate
    integral = np.concatenate(([0.0], np.cumsum(0.5 * (v[1:] + v[:-1]) * np.diff(t))))
    inside = (t >= position[0][0]) & (t <= position[0][-1])
    if inside.sum() < 3:
        return None
    t, integral = t[inside], integral[inside]
    line = np.column_stack((np.ones_like(t), (t - t[0]) / (t[-1] - t[0])))
    pair = np.column_stack((np.interp(t, *position), integral))
    pair = pair - line @ np.linalg.lstsq(line, pair, rcond=None)[0]
    size = np.linalg.norm(pair, axis=0)
    if not np.isfinite(size).all() or not size.all():
        return None
    correlation = float(pair[:, 0] @ pair[:, 1] / size.prod())
    if abs(correlation) < _FOLLOWS:
        return None
    return float(size[0] / size[1]) * float(np.sign(correlation))
