"""What a linear model predicts over a horizon, as one dense quadratic program per tick.

x(k + 1) = F x(k) + G v(k), k = 0 ... N - 1, with the states taken out (condensed; Maciejowski 2002,
Predictive Control with Constraints, 2.6): minimise over V the sum of |x(k + 1) - x*(k + 1)|^2_Q(k)
and |v(k) - v*(k)|^2_R under lower <= V <= upper and rows of C X, which are soft.
"""

from typing import Any, NamedTuple

import numpy as np
from scipy.linalg import LinAlgError

from flexslew_control.linear.riccati import discrete_riccati
from flexslew_plant.arrays import Matrix, Vector
from flexslew_plant.errors import BadInput

_ACTIVE, _LOWER, _SOFT = 1, 2, 8  # of DAQP's `sense`
_SOFT_FLAG = 2  # its exit flag: optimal, with a soft limit passed


class Costs(NamedTuple):
    """The weights of every step."""

    state: Matrix  # Q, (k, k)
    effort: Matrix  # R, (m, m)
    last: Matrix  # of the last state: P of the regulator with Q and R, (k, k)


def horizon(f: Matrix, g: Matrix, steps: int) -> Matrix:
    """Return how N steps of a state follow from the efforts V, by condensed prediction.

    X = what it does without efforts + forced V; forced has the shape (N k, N m).

    Args:
        f: of one step, shape (k, k).
        g: of its efforts, shape (k, m).
        steps: N.
    """
    k, m = g.shape
    powers = [np.eye(k)]
    for _ in range(steps):
        powers.append(f @ powers[-1])
    forced = np.zeros((steps * k, steps * m))
    for i in range(steps):
        for j in range(i + 1):
            forced[i * k : (i + 1) * k, j * m : (j + 1) * m] = powers[i - j] @ g
    return forced


def varying_horizon(steps: list[tuple[Matrix, Matrix]]) -> Matrix:
    """Return the same of steps that differ, shape (N k, N m).

    Args:
        steps: F and G of each.
    """
    n, (k, m) = len(steps), steps[0][1].shape
    forced = np.zeros((n, k, n, m))
    for i, (f, g) in enumerate(steps):
        if i:
            forced[i] = (f @ forced[i - 1].reshape(k, -1)).reshape(k, n, m)
        forced[i, :, i] = g
    return forced.reshape(n * k, n * m)


def costs(f: Matrix, g: Matrix, state: Matrix, effort: Matrix) -> Costs:
    """Return the weights, with what follows the horizon under the regulator in the last one.

    Raises:
        BadInput: there is no regulator with these weights.
    """
    try:
        last = discrete_riccati(f, g, state, effort)
    except LinAlgError as error:
        raise BadInput(f"weights: no optimal regulator: {error}; weigh every mode") from None
    return Costs(state, effort, 0.5 * (last + last.T))


class Solved(NamedTuple):
    """The answer of one tick."""

    efforts: Matrix  # V, shape (N, m)
    iterations: int
    softened: bool  # whether a soft row had to be passed
    optimal: bool  # else the iterations did not suffice, and the efforts are not to be used


class Program:
    """The quadratic program with some of its steps weighed less, ready for any tick.

    Args:
        forced: of the horizon, shape (N k, N m).
        costs: of each step.
        weight_factors: factor of the weights of each step's state, shape (N,).
        size: of each effort, by which the variables are divided, shape (m,).
        hard: rows H of H V, shape (r, N m).
        soft: rows C of C X, shape (s, N k).
        iterations: at most, in a tick.
    """

    def __init__(
        self,
        forced: Matrix,
        costs: Costs,
        weight_factors: Vector,
        size: Vector,
        hard: Matrix,
        soft: Matrix,
        iterations: int,
    ) -> None:
        n, k = len(weight_factors), len(costs.state)
        self._n = n
        self._size = np.tile(size, n)
        state = weight_factors[:, None, None] * np.array([costs.state] * (n - 1) + [costs.last])
        weighted = np.einsum("nij,njv->niv", state, forced.reshape(n, k, -1))
        self._weighted, self._r = weighted.reshape(n * k, -1), costs.effort  # Q Forced, R
        hessian = forced.T @ self._weighted + np.kron(np.eye(n), self._r)
        hessian = self._size[:, None] * (0.5 * (hessian + hessian.T)) * self._size
        self._scale = float(np.abs(hessian).max())
        self.soft = soft @ forced  # how the soft rows change with V, (s, N m)
        self._rows = np.vstack((hard, self.soft)) * self._size
        # rows of one size, as the solver's tolerance is absolute
        row_size = np.abs(self._rows).max(axis=1, initial=0.0)
        row_size[row_size == 0.0] = 1.0
        self._hessian = hessian / self._scale
        self._rows = self._rows / row_size[:, None]
        self._limit_size = np.concatenate((self._size, row_size))
        self._sense = np.zeros(n * len(size) + len(self._rows), dtype=np.int32)
        self._sense[len(self._sense) - len(soft) :] = _SOFT
        self._iterations = iterations
        self._model: Any = None

    def __deepcopy__(self, memo: dict[int, Any]) -> "Program":
        """Return one with the same matrices and a solver of its own."""
        other = object.__new__(Program)
        other.__dict__ = self.__dict__ | {"_model": None}
        return other

    def prepare(self) -> None:
        """Factorise, so that the first tick need not."""
        if self._model is None:
            import daqp  # for this law alone

            self._model = daqp.Model()
            unbounded = np.full(len(self._sense), 1e20)
            self._model.setup(
                self._hessian,
                np.zeros(len(self._size)),
                self._rows,
                unbounded,
                -unbounded,
                self._sense,
            )
            self._model.settings = {"iter_limit": self._iterations}

    def solve(
        self,
        free_response: Matrix,
        requested: Matrix,
        lower: Vector,
        upper: Vector,
        active: Vector,
    ) -> tuple[Solved, Vector]:
        """Return the answer, and which limits hold it, for the next tick's start.

        Args:
            free_response: x(1 ... N) - x* with V = 0, shape (N, k).
            requested: v*, shape (N, m).
            lower: of V, of the hard rows, then of the soft ones' C (X - X with V = 0).
            upper: the same.
            active: of the limits at the start: 1 at the upper, -1 at the lower, else 0.
        """
        self.prepare()
        pull = free_response.ravel() @ self._weighted
        pull -= (requested @ self._r).ravel()
        if not (np.isfinite(pull).all() and np.isfinite(lower).all() and np.isfinite(upper).all()):
            return Solved(np.zeros_like(requested), 0, False, False), active  # it has run away
        start = (
            self._sense
            | np.where(active > 0, _ACTIVE, 0)
            | np.where(active < 0, _ACTIVE | _LOWER, 0)
        )
        self._model.update(
            f=self._size * pull / self._scale,
            bupper=upper / self._limit_size,
            blower=lower / self._limit_size,
            sense=start.astype(np.int32),
        )
        found, _, flag, info = self._model.solve()
        efforts = (np.asarray(found) * self._size).reshape(self._n, -1)
        solved = Solved(efforts, int(info["iterations"]), flag == _SOFT_FLAG, flag > 0)
        return solved, np.sign(np.asarray(info["lam"]))
