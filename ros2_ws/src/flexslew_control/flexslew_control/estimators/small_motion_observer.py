"""The small motions of a platform and its appendages, from the collocated readings."""

from dataclasses import dataclass, field
from functools import cached_property
from typing import NamedTuple

import numpy as np
from scipy.linalg import LinAlgError

from flexslew_control.estimators.kalman import discrete_model
from flexslew_control.law import Estimate
from flexslew_control.linear.design_checks import require_observable
from flexslew_control.linear.riccati import discrete_riccati
from flexslew_control.linear.small_motion import SmallMotion
from flexslew_plant.arrays import Matrix, Tensor, Vector, compiled_once
from flexslew_plant.errors import BadInput
from flexslew_plant.measurement import Measurement
from flexslew_plant.settings import Positive, section
from flexslew_plant.testbeds.compiled import interface
from flexslew_plant.testbeds.kernels import Kernels

_MAX_CONDITION = 1e6  # of readings that are inverted
_QUIET: Vector = np.zeros(0)
_NO_COVARIANCE: Matrix = np.zeros((0, 0))


@section
class ObserverSettings:
    """Noises that weigh prediction against readings; used where readings are too few to invert."""

    position_sigma: Positive = 1e-4  # standard deviation of a reading [m or rad]
    rate_sigma: Positive = 1e-3  # standard deviation of its rate [m/s or rad/s]
    process_noise: Positive = 1e-6  # density of the white noise on every acceleration, in SI


@dataclass
class InverseObserver:
    """As many readings as coordinates: x = C^-1 y, and the same for the rates.

    Args:
        inverse: of the readings, on all coordinates, shape (n, m).
    """

    inverse: Matrix

    def reset(self, measurement: Measurement) -> None:
        """Nothing to start."""

    def update(self, measurement: Measurement) -> Estimate:
        """Return the coordinates and their rates."""
        return Estimate(
            self.inverse @ measurement.joint_position,
            self.inverse @ measurement.joint_velocity,
            _QUIET,
            _NO_COVARIANCE,
            _QUIET,
        )


class MotionConstants(NamedTuple):
    """The constants of SmallMotionObservers, for n coordinates and m joints, a row for each."""

    packed: Matrix  # numbers of the equations, (observers, size)
    gain: Tensor  # L over L', from innovations to (x, x'), (observers, 2 n, 2 m)
    rest: Matrix  # q, (observers, positions)
    small: Tensor  # from q - rest to x, (observers, n, positions)


@compiled_once("state", "estimate", "innovation")
def take_in(
    kernels: Kernels,
    constants: MotionConstants,
    row: int,
    y: Vector,
    state: Vector,
    estimate: Vector,
    innovation: Vector,
) -> None:
    """Correct a predicted state [q, v] by readings, and write the estimate (x, x') then.

    q+ = q + N(q) L e, with a quaternion of length one again, and v+ = v + L' e.

    Args:
        kernels: the equations.
        constants: of the observers.
        row: of the one that it is.
        y: positions of the joints, then rates, shape (2 m,).
        state: in and out, shape (positions + n,).
        estimate: out, shape (2 n,).
        innovation: out, e, shape (2 m,).
    """
    packed, gain, rest = constants.packed[row], constants.gain[row], constants.rest[row]
    small, m = constants.small[row], y.size // 2
    n, positions = small.shape
    interface.reading(kernels, packed, state, innovation[:m], innovation[m:])
    for i in range(y.size):
        innovation[i] = y[i] - innovation[i]
    shift, along = state.copy(), np.empty(state.size)
    for i in range(2 * n):
        step = 0.0
        for j in range(innovation.size):
            step += gain[i, j] * innovation[j]
        if i < n:
            shift[positions + i] = step
        else:
            state[positions + i - n] += step
    interface.position_rates(kernels, packed, 0.0, shift, along)
    for i in range(positions):
        state[i] += along[i]
    if positions > n:  # a unit quaternion
        size = np.sqrt(state[3] ** 2 + state[4] ** 2 + state[5] ** 2 + state[6] ** 2)
        for i in range(3, 7):
            state[i] /= size
    for i in range(n):
        estimate[i], estimate[n + i] = 0.0, state[positions + i]
        for j in range(positions):
            estimate[i] += small[i, j] * (state[j] - rest[j])


