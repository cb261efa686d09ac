"""A reorientation: from rest at one attitude to rest at another, by efforts held over pieces."""

from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np

from flexslew_control.linear.free_platform import rate_outputs
from flexslew_control.planners.attitude.eigenaxis import continuous
from flexslew_control.planners.time_optimal.three_axes.held_pieces import Pieces, simulate_pieces
from flexslew_control.planners.time_optimal.three_axes.path_limits import FREE, PathLimits
from flexslew_plant.arrays import Indices, Matrix, Tensor, Vector
from flexslew_plant.testbeds.model import Model
from flexslew_plant.testbeds.orientation.attitude import AttitudeJoints

_CHANGE = 1e-6  # of a state, for the slopes of the end conditions
_ANGLE = 1.0  # of the fastest mode in a step of the integration [rad]
_RIGID_STEPS = 40  # of a slew, at least
_NEAR = 0.5  # of the turn: limits that are farther away are not looked at
_SLOPE_TOLERANCE = 1e-8  # slope of an entry of the state that matters


class Along(NamedTuple):
    """How far a flight is beyond the limits of its path, where it is near them, and the slopes."""

    excess: Vector  # of PathLimits, scaled as the end conditions, (rows,)
    by_effort: Tensor  # (rows, pieces, efforts)
    by_duration: Matrix  # (rows, pieces)


class End(NamedTuple):
    """How a flight ends: its end conditions and their slopes."""

    missed: Vector  # turn and rates of the platform, modes and their rates, (conditions,)
    by_effort: Tensor  # (conditions, pieces, efforts)
    by_duration: Matrix  # (conditions, pieces)
    states: Matrix  # at the ends of the pieces, (pieces + 1, size)
    along: Along  # without limits: no rows


