"""Thrusters: a torque as pushes of one-way drives, with the least propellant."""

from dataclasses import dataclass
from functools import cached_property
from itertools import combinations
from typing import NamedTuple

import numpy as np

from flexslew_plant.arrays import Indices, Matrix, Tensor, Vector, compiled_once
from flexslew_plant.errors import BadInput

_SLACK = 1e-9  # of the largest push: rounding of one that is zero
_EQUAL = 1e-9  # of a sum of pushes: rounding of two that are as good
_FLAT = 1e-6  # determinant of three unit levers that count as in one plane


class ThrusterNumbers(NamedTuple):
    """Sets of thrusters side by side for machine code, a row each; none: no thrusters."""

    limit: Matrix  # (members, thrusters) [N]
    thruster_indices: Indices  # which three push together, (sets, 3), the same in all members
    inverse: Tensor  # of their levers, (members, sets, 3, 3) [1/m]


NO_THRUSTERS = ThrusterNumbers(
    np.zeros((1, 0)), np.zeros((0, 3), dtype=np.int64), np.zeros((1, 0, 3, 3))
)


@dataclass(frozen=True)
class ThrusterSet:
    """The u of A u = T, u >= 0, with the least sum of u.

    A linear program with three rows has a solution with at most three thrusters on, so the sets
    of three are tried with inverses that are known beforehand. Of equally good ones the mean is
    taken, so that thrusters in pairs push together. Beyond the limits all pushes are scaled, which
    keeps the direction of the torque.

    Args:
        torque: A, of a unit push, shape (3, thrusters) [m].
        limit: largest pushes, shape (thrusters,) [N].
    """

    torque: Matrix
    limit: Vector
    _thruster_indices: Indices
    _inverse: Tensor

    @classmethod
    def of(cls, torque: Matrix, limit: Vector, names: tuple[str, ...]) -> "ThrusterSet":
        """Return the set of these thrusters.

        Raises:
            BadInput: some torque cannot be given.
        """
        size = np.linalg.norm(torque, axis=0)
        known = np.flatnonzero(size > 0.0)
        indices = np.array(list(combinations(known.tolist(), 3)), dtype=np.int64).reshape(-1, 3)
        subsets = torque[:, indices].transpose(1, 0, 2)
        volume = abs(np.linalg.det(subsets)) / size[indices].prod(axis=1)
        indices, subsets = indices[volume > _FLAT], subsets[volume > _FLAT]
        found = cls(torque, limit, indices, np.linalg.inv(subsets))
        missing = found.missing()
        if missing is not None:
            words = f"no torque along {np.round(missing, 3).tolist()} can be given; add thrusters"
            raise BadInput(words, key="allocation.drives", value=", ".join(names))
        return found

    @cached_property
    def numbers(self) -> ThrusterNumbers:
        """The set for machine code, in a batch of one."""
        inverse = np.ascontiguousarray(self._inverse)
        return ThrusterNumbers(self.limit[None], self._thruster_indices, inverse[None])

    def missing(self) -> Vector | None:
        """Return a direction in which they give no torque; None: there is none.

        They give every torque just where they give those opposite to each of three that span
        space: the cone of all torques is convex, and holds each lever already.
        """
        if not len(self._thruster_indices):
            return np.array([1.0, 0.0, 0.0])
        for column in self.torque[:, self._thruster_indices[0]].T:
            direction: Vector = -column / np.linalg.norm(column)
            if _negative_fraction(self._inverse @ direction).min() > _SLACK:
                return direction
        return None

    def efforts(self, torque: Vector) -> Vector:
        """Return the pushes that give a torque or, beyond the limits, the most of it along it.

        Args:
            torque: about the centre of mass, shape (3,) [N m].

        Returns:
            shape (thrusters,) [N].
        """
        out = np.empty(self.limit.size)
        thruster_efforts(self.numbers, 0, torque, out)
        return out


@compiled_once("out")
def thruster_efforts(thrusters: ThrusterNumbers, member: int, torque: Vector, out: Vector) -> None:
    """Write the pushes of a set of thrusters; see ThrusterSet.pushes.

    Args:
        thrusters: of some members.
        member: which of them counts.
        torque: shape (3,).
        out: shape (thrusters,).
    """
    for i in range(out.size):
        out[i] = 0.0
    if torque[0] == 0.0 and torque[1] == 0.0 and torque[2] == 0.0:
        return
    subsets = thrusters.thruster_indices.shape[0]
    forces, negative, cost = np.empty((subsets, 3)), np.empty(subsets), np.empty(subsets)
    for s in range(subsets):
        least, most, cost[s] = np.inf, 0.0, 0.0
        for i in range(3):
            push = 0.0
            for j in range(3):
                push += thrusters.inverse[member, s, i, j] * torque[j]
            forces[s, i] = push
            least, most, cost[s] = min(least, push), max(most, abs(push)), cost[s] + push
        negative[s] = -least / most
    cost = np.where(negative <= max(_SLACK, negative.min()), cost, np.inf)
    is_best = cost <= cost.min() * (1.0 + _EQUAL)
    count = is_best.sum()
    for s in range(subsets):
        if is_best[s]:
            for i in range(3):
                out[thrusters.thruster_indices[s, i]] += max(forces[s, i], 0.0) / count
    share = 1.0
    for i in range(out.size):
        if out[i] > 0.0:
            share = min(share, thrusters.limit[member, i] / out[i])
    for i in range(out.size):
        out[i] *= share


def _negative_fraction(forces: Matrix) -> Vector:
    """Return the largest negative push of each set, of its largest push, shape (sets,) [-]."""
    return np.asarray(-forces.min(axis=1) / abs(forces).max(axis=1))