@dataclass
class SmallMotionObserver:
    """Fewer readings than coordinates: the model, turning hinges included, and a constant gain.

    Args:
        motion: what moves.
        gain: from innovations of positions and rates to (x, x'), shape (2 n, 2 m).
        period: one tick [s].
    """

    motion: SmallMotion
    gain: Matrix
    period: float
    _x: Vector = field(init=False)
    _tick: int = field(init=False, default=-1)
    _last: Estimate = field(init=False)

    @cached_property
    def constants(self) -> MotionConstants:
        """The constants of its step, one row."""
        model, rest = self.motion.model, self.motion.rest
        small = model.position_rates(rest).T.copy()
        if model.positions > model.coordinates:
            small[3:6] *= 4.0  # q of a small turn: half the turn
        return MotionConstants(model.packed[None], self.gain[None], rest[None], small[None])

    def reset(self, measurement: Measurement) -> None:
        """Start at rest, appendages straight, and take in the first readings."""
        model = self.motion.model
        self._x = np.concatenate((self.motion.rest, np.zeros(model.coordinates)))
        self._correct(measurement)
        self._tick = measurement.tick

    def update(self, measurement: Measurement) -> Estimate:
        """Return the coordinates and their rates."""
        if measurement.tick == self._tick:
            return self._last
        model, t = self.motion.model, measurement.time - self.period
        self._x = model.advance(self._x, measurement.applied_effort, self.period, t=t)
        self._correct(measurement)
        self._tick = measurement.tick
        return self._last

    def _correct(self, measurement: Measurement) -> None:
        y = np.concatenate((measurement.joint_position, measurement.joint_velocity))
        estimate, innovation = np.empty(2 * self.motion.model.coordinates), np.empty(y.size)
        kernels = self.motion.model.kernels
        take_in(kernels, self.constants, 0, y, self._x, estimate, innovation)
        x, rates = np.split(estimate, 2)
        self._last = Estimate(x, rates, _QUIET, _NO_COVARIANCE, innovation)


def observer(
    motion: SmallMotion, settings: ObserverSettings, period: float
) -> InverseObserver | SmallMotionObserver:
    """Return the estimator of small motions: readings inverted where they suffice.

    Raises:
        BadInput: a motion does not show in the readings.
    """
    kept, n = motion.kept, motion.model.coordinates
    c = motion.outputs[:, kept]
    if c.shape[0] == c.shape[1] and np.linalg.cond(c) < _MAX_CONDITION:
        inverse = np.zeros((n, len(c)))
        inverse[kept] = np.linalg.inv(c)
        return InverseObserver(inverse)
    linear, k, m = motion.model.linearise(motion.rest), len(kept), len(c)
    mass = linear.mass[np.ix_(kept, kept)]
    lower = -np.linalg.solve(
        mass, np.hstack((linear.stiffness[np.ix_(kept, kept)], linear.damping[np.ix_(kept, kept)]))
    )
    a = np.vstack((np.hstack((np.zeros((k, k)), np.eye(k))), lower))
    output_matrix = np.block([[c, np.zeros_like(c)], [np.zeros_like(c), c]])
    require_observable(
        a, output_matrix, (*motion.names, *(f"{name} rate" for name in motion.names))
    )
    noise = np.diag([0.0] * k + [settings.process_noise] * k)
    f, _, q = discrete_model(a, np.zeros((2 * k, 1)), noise, period)
    r = np.diag(np.square([settings.position_sigma] * m + [settings.rate_sigma] * m))
    try:
        p = discrete_riccati(f.T, output_matrix.T, q, r)
    except LinAlgError as error:
        raise BadInput(f"observer: no stationary gain: {error}; give other noises") from None
    gain = np.zeros((2 * n, 2 * m))
    gain[np.concatenate((kept, n + kept))] = np.linalg.solve(
        output_matrix @ p @ output_matrix.T + r, output_matrix @ p
    ).T
    return SmallMotionObserver(motion, gain, period)
