"""Members that turn in three axes: the feedback is of the rotation to the nominal attitude.

    u_i(k) = w(k) + A (Kp theta(q_i(k)^-1 q_0(k)) + Kd (w_0(k) - w_i(k))),  joint by joint,
with theta the rotation vector of a quaternion and A the joints' axes. About the rest at the goal
the coordinates are the turn from there, in body axes, and the modes. Where the craft floats and how
far its wheels have turned decides nothing; both follow from what momentum is conserved.
"""

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property, lru_cache
from typing import Any, NamedTuple, cast

import numpy as np
from numba import types
from scipy.linalg import null_space

from flexslew_control.analysis.lti import Lti
from flexslew_control.free_platform import rate_readings
from flexslew_control.planners.minimax.motion import MemberFlight
from flexslew_control.planners.minimax.response import RestMotion
from flexslew_control.planners.motors import Matrices, give, matrices
from flexslew_control.planners.time_optimal.held_pieces import flown_pieces
from flexslew_control.planners.time_optimal.reorientation import Reorientation
from flexslew_plant.arrays import Indices, Matrix, Tensor, Vector, compiled
from flexslew_plant.errors import BadInput
from flexslew_plant.testbeds import Model, Testbed
from flexslew_plant.testbeds.attitude import conjugate, product, rotation_vector
from flexslew_plant.testbeds.compiled.bound import ADVANCE
from flexslew_plant.testbeds.floating import CanFloat
from flexslew_plant.testbeds.linearisation import Linearisation
from flexslew_plant.testbeds.quaternions import multiplied, turn_of

_CHANGE = 1e-6  # of a quaternion, for the slopes of the rotation
_SPRING = 1e-9  # of the largest stiffness: none, but for rounding


class PlatformEntries(NamedTuple):
    """Where a state holds the platform's attitude and rate."""

    attitude: Indices  # of the quaternion x y z w, (4,)
    rate: Indices  # of the body rates, (3,)


def platform_of(testbed: Testbed) -> PlatformEntries:
    """Return where a testbed's state holds its platform.

    Raises:
        BadInput: it does not float.
    """
    floating = testbed.floating() if isinstance(testbed, CanFloat) else None
    if floating is None:
        words = "its platform does not float; take moving, about the eigenaxis"
        raise BadInput(words, "plan", "drives", "all")
    model = testbed.model()
    place = floating.motion(np.arange(model.positions + model.coordinates, dtype=np.float64))
    return PlatformEntries(place.attitude.astype(int), place.rate.astype(int))


