"""Thrusters: a torque as pushes of one-way drives, with the least propellant."""

from dataclasses import dataclass
from itertools import combinations

import numpy as np

from flexslew_plant.arrays import Indices, Matrix, Tensor, Vector
from flexslew_plant.errors import BadInput

_SLACK = 1e-9  # of the largest push: rounding of one that is zero
_EQUAL = 1e-9  # of a sum of pushes: rounding of two that are as good
_FLAT = 1e-6  # determinant of three unit levers that count as in one plane


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
    _triples: Indices
    _inverses: Tensor

    @classmethod
    def of(cls, torque: Matrix, limit: Vector, names: tuple[str, ...]) -> "ThrusterSet":
        """Return the set of these thrusters.

        Raises:
            BadInput: some torque cannot be given.
        """
        size = np.linalg.norm(torque, axis=0)
        known = np.flatnonzero(size > 0.0)
        triples = np.array(list(combinations(known.tolist(), 3)), dtype=np.int64).reshape(-1, 3)
        sets = torque[:, triples].transpose(1, 0, 2)
        volume = abs(np.linalg.det(sets)) / size[triples].prod(axis=1)
        triples, sets = triples[volume > _FLAT], sets[volume > _FLAT]
        found = cls(torque, limit, triples, np.linalg.inv(sets))
        missing = found.missing()
        if missing is not None:
            words = f"no torque along {np.round(missing, 3).tolist()} can be given; add thrusters"
            raise BadInput(words, key="allocation.drives", value=", ".join(names))
        return found

    def missing(self) -> Vector | None:
        """Return a direction in which they give no torque; None: there is none.

        They give every torque just where they give those opposite to each of three that span
        space: the cone of all torques is convex, and holds each lever already.
        """
        if not len(self._triples):
            return np.array([1.0, 0.0, 0.0])
        for column in self.torque[:, self._triples[0]].T:
            opposite: Vector = -column / np.linalg.norm(column)
            if _backwards(self._inverses @ opposite).min() > _SLACK:
                return opposite
        return None

    def pushes(self, torque: Vector) -> Vector:
        """Return the pushes that give a torque or, beyond the limits, the most of it along it.

        Args:
            torque: about the centre of mass, shape (3,) [N m].

        Returns:
            shape (thrusters,) [N].
        """
        out = np.zeros(self.limit.size)
        if not torque.any():
            return out
        pushes = self._inverses @ torque
        backwards = _backwards(pushes)
        allowed = max(_SLACK, float(backwards.min()))
        cost = np.where(backwards <= allowed, pushes.sum(axis=1), np.inf)
        best = np.flatnonzero(cost <= cost.min() * (1.0 + _EQUAL))
        np.add.at(out, self._triples[best], np.maximum(pushes[best], 0.0) / best.size)
        return out * min(1.0, float((self.limit[out > 0.0] / out[out > 0.0]).min(initial=1.0)))


def _backwards(pushes: Matrix) -> Vector:
    """Return the largest negative push of each set, of its largest push, shape (sets,) [-]."""
    return np.asarray(-pushes.min(axis=1) / abs(pushes).max(axis=1))
