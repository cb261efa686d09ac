"""Disturbance efforts on the joints: constant, sine and pulse."""

from math import cos, inf, pi
from typing import Annotated, Any, NamedTuple, TypeAlias

import numpy as np
from pydantic import Discriminator, Tag

from flexslew_plant.arrays import Vector
from flexslew_plant.known_joints import require_joints
from flexslew_plant.settings import Positive, section


@section
class SineShape:
    """a sin(2 pi f t + phase), t from the beginning of the entry."""

    amplitude: float  # [N m or N]
    frequency: Positive  # [Hz]
    phase: float = 0.0  # [rad]


@section
class PulseShape:
    """A constant for a while, once or again and again."""

    amplitude: float  # [N m or N]
    width: Positive  # [s]; each tick applies its mean, so that the impulse is right
    every: Positive | None = None  # from one beginning to the next [s]; null: once


@section
class Sine:
    """`{sine: {...}}`."""

    sine: SineShape  # from `at` on; each tick applies its mean


@section
class Pulse:
    """`{pulse: {...}}`."""

    pulse: PulseShape  # from `at` on


def _form(value: Any) -> str:
    """Return which of the shapes is meant."""
    if isinstance(value, dict):
        return "pulse" if "pulse" in value else "sine"
    return (
        "pulse" if isinstance(value, Pulse) else "sine" if isinstance(value, Sine) else "constant"
    )


Shape: TypeAlias = Annotated[
    Annotated[float, Tag("constant")]
    | Annotated[Sine, Tag("sine")]
    | Annotated[Pulse, Tag("pulse")],
    Discriminator(_form),
]
Disturbance: TypeAlias = dict[str, Shape]  # by joint


class TimedDisturbance(NamedTuple):
    """A disturbance and when it acts."""

    shapes: Disturbance
    start: int  # first tick
    end: float  # first tick after it


def check_disturbance(requested: Disturbance, joints: tuple[str, ...], place: str) -> None:
    """Check that the testbed has the joints.

    Raises:
        BadInput: an unknown joint, with the known ones.
    """
    require_joints(requested, joints, place)


def shape_effort(shape: Shape, ticks: int, period: float) -> float:
    """Return the mean effort over a tick [N m or N].

    Args:
        shape: of the effort.
        ticks: since its beginning.
        period: one tick [s].
    """
    if isinstance(shape, Sine):
        s = shape.sine
        phase_step = 2.0 * pi * s.frequency * period
        angle = phase_step * ticks + s.phase
        return s.amplitude * (cos(angle) - cos(angle + phase_step)) / phase_step
    if isinstance(shape, Pulse):
        p = shape.pulse
        width = _in_ticks(p.width, period)
        every = inf if p.every is None else _in_ticks(p.every, period)
        return p.amplitude * (_time_on(ticks + 1, width, every) - _time_on(ticks, width, every))
    return shape


def _in_ticks(time: float, period: float) -> float:
    """Return a time in ticks; whole ones without an error of rounding."""
    ticks = time / period
    whole = round(ticks)
    return whole if abs(ticks - whole) <= 1e-9 * ticks else ticks


def _time_on(time: float, width: float, every: float) -> float:
    """Return for how long a pulse has been on, all times in ticks."""
    pulse_count = 0.0 if every == inf else time // every
    since = time - pulse_count * every if pulse_count else time
    return pulse_count * min(width, every) + min(since, width)


def disturbance_effort(
    timed: TimedDisturbance, tick: int, joints: tuple[str, ...], period: float
) -> Vector:
    """Return the efforts of one entry over a tick, shape (joints,) [N m or N]."""
    since = tick - timed.start
    efforts = [
        shape_effort(timed.shapes[name], since, period) if name in timed.shapes else 0.0
        for name in joints
    ]
    return np.array(efforts, dtype=float)
