"""What holds all along a reorientation: cones that boresights keep out of, and a largest rate."""

from dataclasses import dataclass

import numpy as np

from flexslew_plant.arrays import Indices, Matrix, Tensor
from flexslew_plant.testbeds.contract import Cone
from flexslew_plant.testbeds.model import Model
from flexslew_plant.testbeds.orientation.attitude import conjugate, quaternion, to_inertial

_CHANGE = 1e-6  # of a state
_AXIS_SINE = 1e-9  # sine of the angle below which a boresight counts as on the axis of a cone


@dataclass(frozen=True)
class PathLimits:
    """Inequalities of the states of a craft with joints that read its attitude; see `excess`.

    Args:
        cones: cones that its boresights keep out of.
        rate_limit: largest length of the body rate [rad/s]; None: any.
        margin: margin for the motion between the states that are checked: added to half angles
            [rad], and the share of the rate limit that is kept free [-].
    """

    cones: tuple[Cone, ...] = ()
    rate_limit: float | None = None
    margin: float = 0.0

    @property
    def names(self) -> tuple[str, ...]:
        """Of the inequalities, for messages."""
        cones = tuple(f"keep_out {cone.name}" for cone in self.cones)
        return cones + (("rate_limit",) if self.rate_limit is not None else ())

    def excess(self, model: Model, states: Matrix) -> Matrix:
        """Return by how much states are beyond the limits, shape (..., limits) [rad, rad/s].

        Args:
            model: a model with joints that read an attitude.
            states: shape (..., size).
        """
        assert model.attitude is not None
        rows = model.joint_states(states.reshape(-1, states.shape[-1]))
        shape = (*states.shape[:-1], model.joints)
        position, rate = (part.reshape(shape) for part in rows)
        attitude = quaternion(model.attitude.rotation_vector_of(position))
        excess = [self.margin - cone.margin(attitude) for cone in self.cones]
        if self.rate_limit is not None:
            size = np.linalg.norm(model.attitude.rotation_vector_of(rate), axis=-1)
            excess.append(size - (1.0 - self.margin) * self.rate_limit)
        return np.stack(excess, axis=-1)

    def slopes(self, model: Model, states: Matrix, columns: Indices) -> Tensor:
        """Return the derivatives of `excess` by the states, shape (k, limits, size).

        Args:
            model: as above.
            states: shape (k, size).
            columns: entries of a state that matter; the others' columns are zero.
        """
        found = np.zeros((len(states), len(self.names), states.shape[1]))
        change = np.zeros((columns.size, states.shape[1]))
        change[np.arange(columns.size), columns] = _CHANGE
        samples = np.stack((states[:, None] + change, states[:, None] - change))
        plus, minus = self.excess(model, samples)
        found[:, :, columns] = (plus - minus).swapaxes(1, 2) / (2.0 * _CHANGE)
        return found

    @property
    def bounds(self) -> Matrix:
        """Lowest and highest allowed values of `readings`, without the spare, shape (2, limits)."""
        rows = [(cone.half_angle, np.inf) for cone in self.cones]
        if self.rate_limit is not None:
            rows.append((-np.inf, self.rate_limit))
        return np.array(rows).reshape(-1, 2).T

    def outputs(self, attitude: Matrix, rate: Matrix) -> Matrix:
        """Return the angles between boresights and axes of the cones, and the length of the rate.

        Args:
            attitude: quaternions x y z w, shape (k, 4).
            rate: in body axes, shape (k, 3) [rad/s].

        Returns:
            shape (k, limits) [rad, rad/s].
        """
        found = [cone.margin(attitude) + cone.half_angle for cone in self.cones]
        if self.rate_limit is not None:
            found.append(np.linalg.norm(rate, axis=1))
        return np.array(found).reshape(-1, len(attitude)).T

    def reading_slopes(self, attitude: Matrix, rate: Matrix) -> Tensor:
        """Return the derivatives of `readings` by a turn about the body axes and by body rates.

        The angle between a boresight b, in body axes, and the axis a of a cone, R^T a there, has
            d angle = -(b x R^T a) . d phi / |b x R^T a|.
        Where b is along R^T a, any direction leads away: one across b is taken.

        Args:
            attitude: quaternions x y z w, shape (k, 4).
            rate: in body axes, shape (k, 3) [rad/s].

        Returns:
            shape (k, limits, 6).
        """
        found = np.zeros((len(attitude), len(self.names), 6))
        for i, cone in enumerate(self.cones):
            normal = np.cross(cone.boresight, to_inertial(conjugate(attitude), cone.axis))
            sine = np.linalg.norm(normal, axis=1)
            fallback = np.cross(cone.boresight, np.eye(3)[int(np.argmin(abs(cone.boresight)))])
            normal[sine < _AXIS_SINE] = fallback
            found[:, i, :3] = -normal / np.linalg.norm(normal, axis=1)[:, None]
        if self.rate_limit is not None:
            size = np.linalg.norm(rate, axis=1)[:, None]
            found[:, -1, 3:] = rate / np.where(size > 0.0, size, 1.0)
        return found


FREE = PathLimits()  # of a path that only its ends bind
