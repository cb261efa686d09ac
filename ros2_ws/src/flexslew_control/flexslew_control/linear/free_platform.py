"""A spacecraft as a linear law sees it: its joints first, without what no effort moves.

Small motions z about a rest: M z'' + D z' + K z = B u, joint readings C z. The motions that the
efforts reach are modes with a share B^T phi that is not zero; of these, coordinates are chosen with
C z = the first of them, such that a joint that turns the platform turns it as a rigid body.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np
from scipy.linalg import eigh, null_space

from flexslew_control.law import Reference, nominal_state
from flexslew_control.linear.design_checks import LinearDesignModel
from flexslew_control.linear.zero_order_hold import zero_order_hold
from flexslew_plant.arrays import EMPTY, Matrix, Vector
from flexslew_plant.errors import BadInput
from flexslew_plant.known_joints import require_joints
from flexslew_plant.testbeds.linearisation import Linearisation
from flexslew_plant.testbeds.model import Appendages, Model

_RIGID = 1e-9  # of the largest squared frequency: zero but for rounding
_SAME = 1e-7  # of it: frequencies of one group
_REACHED = 1e-7  # of the largest share: an effort moves it
_LEAST_DEFLECTION = 1e-6  # of the largest deflection by a coordinate: one that deflects nothing


@dataclass(frozen=True)
class LinearModel:
    """M z'' + D z' + K z = B u with the joints as the first coordinates.

    Args:
        joint_names: of the first coordinates.
        linear: its matrices, shapes (n, n) and (n, joints).
        appendages: readings of the tips, as maps of the coordinates after the joints.
        modal_mass: M of these coordinates by the deflections alone, without what wheels store.
    """

    joint_names: tuple[str, ...]
    linear: Linearisation
    appendages: Appendages
    modal_mass: Matrix
    time_varying: bool = False
    _steps: dict[float, tuple[Matrix, Matrix]] = field(default_factory=dict)

    @property
    def joints(self) -> int:
        """How many joints."""
        return len(self.joint_names)

    @property
    def coordinates(self) -> int:
        """n, joints and others."""
        return len(self.linear.mass)

    @property
    def modes(self) -> int:
        """How many coordinates stand after the joints."""
        return self.coordinates - self.joints

    @cached_property
    def _matrices(self) -> tuple[Matrix, Matrix]:
        return self.linear.state_matrix, self.linear.state_input_matrix

    def rest(self, positions: Mapping[str, float]) -> Vector:
        """Return z with the joints named at these positions, shape (n,); see Model.rest."""
        require_joints(positions, self.joint_names)
        rest = np.zeros(self.coordinates)
        rest[: self.joints] = [positions.get(name, 0.0) for name in self.joint_names]
        return rest

    def linearise(self, q: Vector, t: float = 0.0) -> Linearisation:
        """Return its matrices, the same everywhere."""
        return self.linear

    def jacobian(self, x: Vector, effort: Vector, t: float = 0.0) -> tuple[Matrix, Matrix]:
        """Return A and B of x' = A x + B u, the same everywhere."""
        return self._matrices

    def advance(
        self, x: Vector, effort: Vector, dt: float, steps: int = 1, t: float = 0.0
    ) -> Vector:
        """Return the state dt later with the effort held, exactly."""
        if dt not in self._steps:
            self._steps[dt] = zero_order_hold(*self._matrices, dt)
        f, g = self._steps[dt]
        return np.asarray(f @ x + g @ effort)

    def path(self, x: Vector, efforts: Matrix, dt: float, steps: int = 1, t: float = 0.0) -> Matrix:
        """Return the states after each of the efforts, held for dt each; see Model.path."""
        found = []
        for effort in efforts:
            x = self.advance(x, effort, dt)
            found.append(x)
        return np.array(found)


def joints_first(model: Model, rest: Vector) -> LinearDesignModel:
    """Return a model with the joints as its first coordinates: itself, or its small motions.

    Args:
        model: the design model of a law.
        rest: equilibrium about which it is linear, shape (positions,).

    Raises:
        BadInput: if the joints do not move independently of each other.
    """
    return model if model.leading is None else reduced_model(model, joint_coordinates(model, rest))


@dataclass(frozen=True)
class JointCoordinates:
    """Coordinates z of the small motions that efforts reach, the joints' readings first.

    Args:
        linear: the small motions along v, about the rest.
        outputs: C, what the joints read of v, shape (joints, n).
        basis: from z' to v, shape (n, k).
    """

    linear: Linearisation
    outputs: Matrix
    basis: Matrix

    def elastic(self, modes: int) -> Matrix:
        """Return the modes along the coordinates after the joints, shape (modes, k - joints)."""
        return self.basis[len(self.basis) - modes :, len(self.outputs) :]


