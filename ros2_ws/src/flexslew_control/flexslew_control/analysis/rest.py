"""A rest about which the bench is linear: where it stands, when, and the efforts that hold it."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np

from flexslew_plant.arrays import Matrix, Vector
from flexslew_plant.hardware.actuator import ActuatorSettings
from flexslew_plant.hardware.friction import coefficients
from flexslew_plant.keys.units import number_in
from flexslew_plant.testbeds import Testbed, initial_positions
from flexslew_plant.testbeds.model import Model


@dataclass(frozen=True)
class Rest:
    """A model at rest.

    Args:
        model: equations of motion.
        q: where it rests, shape (positions,).
        time: at which what turns is frozen [s].
        effort: that holds it there as well as efforts can, shape (efforts,) [N m or N].
    """

    model: Model
    q: Vector
    time: float
    effort: Vector

    @property
    def state(self) -> Vector:
        """[q, v] with v = 0."""
        return np.concatenate((self.q, np.zeros(self.model.coordinates)))

    @property
    def joints(self) -> dict[str, float]:
        """Joint positions by name [rad or m]."""
        position = self.model.joint_state(self.state)[0].tolist()
        return dict(zip(self.model.joint_names, position, strict=True))


def rest_of(
    testbed: Testbed, joints: Mapping[str, float | str] | None = None, time: float = 0.0
) -> Rest:
    """Return a rest of a testbed.

    Args:
        testbed: what stands on the bench.
        joints: joint positions by name, others as at the start [rad or m], or with a unit; None:
            all as then.
        time: [s].

    Raises:
        BadInput: a name is no joint of the testbed, or a position is no finite number.
    """
    model = testbed.model()
    units = model.units_by_joint
    given = {
        name: number_in(position, (units.get(name, "rad"),), f"rest of {name}")
        for name, position in (joints or {}).items()
    }
    q = model.rest({**initial_positions(testbed), **given})
    loads = model.bias(q, np.zeros(model.coordinates), time)
    effort = np.asarray(
        np.linalg.lstsq(model.input_matrix(q, time), loads, rcond=None)[0], dtype=np.float64
    )
    effort[abs(effort) <= 1e-12 * max(1.0, float(abs(loads).max(initial=0.0)))] = 0.0
    return Rest(model, q, time, effort)


def linear_matrices(rest: Rest, friction: ActuatorSettings | None = None) -> tuple[Matrix, Matrix]:
    """Return A and B of z' = A z + B (u - u0), z = [displacement along v, v], exact.

    Displacements along v are those of q, and turns [rad] where q holds a unit quaternion. Friction
    counts with its slope at rest.

    Args:
        rest: of n coordinates and m efforts.
        friction: of the motors; None: none.

    Returns:
        of shapes (2 n, 2 n) and (2 n, m).
    """
    return slopes(rest.model, rest.state, rest.effort, rest.time, friction)


def slopes(
    model: Model, x: Vector, effort: Vector, t: float, friction: ActuatorSettings | None = None
) -> tuple[Matrix, Matrix]:
    """Return A and B of the motions near one that is at x, as displacements along v and rates.

    M dv' = d(B u) - (d(M a + h)/dq N) z - (dh/dv) dv at the acceleration a of that motion.

    Args:
        model: of n coordinates and m efforts.
        x: [q, v].
        effort: shape (m,).
        t: [s].
        friction: of the motors, see small_motions.
    """
    n, (q, v) = model.coordinates, model.split(x)
    along, input_matrix = model.position_rates(q, t), model.input_matrix(q, t)
    mass = model.mass_matrix(q, t)
    forces = input_matrix @ effort - model.bias(q, v, t)
    acceleration = np.asarray(np.linalg.solve(mass, forces), dtype=np.float64)
    stiffness, damping = model.residual_slopes(x, acceleration, t)
    stiffness = stiffness @ along
    if effort.any() and model.kernels.actuation is not None:
        stiffness -= _slope(lambda z: model.input_matrix(q + along @ z, t) @ effort, n)
    a = np.zeros((2 * n, 2 * n))
    a[:n, n:] = np.eye(n)
    if v.any() and model.positions > n:
        a[:n, :n] = _direction_stiffness(model, q, v, t)
    a[n:] = -np.linalg.solve(mass, np.hstack((stiffness, damping)))
    b = np.vstack((np.zeros_like(input_matrix), np.linalg.solve(mass, input_matrix)))
    if friction is not None:
        _, columns, _, rate, sign = model.resolved_motors
        viscous, coulomb = coefficients(model.resolved_motors, friction)
        friction_slope = viscous + coulomb / friction.coulomb_speed
        at = rate - (model.positions - n)  # displacements are along v, not q
        a[n:, at] -= sign * friction_slope * b[n:, columns]
    return a, b


def _direction_stiffness(model: Model, q: Vector, v: Vector, t: float) -> Matrix:
    """Return how displacements along v change while what they are along turns: N^+ [d(N v), N]."""
    along = model.position_rates(q, t)
    position_slope = _slope(lambda z: model.position_rates(q + along @ z, t) @ v, len(v))
    rotation_slope = _slope(lambda s: (model.position_rates(q + along @ v * s, t)).ravel(), 1)
    stiffness: Matrix = np.linalg.pinv(along) @ (
        position_slope - rotation_slope.reshape(along.shape)
    )
    return stiffness


def _slope(f: Callable[[Vector], Vector], count: int, h: float = 1e-3) -> Matrix:
    """Return df/dz at z = 0 by differences of fourth order, one column per entry of z."""
    columns = []
    for one in h * np.eye(count):
        near, far = f(one) - f(-one), f(2.0 * one) - f(-2.0 * one)
        columns.append((8.0 * near - far) / (12.0 * h))
    return np.array(columns).T
