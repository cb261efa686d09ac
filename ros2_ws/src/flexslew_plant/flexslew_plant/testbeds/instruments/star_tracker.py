"""A star tracker: the attitude as a quaternion, at intervals, late, and not always."""

from dataclasses import dataclass
from functools import cached_property
from math import sqrt
from typing import Annotated, ClassVar, Literal

import numpy as np
from pydantic import Field

from flexslew_plant.arrays import Matrix, Vector, compiled_once
from flexslew_plant.settings import NonNegative, Positive, Probability, section
from flexslew_plant.testbeds.instruments.instrument import (
    RATE,
    BodyState,
    CompiledReader,
    noisy,
)
from flexslew_plant.testbeds.orientation.quaternions import multiply, quaternion_of

_GAP_START = 11  # where the spans without readings begin in the constants of its reader


@section
class StarTrackerSettings:
    """A star tracker on the platform."""

    kind: Literal["star_tracker"]
    # of a star tracker, in body axes, of any length
    boresight: tuple[float, float, float] = (0.0, 0.0, 1.0)
    across: NonNegative = 0.0  # standard deviation across its boresight [rad]
    about: NonNegative = 0.0  # and about it [rad]
    rate_noise: NonNegative = 0.0  # further noise of all its axes, per body rate [s]
    rate_limit: Positive | None = None  # body rate above which it reads nothing [rad/s]; null: none
    interval: NonNegative = 0.0  # between its readings [s]; 0: each tick
    delay: Annotated[float, Field(ge=0.0, le=1000.0)] = 0.0  # of its readings [s]
    dropout: Probability = 0.0  # probability that a reading is missing [-]
    # spans in which it exposes nothing, from and until [s]
    blind: tuple[tuple[NonNegative, NonNegative], ...] = ()


@dataclass(frozen=True)
class StarTracker:
    """q = q_true(t - delay) dq, dq a small turn about the boresight and across it.

    The variance about each axis is that of `across` or `about` plus (rate_noise |w|)^2, w the rate
    at the time of the exposure. Where there is no reading it gives zeros, which are no attitude.

    Args:
        name: of its section.
        first: its first channel.
        settings: its errors.
    """

    name: str
    first: int
    settings: StarTrackerSettings
    axes: ClassVar[tuple[str, ...]] = ("qx", "qy", "qz", "qw")

    def exact(self, body: BodyState) -> Vector:
        """Return the attitude, x y z w with w >= 0, shape (4,)."""
        return body.attitude if body.attitude[3] >= 0.0 else -body.attitude

    def delay_ticks(self, period: float) -> int:
        """Return by how many ticks its readings are late."""
        return round(self.settings.delay / period)

    @cached_property
    def _along(self) -> Vector:
        """Its boresight, a unit vector."""
        along: Vector = np.array(self.settings.boresight)
        return np.asarray(along / np.linalg.norm(along))

    @cached_property
    def covariance(self) -> Matrix:
        """Of its noise at rest, as a small turn in body axes, shape (3, 3) [rad^2]."""
        roll = np.outer(self._along, self._along)
        cross_axis = self.settings.across**2 * (np.eye(3) - roll)
        found: Matrix = cross_axis + self.settings.about**2 * roll
        return found

    def reader(self, period: float, rng: np.random.Generator | None) -> CompiledReader:
        """Return what reads it; see Instrument."""
        s, late = self.settings, self.delay_ticks(period)
        noise_sizes = [noisy(one, rng) for one in (s.across, s.about, s.rate_noise, s.dropout)]
        limit = np.inf if s.rate_limit is None else s.rate_limit
        ticks = [float(max(1, round(s.interval / period))), float(late), period]
        # from half a tick before the first one: no rounding of k times the period matters
        with np.errstate(over="ignore"):  # for ever
            gap_times = (np.round(np.ravel(s.blind) / period) - 0.5) * period
        constants = np.array([*self._along, *noise_sizes, limit, *ticks, *gap_times])
        return CompiledReader(read_star_tracker, constants, np.zeros(4 * (late + 1)), 1, 3)


@compiled_once("memory", "out")
def read_star_tracker(
    k: int, constants: Vector, body: Vector, samples: Vector, memory: Vector, out: Vector
) -> None:
    """Write the reading of a star tracker; its memory is the exposures still to be delivered.

    Random numbers are drawn whether there is a reading or not: a gap changes no later noise.
    """
    bx, by, bz, cross_axis, roll, rate_noise = constants[:6]
    dropout, limit, interval, delay, period = constants[6:_GAP_START]
    size = sqrt(body[RATE] ** 2 + body[RATE + 1] ** 2 + body[RATE + 2] ** 2)
    missing = k % int(interval) != 0 or size > limit or samples[0] < dropout
    for i in range(_GAP_START, constants.size, 2):
        missing = missing or constants[i] <= k * period < constants[i + 1]
    every = int(delay) + 1
    at, of = 4 * (k % every), 4 * ((k + 1) % every)
    if missing:
        for i in range(4):
            memory[at + i] = 0.0
    else:
        more = (rate_noise * size) ** 2
        cross_axis, roll = sqrt(cross_axis**2 + more), sqrt(roll**2 + more)
        x, y, z = samples[1], samples[2], samples[3]
        along = (roll - cross_axis) * (bx * x + by * y + bz * z)
        x, y, z = (
            cross_axis * x + along * bx,
            cross_axis * y + along * by,
            cross_axis * z + along * bz,
        )
        now = (body[0], body[1], body[2], body[3])
        a, b, c, w = multiply(now, quaternion_of(x, y, z))
        sign = 1.0 if w >= 0.0 else -1.0
        memory[at], memory[at + 1], memory[at + 2] = sign * a, sign * b, sign * c
        memory[at + 3] = sign * w
    for i in range(4):
        out[i] = memory[of + i]