@dataclass(frozen=True)
class TurningMotion:
    """See motion.MemberMotion.

    Args:
        nominal: from rest to rest, on the model that the planner believes in.
        platform: where a state holds it.
    """

    nominal: Reorientation
    platform: PlatformEntries

    @cached_property
    def _axes(self) -> Matrix:
        """Of the joints, shape (joints, 3)."""
        return np.ascontiguousarray(self.nominal.attitude.axes)

    def _of(self, model: Model) -> Reorientation:
        """Return the same turn of a member."""
        n = self.nominal
        return n if model is n.model else Reorientation(model, n.first, n.last, n.amplitude)

    def at_rest(self, model: Model) -> RestMotion:
        """Return the small motions of turn and modes about the rest at the goal.

        With v = Y y' + S s', where y are turn and modes, S reads neither, and Y^T M S = 0, no
        spring or damper acts on s, and y moves by itself.

        Raises:
            BadInput: a hinge on a spring moves besides.
        """
        place = self._of(model).rest[: model.positions]
        linear = model.linearise(place)
        n, modes, joints = model.coordinates, model.modes, len(self._axes)
        turn = self.nominal.attitude.turn_of(rate_readings(model, place).T).T
        read = np.vstack((turn, np.eye(n)[n - modes :]))
        other, own = null_space(read), np.linalg.pinv(read)
        if abs(other.T @ linear.stiffness).max(initial=0.0) > _SPRING * abs(linear.stiffness).max():
            words = "a hinge on a spring moves besides; take moving, about the eigenaxis"
            raise BadInput(words, "plan", "drives", "all")
        mass = linear.mass
        own = own - other @ np.linalg.solve(other.T @ mass @ other, other.T @ mass @ own)
        inner = [own.T @ part @ own for part in (mass, linear.damping, linear.stiffness)]
        mass, damping, stiffness = (0.5 * (part + part.T) for part in inner)
        k = len(read)
        seen = np.zeros((2 * joints, 2 * k))
        seen[:joints, :3] = seen[joints:, k : k + 3] = self._axes
        tip = np.zeros((len(model.appendages.names), 2 * k))
        tip[:, 3:k] = model.appendages.tip
        return RestMotion(
            Linearisation(mass, damping, stiffness, own.T @ linear.input_matrix), seen, tip, 3
        )

    def flight(
        self, model: Model, efforts: Matrix, gains: Matrix, path: Matrix | None, motors: Lti
    ) -> MemberFlight:
        """Return the flight of a member."""
        start, joints = self._of(model).start, len(self._axes)
        if path is None:
            gains, path = np.zeros_like(gains), np.zeros((len(efforts) + 1, start.size))
        about_axes = np.hstack((gains[:, :joints] @ self._axes, gains[:, joints:] @ self._axes))
        places = np.concatenate(self.platform)
        flown = _kernel()(
            model.integrate, model.packed, start, np.ascontiguousarray(efforts),
            np.ascontiguousarray(path), about_axes, places, matrices(motors), motors.period,
            model.before_modes,
        )  # fmt: skip
        return MemberFlight(*flown)

    def step_derivatives(
        self, model: Model, flown: MemberFlight, period: float
    ) -> tuple[Tensor, Tensor]:
        """Return central differences of the integrator's step; see held_pieces."""
        held = np.full(len(flown.applied), period)
        columns = self.nominal.columns
        found = flown_pieces(model, flown.states[0], flown.applied, held, period, columns)
        return found.by_state, found.by_effort

    def feedback_derivatives(
        self, gains: Matrix, states: Matrix, path: Matrix
    ) -> tuple[Tensor, Tensor]:
        """Return those of the feedback, by central differences of the rotation."""
        (ticks, size), joints = states.shape, len(self._axes)
        kp = gains[:, :joints] @ self._axes
        kd = gains[:, joints:] @ self._axes
        at, rate = self.platform
        own, nominal = np.zeros((2, ticks, joints, size))
        for k, column in enumerate(at):
            change = _CHANGE * np.eye(4)[k]
            for found, (mine, other) in ((own, (change, 0.0 * change)), (nominal, (0.0, change))):
                ahead = _between(states[:, at] + mine, path[:, at] + other)
                back = _between(states[:, at] - mine, path[:, at] - other)
                found[:, :, column] = (ahead - back) @ kp.T / (2.0 * _CHANGE)
        own[:, :, rate], nominal[:, :, rate] = -kd, kd
        return own, nominal

    def readings(self, model: Model) -> Matrix:
        """Return what reads tips and rates off a state; positions, of no limit, read as zero."""
        joints, tips = len(self._axes), len(model.appendages.names)
        n, q = model.coordinates, model.positions
        found = np.zeros((tips + 2 * joints, n + q))
        found[:tips, q - model.modes : q] = model.appendages.tip
        found[tips + joints :, self.platform.rate] = self._axes
        return found

    def deviation(self, model: Model, x: Vector) -> Vector:
        """Return turn and modes from the rest at the goal, and their rates, shape (2 k,)."""
        missed: Vector = self._of(model).missed(x)[self._order(model)]
        return missed

    def deviation_slopes(self, model: Model, x: Vector) -> Matrix:
        """Return the derivatives of the deviation by the state, shape (2 k, size)."""
        slopes: Matrix = self._of(model).missed_slopes(x)[self._order(model)]
        return slopes

    def _order(self, model: Model) -> Indices:
        """Return coordinates first, then rates: indices of Reorientation.missed."""
        modes = np.arange(model.modes)
        return np.concatenate(([0, 1, 2], 6 + modes, [3, 4, 5], 6 + model.modes + modes))


def _between(measured: Matrix, goal: Matrix) -> Matrix:
    """Return the rotation vectors of q_measured^-1 q_goal, shape (k, 3) [rad]."""
    return rotation_vector(product(conjugate(measured), goal))


@lru_cache
def _kernel() -> Callable[..., tuple[Matrix, Matrix, Matrix, Vector]]:
    """Return _flown as machine code, the same for all testbeds."""
    vector, matrix = types.Array(types.float64, 1, "C"), types.Array(types.float64, 2, "C")
    places = types.Array(types.int64, 1, "C")
    kernel: Any = compiled(_flown)
    found = types.Tuple((matrix, matrix, matrix, vector))
    given = vector, vector, matrix, matrix, matrix, places
    motors = types.UniTuple(matrix, 4)
    kernel.compile(found(ADVANCE, *given, motors, types.float64, types.int64))
    kernel.disable_compile()  # never for the type of one testbed's function
    return cast(Callable[..., tuple[Matrix, Matrix, Matrix, Vector]], kernel)


def _flown(
    advance: Callable[..., None],
    p: Vector,
    start: Vector,
    efforts: Matrix,
    nominal: Matrix,
    gains: Matrix,
    places: Indices,
    motors: Matrices,
    period: float,
    before_modes: int,
) -> tuple[Matrix, Matrix, Matrix, Vector]:
    """Return states, commands, efforts and the motors' states."""
    ticks, m = efforts.shape
    path, x, u = np.empty((ticks + 1, start.size)), start.copy(), np.empty(m)
    commanded, applied = np.empty((ticks, m)), np.empty((ticks, m))
    z = np.zeros(len(motors[0]))
    at, rate = places[:4], places[4:]
    path[0] = x
    for k in range(ticks):
        r = nominal[k]
        back = -x[at[0]], -x[at[1]], -x[at[2]], x[at[3]]
        there = r[at[0]], r[at[1]], r[at[2]], r[at[3]]
        turn = turn_of(multiplied(back, there))
        for j in range(m):
            u[j] = efforts[k, j]
            for i in range(3):
                u[j] += gains[j, i] * turn[i] + gains[j, 3 + i] * (r[rate[i]] - x[rate[i]])
            commanded[k, j] = u[j]
        give(motors, z, u)
        applied[k] = u
        advance(p, k * period, u, period, 1, before_modes, x)
        path[k + 1] = x
    return path, commanded, applied, z