@dataclass(frozen=True)
class Reorientation:
    """A reorientation of a model from one attitude to another.

    Args:
        model: a model with joints that read an attitude; every effort turns it.
        first: joint positions at the start, at rest, shape (joints,) [rad].
        last: joint positions at the goal, shape (joints,) [rad].
        amplitude: largest efforts, shape (joints,) [N m].
        limits: limits of the whole path.
    """

    model: Model
    first: Vector
    last: Vector
    amplitude: Vector
    limits: PathLimits = FREE

    @property
    def attitude(self) -> AttitudeJoints:
        """The joints that read the attitude."""
        assert self.model.attitude is not None
        return self.model.attitude

    @cached_property
    def start(self) -> Vector:
        """State at rest."""
        return self._at(self.first)

    @property
    def rest(self) -> Vector:
        """State at rest at the goal."""
        return self._at(self.last)

    def _at(self, position: Vector) -> Vector:
        rest = self.model.rest(dict(zip(self.model.joint_names, position.tolist(), strict=True)))
        return np.concatenate((rest, np.zeros(self.model.coordinates)))

    @cached_property
    def turn(self) -> Vector:
        """The rotation from start to goal in body axes, the shorter way, shape (3,) [rad]."""
        return self.attitude.rotation_vector_of(self.model.joint_error(self.first, self.last))

    @cached_property
    def shares(self) -> Vector:
        """Of the amplitudes, in the fastest acceleration about the eigenaxis, shape (joints,)."""
        efforts = np.linalg.pinv(self.gain) @ self.turn
        shares = efforts / self.amplitude
        most: Vector = shares / abs(shares).max()
        return most

    @cached_property
    def duration(self) -> float:
        """Of the slew about the eigenaxis without gyroscopic torques [s]."""
        push = self.gain @ (self.shares * self.amplitude)
        return float(2.0 * np.sqrt(np.linalg.norm(self.turn) / np.linalg.norm(push)))

    @cached_property
    def gain(self) -> Matrix:
        """From efforts to the platform's angular acceleration, shape (3, joints)."""
        q = self.start[: self.model.positions]
        acceleration = np.linalg.solve(self.model.mass_matrix(q), self.model.input_matrix(q))
        return self.attitude.rotation_vector_of((rate_outputs(self.model, q) @ acceleration).T).T

    @cached_property
    def scale(self) -> Vector:
        """What counts as one of each end condition, shape (conditions,)."""
        model, angle = self.model, float(np.linalg.norm(self.turn))
        rigid = [angle] * 3 + [4.0 * angle / self.duration] * 3
        if not model.modes:
            return np.array(rigid)
        q = self.start[: model.positions]
        linear = model.linearise(q)
        n, inputs = model.before_modes, model.input_matrix(q) @ (self.shares * self.amplitude)
        acceleration = np.linalg.solve(linear.mass[:n, :n], inputs[:n])
        deflection = abs(linear.mass[n:, :n] @ acceleration) / np.diag(linear.stiffness)[n:]
        modal_scale = max(float(deflection.max()), 1e-9)
        min_frequency = float(linear.frequencies[0])
        return np.array(
            rigid + [modal_scale] * model.modes + [modal_scale * min_frequency] * model.modes
        )

    @cached_property
    def step(self) -> float:
        """Longest integration step [s]."""
        max_step = self.duration / _RIGID_STEPS
        if not self.model.modes:
            return max_step
        linear = self.model.linearise(self.start[: self.model.positions])
        return min(max_step, _ANGLE / float(linear.frequencies[-1]))

    def rest_error(self, states: Matrix) -> Matrix:
        """Return what states are away from rest at the goal, shape (k, conditions)."""
        position, rate = self.model.joint_states(states)
        rotation_of = self.attitude.rotation_vector_of
        rotation = -rotation_of(self.model.joint_error(position, self.last))
        return np.hstack((rotation, rotation_of(rate), *self.model.modal_state(states)))

    def joints(self, states: Matrix) -> tuple[Matrix, Matrix]:
        """Return positions and rates of the joints, without jumps of a whole turn.

        Args:
            states: of a flight from its start on, shape (k, size).

        Returns:
            shape (k, joints) each [rad, rad/s].
        """
        read, rate = self.model.joint_states(states)
        rotation = self.attitude.rotation_vector_of(read)
        rotation[0] = self.attitude.rotation_vector_of(self.first)
        position = continuous(rotation) @ self.attitude.axes.T
        position[0] = self.first
        return position, rate

    def states(self, efforts: Matrix, duration: float) -> Matrix:
        """Return the states at the ends of equal pieces, shape (pieces + 1, size).

        Args:
            efforts: of the pieces, shape (pieces, joints) [N m].
            duration: of all of them [s].
        """
        piece = duration / len(efforts)
        steps = max(1, int(np.ceil(piece / min(self.step, piece))))
        path = self.model.path(self.start, efforts, piece, steps)
        return np.vstack((self.start, path))

    def ended(self, efforts: Matrix, durations: Vector) -> End:
        """Return how a flight ends, and its slopes.

        Args:
            efforts: of the pieces, shape (pieces, joints) [N m].
            durations: shape (pieces,) [s].
        """
        step = min(self.step, float(durations.max()))
        flight = simulate_pieces(self.model, self.start, efforts, durations, step, self.columns)
        slopes = self.end_jacobian(flight.states[-1])
        by_effort = np.empty((len(slopes), *efforts.shape))
        by_duration = np.empty((len(slopes), len(durations)))
        ends = zip(flight.states[1:], efforts, strict=True)
        rates = np.array([self.model.derivative(x, effort) for x, effort in ends])
        for k in range(len(durations) - 1, -1, -1):
            by_effort[:, k] = slopes @ flight.by_effort[k]
            by_duration[:, k] = slopes @ rates[k]
            slopes = slopes @ flight.by_state[k]
        along, [error] = self._along(flight, efforts, rates), self.rest_error(flight.states[-1:])
        return End(error, by_effort, by_duration, flight.states, along)

    def limit_excess(self, states: Matrix) -> Matrix:
        """Return the excess of states, scaled as the end conditions, shape (k, limits)."""
        if not self.limits.names:
            return np.zeros((len(states), 0))
        units = np.full(len(self.limits.names), self.scale[0])
        units[len(self.limits.cones) :] = self.scale[3]
        scaled: Matrix = self.limits.excess(self.model, states) / units
        return scaled

    def _along(self, flight: Pieces, efforts: Matrix, rates: Matrix) -> Along:
        """Return the excess at the ends of the pieces, the last ones first, and its slopes."""
        pieces, size = len(efforts), self.start.size
        excess = self.limit_excess(flight.states[1:])
        near = excess > -_NEAR
        rows, active = int(near.sum()), np.zeros((0, size))
        by_effort, by_duration = np.zeros((rows, *efforts.shape)), np.zeros((rows, pieces))
        close = np.flatnonzero(near.any(axis=1))
        slopes = np.zeros((pieces, len(self.limits.names), size))
        if rows:
            slopes[close] = self.limits.slopes(self.model, flight.states[1:][close], self.columns)
        for k in range(pieces - 1, -1, -1):
            if near[k].any():
                units = np.where(np.flatnonzero(near[k]) < len(self.limits.cones), 0, 3)
                active = np.vstack((active, slopes[k][near[k]] / self.scale[units][:, None]))
            if len(active):
                by_effort[: len(active), k] = active @ flight.by_effort[k]
                by_duration[: len(active), k] = active @ rates[k]
                active = active @ flight.by_state[k]
        return Along(excess[::-1][near[::-1]], by_effort, by_duration)

    def end_jacobian(self, x: Vector) -> Matrix:
        """Return the derivatives of the end conditions by a state, (conditions, size)."""
        change = _CHANGE * np.eye(x.size)
        slopes: Matrix = (self.rest_error(x + change) - self.rest_error(x - change)) / (
            2.0 * _CHANGE
        )
        return slopes.T

    @cached_property
    def columns(self) -> Indices:
        """Which entries of a state lead to the end conditions: not where a wheel stands."""
        rng = np.random.default_rng(1)
        x = self.start.copy()
        x[self.model.positions :] += rng.uniform(-0.1, 0.1, self.model.coordinates)
        active = self.shares[None] * self.amplitude
        after = np.array([0.1 * self.duration])
        flight = simulate_pieces(self.model, x, active, after, self.step)
        relevant = (abs(self.end_jacobian(flight.states[-1])) > _SLOPE_TOLERANCE).any(axis=0)
        for _ in range(x.size):
            more = relevant | (abs(flight.by_state[0][relevant]) > _SLOPE_TOLERANCE).any(axis=0)
            if (more == relevant).all():
                break
            relevant = more
        return np.flatnonzero(relevant)


@dataclass(frozen=True)
class Arcs:
    """A reorientation by arcs with every effort at its amplitude; see optimal_switching.

    Args:
        slew: what is turned.
        signs: of the efforts of the arcs, shape (arcs, joints).
    """

    slew: Reorientation
    signs: Matrix

    def residual_jacobian(self, durations: Vector) -> tuple[Vector, Matrix]:
        """Return what misses the goal, shape (conditions,), and its slopes, (conditions, arcs)."""
        end = self.slew.ended(self.signs * self.slew.amplitude, durations)
        return end.missed, end.by_duration
