"""A star tracker: the attitude as a quaternion, at intervals, late, and not always."""

from collections import deque
from dataclasses import dataclass
from functools import cached_property
from typing import ClassVar, Literal

import numpy as np

from flexslew_plant.arrays import Matrix, Vector
from flexslew_plant.settings import NonNegative, Positive, Probability, section
from flexslew_plant.testbeds.attitude import product, quaternion
from flexslew_plant.testbeds.instruments.instrument import MovingBody, Reader

_NO_FIX = np.zeros(4)


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
    delay: NonNegative = 0.0  # of its readings [s]
    dropout: Probability = 0.0  # probability that a reading is missing
    # spans without readings, from and until [s]
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

    def exact(self, body: MovingBody) -> Vector:
        """Return the attitude, x y z w with w >= 0, shape (4,)."""
        return body.attitude if body.attitude[3] >= 0.0 else -body.attitude

    def delay_ticks(self, period: float) -> int:
        """Return by how many ticks its readings are late."""
        return round(self.settings.delay / period)

    @cached_property
    def covariance(self) -> Matrix:
        """Of its noise at rest, as a small turn in body axes, shape (3, 3) [rad^2]."""
        along = np.array(self.settings.boresight) / np.linalg.norm(self.settings.boresight)
        about = np.outer(along, along)
        across = self.settings.across**2 * (np.eye(3) - about)
        found: Matrix = across + self.settings.about**2 * about
        return found

    def covariance_at(self, rate: float) -> Matrix:
        """Return the covariance of its noise at a rate [rad/s], shape (3, 3) [rad^2]."""
        found: Matrix = self.covariance + (self.settings.rate_noise * rate) ** 2 * np.eye(3)
        return found

    def begin(self, period: float, rng: np.random.Generator | None) -> Reader:
        """Return what reads it; see Instrument."""
        s, tick = self.settings, -1
        every = max(1, round(s.interval / period))
        late = self.delay_ticks(period)
        exposed: deque[Vector] = deque([_NO_FIX] * late)

        def exposure(body: MovingBody) -> Vector:
            """Return what it will read of this tick."""
            rate, time = float(np.linalg.norm(body.rate)), tick * period
            # drawn whether there is a reading or not: a gap changes no later noise
            chance, noise = (rng.random(), rng.standard_normal(3)) if rng else (1.0, np.zeros(3))
            fast = s.rate_limit is not None and rate > s.rate_limit
            blind = any(start <= time < end for start, end in s.blind)
            if tick % every or fast or blind or chance < s.dropout:
                return _NO_FIX
            q = self.exact(body)
            if rng is not None:
                turn = _root(self.covariance_at(rate)) @ noise
                q = product(q, quaternion(turn))
            return q if q[3] >= 0.0 else -q

        def read(body: MovingBody) -> Vector:
            nonlocal tick
            tick += 1
            exposed.append(exposure(body))
            return exposed.popleft()

        return read


def _root(covariance: Matrix) -> Matrix:
    """Return a symmetric square root."""
    squares, axes = np.linalg.eigh(covariance)
    root: Matrix = axes * np.sqrt(np.maximum(squares, 0.0)) @ axes.T
    return root