def joint_coordinates(model: Model, rest: Vector) -> JointCoordinates:
    """Return coordinates of which the first are the joints.

    The others are orthonormal combinations of the appendages' modes, as far as all of them deflect
    these: a weight on their squares is one on the squares of the modes.

    Raises:
        BadInput: the joints do not move independently of each other.
    """
    linear = model.linearise(rest)
    outputs = rate_outputs(model, rest)
    reached, rigid = _reached(linear)
    seen = outputs @ reached
    of_rigid = outputs @ reached[:, rigid]
    size = np.linalg.norm(outputs, axis=1)
    is_rotation = np.linalg.norm(of_rigid, axis=1) > _REACHED * np.where(size > 0.0, size, 1.0)
    joint_basis = np.linalg.pinv(seen)
    joint_basis[:, is_rotation] = 0.0
    joint_basis[np.ix_(np.flatnonzero(rigid), np.flatnonzero(is_rotation))] = np.linalg.pinv(
        of_rigid[is_rotation]
    )
    if not np.allclose(seen @ joint_basis, np.eye(len(seen)), atol=1e-6):
        off = int(np.argmax(abs(seen @ joint_basis - np.eye(len(seen))).max(axis=0)))
        raise BadInput(
            f"{model.joint_names[off]} does not move independently of the other joints "
            f"({', '.join(model.joint_names)}), so no linear law of full state can be designed; "
            "take pd_feedforward"
        )
    basis = reached @ np.hstack((joint_basis, null_space(seen)))
    _, sizes, right = np.linalg.svd(JointCoordinates(linear, outputs, basis).elastic(model.modes))
    if sizes.size == len(right) and sizes.min(initial=1.0) > _LEAST_DEFLECTION * sizes.max(
        initial=1.0
    ):
        basis[:, len(seen) :] @= right.T / sizes
    return JointCoordinates(linear, outputs, basis)


def reduced_model(model: Model, found: JointCoordinates) -> LinearModel:
    """Return the small motions in these coordinates."""
    linear, basis, tips = found.linear, found.basis, model.appendages
    elastic, modes = found.elastic(model.modes), slice(model.before_modes, None)
    return LinearModel(
        model.joint_names,
        Linearisation(
            _symmetric(basis.T @ linear.mass @ basis),
            basis.T @ linear.damping @ basis,
            basis.T @ linear.stiffness @ basis,
            basis.T @ linear.input_matrix,
        ),
        Appendages(tips.names, tips.tip @ elastic, tips.curvature @ elastic),
        elastic.T @ linear.mass[modes, modes] @ elastic,
    )


def _symmetric(a: Matrix) -> Matrix:
    """Return a without the rounding that makes it unsymmetric."""
    symmetric: Matrix = 0.5 * (a + a.T)
    return symmetric


def rate_outputs(model: Model, rest: Vector) -> Matrix:
    """Return C: what each joint's rate sensor reads of every entry of v, shape (joints, n)."""
    columns = [
        model.joint_state(np.concatenate((rest, one)))[1] for one in np.eye(model.coordinates)
    ]
    return np.array(columns).T


def _reached(linear: Linearisation) -> tuple[Matrix, Vector]:
    """Return a basis of the motions that efforts reach, (n, r), and which of it are rigid, (r,).

    Modes of one frequency are turned among themselves such that as few as possible are reached.
    """
    stiffness = _symmetric(linear.stiffness)
    squares, modes = eigh(stiffness, _symmetric(linear.mass))
    largest = float(abs(squares).max(initial=1e-300))
    squares[abs(squares) <= _RIGID * largest] = 0.0
    mode_inputs = modes.T @ linear.input_matrix
    scale = float(np.linalg.norm(mode_inputs, axis=0).min())
    kept, rigid = [], []
    first = 0
    for k in range(1, len(squares) + 1):
        if k < len(squares) and squares[k] - squares[first] <= _SAME * largest:
            continue
        left, sizes, _ = np.linalg.svd(mode_inputs[first:k])
        count = int((sizes > _REACHED * scale).sum())
        kept.append(modes[:, first:k] @ left[:, :count])
        rigid += [squares[first] == 0.0] * count
        first = k
    return np.hstack(kept), np.array(rigid)


def nominal_states(model: LinearDesignModel, references: list[Reference]) -> Matrix:
    """Return the nominal states at N references, shape (N, 2 n); see nominal."""
    positions = np.array([one.position for one in references])
    velocities = np.array([one.velocity for one in references])
    sizes = np.array([one.state.size for one in references])
    found = np.empty((len(references), 2 * model.coordinates))
    for size in set(sizes.tolist()):
        rows = np.flatnonzero(sizes == size)
        state = np.array([references[k].state for k in rows])
        some = Reference(positions[rows], velocities[rows], EMPTY, state)
        found[rows] = nominal(model, some)
    return found


def nominal(model: LinearDesignModel, reference: Reference) -> Vector:
    """Return the nominal state as a law with this model sees it, shape (2 n,).

    About a free platform it is that of the joints: a plan about one axis determines nothing else
    in these coordinates.
    """
    state = EMPTY if isinstance(model, LinearModel) else reference.state
    return nominal_state(state, reference, model.joints, model.modes)
