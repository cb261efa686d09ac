"""Weights of one feedforward that keeps efforts and joints of an ensemble within bounds.

They minimise
    sum_i |W_i^(1/2) Y_i(U)|^2 / members + rho |U|^2 + price^2 sum (distance beyond the bounds)^2,
the last sum over the efforts, and where they are bounded the joint positions, of every member at
every edge of the integration. All are linearised at every update; what is left is convex and
quadratic piece by piece, and is solved exactly, by Newton's method on what is beyond its bound.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from flexslew_control.planners.feedforward.basis import Basis
from flexslew_control.planners.feedforward.ensemble import FeedforwardMember
from flexslew_control.planners.feedforward.manoeuvre import TerminalMap, substeps_for
from flexslew_control.planners.progress import Progress, Update
from flexslew_plant.arrays import Matrix, Vector
from flexslew_plant.errors import PlanFailed

PRICE = 0.01  # of effort beyond its limit [m/(N m)]
_STIFFNESS = 1e3  # of a joint beyond its range, that costs like a torque [N m/rad]
_EDGES = 4  # of the integration in each piece of the basis, so that no peak is missed
_HALVINGS = 12  # of a step that makes things worse
_BISECTIONS = 50  # of a step of the convex problem
_INNER = 50  # Newton steps on one linearisation
_CONVERGED = 1e-9  # relative gain at which a linearisation counts as solved


@dataclass(frozen=True)
class Problem:
    """What is minimised.

    Args:
        members: the ensemble.
        basis: of the feedforward.
        rho: what torque costs [1/(N m)^2].
        effort_limit: that the efforts keep to, shape (joints,) [N m].
        joint_range: lowest and highest positions, shape (2, joints) [rad or m]; None: free.
        price: of effort beyond its limit [m/(N m)].
    """

    members: Sequence[FeedforwardMember]
    basis: Basis
    rho: float
    effort_limit: Vector
    joint_range: Matrix | None = None
    price: float = PRICE

    @property
    def maps(self) -> list[TerminalMap]:
        """Return every member's terminal error as a function of the weights, on one grid."""
        slews = [member.manoeuvre for member in self.members]
        substeps = max(_EDGES, *(substeps_for(slew, self.basis) for slew in slews))
        return [TerminalMap(slew, self.basis, substeps) for slew in slews]

    def bounded(self, at: TerminalMap, weights: Vector) -> Vector:
        """Return what has bounds, along the path of the last terminal_error, edge by edge [N m].

        Efforts, then positions as the torques of stiff springs where they are bounded.
        """
        efforts = at.efforts(weights)
        if self.joint_range is None:
            return efforts.ravel()
        return np.hstack((efforts, _STIFFNESS * at.positions)).ravel()

    def slopes(self, at: TerminalMap) -> tuple[Matrix, Matrix]:
        """Return the derivatives of the terminal error and of bounded, (2 n, N_U), (rows, N_U)."""
        g, efforts, positions = at.sensitivities()
        if self.joint_range is not None:
            efforts = np.concatenate((efforts, _STIFFNESS * positions), axis=1)
        return g, efforts.reshape(-1, g.shape[1])

    def limit_excess(self, bounded: Vector) -> Vector:
        """Return how far what has bounds is beyond them [N m]."""
        low, high = -self.effort_limit, self.effort_limit
        if self.joint_range is not None:
            low = np.concatenate((low, _STIFFNESS * self.joint_range[0]))
            high = np.concatenate((high, _STIFFNESS * self.joint_range[1]))
        rows = bounded.reshape(-1, low.size)
        return np.asarray(rows - np.clip(rows, low, high)).ravel()

    def cost(self, weights: Vector, y: Vector, bounded: Vector) -> float:
        """Return the objective of weights that lead to the vibrations y and to `bounded`."""
        excess = self.limit_excess(bounded)
        value = y @ y + self.rho * (weights @ weights) + self.price**2 * (excess @ excess)
        return float(value) if np.isfinite(value) else np.inf


