"""The small motions of a plant that changes with time: M(t) x'' + D(t) x' + K(t) x = B(t) u + d(t).

These are the linearised equations of a platform with retargeting appendages (Kwak 1989, (2-34),
(2-49)): d is the inertial loading of the prescribed motion. Numbers are in the units of the
testbed's section, in which the weights of its laws are given.
"""

from dataclasses import dataclass
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

from flexslew_control.law import PlantDescription
from flexslew_plant.arrays import Matrix, Vector
from flexslew_plant.errors import BadInput
from flexslew_plant.testbeds import Testbed, design_testbed
from flexslew_plant.testbeds.contract import Retargetable, UnitSizes, unit_sizes
from flexslew_plant.testbeds.linearisation import Linearisation
from flexslew_plant.testbeds.model import Model

Indices: TypeAlias = NDArray[np.intp]
_COUPLING_TOLERANCE = 1e-9  # of the largest entry of a row: less is no coupling
_RANK = 1e-9  # of the largest singular value


@dataclass(frozen=True)
class Frozen(Linearisation):
    """The equations at one instant, for k coordinates and m efforts; A and B are (2-36), (2-37)."""

    disturbance: Vector  # d, (k,)


@dataclass(frozen=True)
class SmallMotion:
    """The small motions of a testbed at rest.

    Args:
        model: equations of motion.
        rest: q at rest, shape (positions,).
        kept: coordinates that the efforts reach, shape (k,).
        units: unit sizes of the testbed's section.
        outputs: C of y = C x for the collocated joints, SI, shape (m, n).
    """

    model: Model
    rest: Vector
    kept: Indices
    units: UnitSizes
    outputs: Matrix

    def at(self, t: float) -> Frozen:
        """Return the equations at a time [s]."""
        frozen = _frozen(self.model, self.rest, self.units, t)
        pairs = np.ix_(self.kept, self.kept)
        return Frozen(
            frozen.mass[pairs],
            frozen.damping[pairs],
            frozen.stiffness[pairs],
            frozen.input_matrix[self.kept],
            frozen.disturbance[self.kept],
        )

    def before(self, start: float = 0.0) -> Frozen:
        """Return the equations an instant before a manoeuvre that starts then [s]."""
        return self.at(float(np.nextafter(start, -np.inf)))

    @property
    def rest_position(self) -> Vector:
        """Positions of the joints at rest, shape (m,) [rad or m]."""
        zero_rates = np.zeros(self.model.coordinates)
        return self.model.joint_state(np.concatenate((self.rest, zero_rates)))[0]

    @property
    def names(self) -> tuple[str, ...]:
        """Of the coordinates that are kept."""
        rates = self.model.state_names[self.model.positions :]
        return tuple(rates[k].removesuffix(" rate") for k in self.kept)

    def gains(self, gains: Matrix) -> Matrix:
        """Return gains on all coordinates in SI, from gains on the kept ones.

        Args:
            gains: blocks of columns (k each), shape (m, b k).
        """
        n, k = self.model.coordinates, len(self.kept)
        padded = np.zeros((len(gains), gains.shape[1] // k, n))
        sizes = self.units.coordinates[self.kept]
        padded[:, :, self.kept] = gains.reshape(len(gains), -1, k) / sizes
        return self.units.efforts[:, None] * padded.reshape(len(gains), -1)


def small_motion(testbed: Testbed, until: float = 0.0) -> SmallMotion:
    """Return the small motions of a testbed about its rest.

    Coordinates that no effort reaches, over any coupling at any time, are left out.

    Args:
        testbed: what is believed.
        until: the configuration changes until then [s].
    """
    model = testbed.model()
    rest, units = model.rest({}), unit_sizes(testbed)
    reached = np.zeros(model.coordinates, dtype=bool)
    linked = np.zeros((model.coordinates,) * 2)
    for t in (0.0, 0.3 * until, until):
        frozen = _frozen(model, rest, units, t)
        reached |= abs(frozen.input_matrix).max(axis=1) > _COUPLING_TOLERANCE
        for matrix in (frozen.mass, frozen.stiffness + frozen.stiffness.T):
            linked += abs(matrix) > _COUPLING_TOLERANCE * abs(matrix).max()
    for _ in range(model.coordinates):
        reached |= linked @ reached > 0.0
    columns = [
        model.joint_state(np.concatenate((rest, one)))[1] for one in np.eye(model.coordinates)
    ]
    return SmallMotion(model, rest, np.flatnonzero(reached), units, np.array(columns).T)


def _frozen(model: Model, rest: Vector, units: UnitSizes, t: float) -> Frozen:
    linear = model.linearise(rest, t)
    d = -model.bias(rest, np.zeros(model.coordinates), t)
    s, e, scale = units.coordinates, units.efforts, units.energy
    return Frozen(
        s[:, None] * linear.mass * s / scale,
        s[:, None] * linear.damping * s / scale,
        s[:, None] * linear.stiffness * s / scale,
        s[:, None] * linear.input_matrix * e / scale,
        s * d / scale,
    )


def require_full_rank(frozen: Frozen, motion: SmallMotion) -> None:
    """Check that B* has full column rank, so that B*^T B* can be inverted (3-5).

    Raises:
        BadInput: it has not; names the dependent efforts, and the motion that they leave
            without a balance.
    """
    left, singular, right = np.linalg.svd(frozen.input_matrix)
    if len(singular) == frozen.input_matrix.shape[1] and singular[-1] > _RANK * singular[0]:
        return
    rank = int((singular > _RANK * singular[0]).sum())
    dependent = np.argsort(-abs(right[-1]))[:2]
    dependent_names = " and ".join(sorted(motion.model.joint_names[k] for k in dependent))
    lost = left[:, rank:]
    free = motion.names[int(np.argmax((lost**2).sum(axis=1)))] if lost.size else "none"
    raise BadInput(
        f"B* has rank {rank} for {frozen.input_matrix.shape[1]} efforts: {dependent_names} are "
        "dependent; "
        f"the motion of {free} cannot be balanced; remove one of them or move it"
    )


def design_motion(plant: PlantDescription, changes: dict[str, Any] | None) -> SmallMotion:
    """Return the small motions that a law believes in.

    Args:
        plant: what stands on the bench.
        changes: keys of the testbed believed otherwise; None: none.

    Raises:
        BadInput: an unknown key or a value that is not allowed.
    """
    testbed = (
        plant.testbed
        if changes is None
        else design_testbed(plant.testbed, changes, "model", plant.trust)
    )
    return small_motion(testbed, last_rotation_end(testbed))


def last_rotation_end(testbed: Testbed) -> float:
    """Return when the last prescribed turn ends [s]; 0: there is none."""
    rotations = testbed.hinge_turns() if isinstance(testbed, Retargetable) else ()
    return max((rotation.end for rotation in rotations), default=0.0)