def limited_gauss_newton(
    problem: Problem, max_iterations: int, tolerance: float, progress: Progress
) -> list[tuple[Vector, Update]]:
    """Return the weights U of every update, the last ones optimal.

    Args:
        problem: what is minimised.
        max_iterations: updates before it is given up.
        tolerance: relative gain of the objective at which it has settled.
        progress: called with every update.

    Raises:
        PlanFailed: it does not settle.
    """
    members, basis, maps = problem.members, problem.basis, problem.maps
    factors = [member.weight / np.sqrt(len(members)) for member in members]

    def simulate(weights: Vector) -> tuple[Vector, Vector]:
        y, bounded = [], []
        for scale, at in zip(factors, maps, strict=True):
            y.append(scale @ at.terminal_error(weights))
            bounded.append(problem.bounded(at, weights))
        return np.concatenate(y), np.concatenate(bounded)

    def slopes() -> tuple[Matrix, Matrix]:
        found = [problem.slopes(at) for at in maps]
        g = np.vstack([scale @ rows for scale, (rows, _) in zip(factors, found, strict=True)])
        return g, np.vstack([rows for _, rows in found])

    u = np.zeros(basis.functions * members[0].manoeuvre.model.joints)
    at_u = simulate(u)
    cost = problem.cost(u, *at_u)
    history: list[tuple[Vector, Update]] = []
    for k in range(max_iterations):
        step, expected_gain = _best_step(problem, u, at_u, slopes())
        for _ in range(_HALVINGS):
            new = simulate(u + step)
            value = problem.cost(u + step, *new)
            if value <= cost:
                break
            step = 0.5 * step
        else:
            if expected_gain > tolerance * cost:
                break
            # the best step gains less than rounding hides: u is optimal
            if not history:
                error = float(np.linalg.norm(at_u[0]))
                history.append((u, Update(1, cost, error, float(np.linalg.norm(u)), 0.0, True)))
            return history
        u, at_u, gain, cost = u + step, new, cost - value, value
        size, error = float(np.linalg.norm(u)), float(np.linalg.norm(at_u[0]))
        change = float(np.linalg.norm(step)) / max(size, 1e-300)
        history.append((u, Update(k + 1, cost, error, size, change, True)))
        progress(history[-1][1])
        if gain <= tolerance * cost:
            return history
    reached = f"relative change {history[-1][1].change:.1e}" if history else "no step helps"
    raise PlanFailed(
        f"the ensemble did not settle after {len(history)} updates: {reached}; use a longer "
        f"duration than {basis.duration:g} s or a larger rho than {problem.rho:g}"
    )


def _least_part(slope_positive: Callable[[float], bool]) -> float:
    """Return the part of a step at which a convex function of it is least, by bisection.

    Args:
        slope_positive: whether the function rises at a part of the step; at 1 it does.
    """
    low, high = 0.0, 1.0
    for _ in range(_BISECTIONS):
        middle = 0.5 * (low + high)
        low, high = (low, middle) if slope_positive(middle) else (middle, high)
    return low


def _best_step(
    problem: Problem,
    weights: Vector,
    at_weights: tuple[Vector, Vector],
    slopes: tuple[Matrix, Matrix],
) -> tuple[Vector, float]:
    """Return the change of the weights that is best for the linearised ensemble, and its gain."""
    (y, bounded), (g, t) = at_weights, slopes
    quadratic = g.T @ g
    quadratic.flat[:: weights.size + 1] += problem.rho
    linear = g.T @ y + problem.rho * weights
    step = np.zeros(weights.size)
    initial = cost = problem.cost(weights, y, bounded)
    for _ in range(_INNER):
        excess = problem.limit_excess(bounded + t @ step)
        active = t[excess != 0.0]
        slope = linear + quadratic @ step + problem.price**2 * (active.T @ excess[excess != 0.0])
        direction = -np.linalg.solve(quadratic + problem.price**2 * (active.T @ active), slope)

        def slope_positive(part: float, direction: Vector = direction, step: Vector = step) -> bool:
            new = step + part * direction
            excess = problem.limit_excess(bounded + t @ new)
            gradient = linear + quadratic @ new + problem.price**2 * (t.T @ excess)
            return bool(gradient @ direction > 0.0)

        new = step + (_least_part(slope_positive) if slope_positive(1.0) else 1.0) * direction
        value = problem.cost(weights + new, y + g @ new, bounded + t @ new)
        if value > cost:
            break
        step, gain, cost = new, cost - value, value
        if gain <= _CONVERGED * cost:
            break
    return step, initial - cost
