"""Modes of a bench from its record, by maximum likelihood: variable projection.

Every output is linear in residues and initial conditions once frequencies and damping ratios are
given (Golub and Pereyra 1973):

    y_o(t) = a + b t + sum_a R0_oa iint u_a + sum_i sum_a R_ioa q_ia(t) + free motion of mode i,
    q_ia'' + 2 zeta_i w_i q_ia' + w_i^2 q_ia = u_a,

with the efforts u that were really applied, held over every tick, as input. They are known
exactly, so nothing is biased by the feedback that made them: the errors of the fit are the
sensors' noise alone (the direct method with the true noise model, Pintelon and Schoukens, chapter
9). A rate sensor sees the derivative with the same residues; a deflection has no rigid part.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from scipy.linalg import LinAlgError, cho_factor, cho_solve

from flexslew_lab.identification.oscillators import Oscillator, double_integral, times
from flexslew_lab.identification.record import Quantity, Record
from flexslew_plant.arrays import Matrix, Vector

_STEP = 1e-6  # relative, of the differences with respect to frequency
_DAMPING_STEP = 1e-6
_ROUNDS = 30
_RIDGE = 1e-13
_CONVERGED = 1e-4  # of a step, in standard deviations


@dataclass(frozen=True)
class ModalFit:
    """What a record says about the modes, with covariances.

    Args:
        modes: oscillators in rising order of frequency, (modes,).
        covariance: of (w_1, zeta_1, w_2, ...), (2 modes, 2 modes).
        residues: R_i, displacement of each output per unit of each modal force, shape
            (modes, displacements, inputs); displacements are joint positions, then deflections.
        inverse_inertia: R0 of the joints, (joints, inputs) [1/(kg m^2) or 1/kg].
        inverse_inertia_covariance: of its entries row by row.
        noise: standard deviation of every output, (outputs,).
        residual: measured minus fitted, (ticks + 1, outputs).
        parameters: how many numbers were fitted.
    """

    modes: tuple[Oscillator, ...]
    covariance: Matrix
    residues: np.ndarray
    inverse_inertia: Matrix
    inverse_inertia_covariance: Matrix
    noise: Vector
    residual: Matrix
    parameters: int

    @property
    def criterion(self) -> float:
        """Bayesian information criterion: smaller is better."""
        n = self.residual.size
        rows = len(self.residual)
        return float(2.0 * rows * np.log(self.noise).sum() + self.parameters * np.log(n))


@dataclass(frozen=True)
class _Group:
    """Outputs that share residues: a joint's position and rate, or one deflection."""

    position: int  # column of the record; -1: not measured
    rate: int  # the same
    rigid: bool


def _groups(record: Record) -> tuple[_Group, ...]:
    found = []
    rates = {o.joint: k for k, o in enumerate(record.outputs) if o.quantity is Quantity.JOINT_RATE}
    for k, o in enumerate(record.outputs):
        if o.quantity is Quantity.JOINT_POSITION:
            found.append(_Group(k, rates.pop(o.joint, -1), True))
    found += [_Group(-1, k, True) for k in rates.values()]
    found += [_Group(k, -1, False) for k in record.columns(Quantity.DEFLECTION)]
    found += [_Group(-1, k, False) for k in record.columns(Quantity.DEFLECTION_RATE)]
    return tuple(found)


class ModalLeastSquares:
    """The separable problem of one record.

    Args:
        record: of the experiment.
        noise: standard deviation of every output, (outputs,).
    """

    def __init__(self, record: Record, noise: Vector) -> None:
        self.record, self.noise = record, noise
        self.groups = _groups(record)
        h, ticks = record.period, record.ticks
        t = times(ticks, h) / record.duration
        one = np.ones_like(t)
        self._slope = 1.0 / record.duration
        self._constant = one[:, None]
        self._line = np.column_stack((one, t))
        self._rigid = double_integral(record.effort, h)

    def solve(self, modes: tuple[Oscillator, ...], slopes: bool = True) -> "Solution":
        """Return the best residues for these modes and the residual.

        Args:
            modes: frequencies and damping ratios.
            slopes: whether those of the residual are needed, too.
        """
        h = self.record.period
        columns = [_responses(mode, self.record.effort, h) for mode in modes]
        moved = [
            [_difference(self.record.effort, h, one) for one in _neighbours(mode)]
            for mode in (modes if slopes else ())
        ]
        bases: dict[tuple[bool, bool, bool, float], _Basis] = {}
        parts = []
        for group in self.groups:
            kind = (group.rigid, group.position >= 0, group.rate >= 0, self._ratio(group))
            if kind not in bases:
                bases[kind] = self._basis(group, columns, moved)
            parts.append(self._part(group, bases[kind]))
        return Solution(self, modes, parts)

    def _ratio(self, group: _Group) -> float:
        """Return the weight of a group's rate beside its position."""
        both = group.position >= 0 and group.rate >= 0
        return float(self.noise[group.position] / self.noise[group.rate]) if both else 1.0

    def _rows(self, group: _Group) -> list[tuple[int, int, float]]:
        """Return column of the record, derivative and weight of each quantity of a group."""
        rows = [(group.position, 0, 1.0)] if group.position >= 0 else []
        return rows + ([(group.rate, 1, self._ratio(group))] if group.rate >= 0 else [])

    def _basis(
        self,
        group: _Group,
        columns: "list[tuple[Matrix, Matrix]]",
        moved: "list[list[tuple[Matrix, Matrix]]]",
    ) -> "_Basis":
        rows = self._rows(group)
        phi = np.vstack([w * self._matrix(group, columns, which) for _, which, w in rows])
        scale = np.sqrt(np.einsum("ij,ij->j", phi, phi))
        scale[scale == 0.0] = 1.0
        phi /= scale
        projection = Projection(phi)
        if not moved:
            empty = np.zeros((len(phi), 0))
            return _Basis(phi, scale, projection, empty, np.zeros((phi.shape[1], 0)))
        raw = np.vstack(
            [w * np.hstack([d[which] for pair in moved for d in pair]) for _, which, w in rows]
        )
        along = projection.coordinates(raw)
        return _Basis(phi, scale, projection, raw - phi @ along, along)

    def _part(self, group: _Group, basis: "_Basis") -> "_Part":
        rows = self._rows(group)
        sigma = float(self.noise[rows[0][0]])
        y = np.concatenate([w * self.record.measured[:, column] for column, _, w in rows])
        weights, residual = basis.projection.solve(y)
        c, width = weights / basis.scale, self.record.effort.shape[1] + 2
        count = basis.turned.shape[1] // width  # two for each mode
        own = np.zeros((basis.turned.shape[1], count))
        for k in range(count):
            first = len(c) - (count // 2 - k // 2) * width
            own[k * width : (k + 1) * width, k] = c[first : first + width]
        return _Part(
            group,
            c,
            sigma,
            basis,
            residual / sigma,
            own.T @ (basis.turned.T @ residual) / sigma**2,
            own.T @ basis.products @ own / sigma**2,
            basis.along @ own,
        )

    def prediction_error(self, fit: "ModalFit") -> Matrix:
        """Return what the modes of another record leave of this one, (ticks + 1, outputs).

        Bias and the motion before the record are this record's own; all else is the other's.
        """
        h, inputs = self.record.period, self.record.effort.shape[1]
        columns = [_responses(mode, self.record.effort, h) for mode in fit.modes]
        left = np.empty_like(self.record.measured)
        joint, row = 0, 0
        for group in self.groups:
            for column, which in ((group.position, 0), (group.rate, 1)):
                if column < 0:
                    continue
                away = self.record.measured[:, column].copy()
                if group.rigid:
                    away -= self._rigid[which] @ fit.inverse_inertia[joint]
                own = [self._line if which == 0 and group.rigid else self._constant]
                for mode, pair, residues in zip(fit.modes, columns, fit.residues, strict=True):
                    away -= pair[which][:, :inputs] @ (residues[row] / mode.frequency**2)
                    own.append(pair[which][:, inputs:])
                free = np.hstack(own)
                free /= np.sqrt(np.einsum("ij,ij->j", free, free))
                left[:, column] = Projection(free).solve(away)[1]
            row += group.position >= 0
            joint += group.rigid and group.position >= 0
        return left

    def _matrix(self, group: _Group, columns: "list[tuple[Matrix, Matrix]]", which: int) -> Matrix:
        """Return the columns of a position (which 0) or a rate (1): bias, rigid, then modes."""
        if which == 0:
            bias = self._line if group.rigid else self._constant
            bias = np.hstack((bias, np.zeros_like(self._constant))) if group.rate >= 0 else bias
        else:  # the derivative of the line, and the sensor's own bias
            bias = (
                np.hstack((0.0 * self._constant, self._slope * self._constant, self._constant))
                if group.position >= 0
                else self._constant
            )
        rigid = [self._rigid[which]] if group.rigid else []
        return np.hstack([bias, *rigid, *(pair[which] for pair in columns)])


class Projection:
    """Least squares on the columns of a tall matrix, by Cholesky's factor of its Gram matrix.

    One correction with the residual brings back what squaring the condition number costs (corrected
    semi-normal equations, Bjorck 1987).

    Args:
        columns: of unit length, (rows, n).
    """

    def __init__(self, columns: Matrix) -> None:
        self._columns = columns
        gram = columns.T @ columns
        try:
            self._factor = cho_factor(gram)
        except LinAlgError:  # columns that depend on one another
            self._factor = cho_factor(gram + _RIDGE * np.eye(len(gram)))

    def coordinates(self, right: Matrix) -> Matrix:
        """Return the least-squares weights of the columns, (n, ...)."""
        return np.asarray(cho_solve(self._factor, self._columns.T @ right))

    def solve(self, right: Vector) -> tuple[Vector, Vector]:
        """Return the weights and the residual."""
        weights = self.coordinates(right)
        weights = weights + self.coordinates(right - self._columns @ weights)
        return weights, right - self._columns @ weights

    @property
    def inverse(self) -> Matrix:
        """Of the Gram matrix, (n, n)."""
        return np.asarray(cho_solve(self._factor, np.eye(self._columns.shape[1])))


@dataclass(frozen=True)
class _Basis:
    """What groups with the same quantities and weights share."""

    columns: Matrix  # of unit length
    scale: Vector  # lengths that they had
    projection: Projection
    turned: Matrix  # d(columns of the modes)/d(nonlinear), orthogonal to the columns
    along: Matrix  # weights of the columns in it

    @cached_property
    def products(self) -> Matrix:
        """Of the turned columns with one another."""
        return np.asarray(self.turned.T @ self.turned)


@dataclass(frozen=True)
class _Part:
    """The solution of one group."""

    group: _Group
    weights: Vector  # linear parameters
    sigma: float  # standard deviation of the first quantity's noise
    basis: _Basis
    residual: Vector  # in standard deviations
    downhill: Vector  # J^T r
    information: Matrix  # J^T J
    along: Matrix  # d(linear)/d(nonlinear) of the scaled columns, negative


@dataclass(frozen=True)
class Solution:
    """Residues, residual and slopes for given modes."""

    problem: ModalLeastSquares
    modes: tuple[Oscillator, ...]
    parts: list[_Part]

    @property
    def cost(self) -> float:
        """Half the squared residual, in standard deviations."""
        return float(0.5 * sum(part.residual @ part.residual for part in self.parts))

    @property
    def information(self) -> Matrix:
        """J^T J of frequencies and damping ratios with the residues eliminated."""
        size = 2 * len(self.modes)
        total: Matrix = sum((p.information for p in self.parts), np.zeros((size, size)))
        return total

    @property
    def gradient(self) -> Vector:
        """Of the cost, downhill."""
        total: Vector = sum((p.downhill for p in self.parts), np.zeros(2 * len(self.modes)))
        return total

    def residual_of(self, column: int) -> Vector:
        """Return measured minus fitted of an output of the record, in its unit."""
        for part in self.parts:
            n = len(self.problem.record.measured)
            if part.group.position == column:
                return np.asarray(part.residual[:n] * self.problem.noise[column])
            if part.group.rate == column:
                # weighed to the first quantity's noise, so in its own standard deviations
                return np.asarray(part.residual[-n:] * self.problem.noise[column])
        raise AssertionError(column)


def _responses(mode: Oscillator, effort: Matrix, h: float) -> tuple[Matrix, Matrix]:
    forced, free = mode.forced(effort, h), mode.free(len(effort), h)
    w = mode.frequency
    size = np.array([1.0, w])  # a start of 1 and of w: columns of one size
    return (
        np.hstack((forced[0] * w * w, free[0] * size)),
        np.hstack((forced[1] * w * w, free[1] * size)),
    )


def _neighbours(mode: Oscillator) -> tuple[tuple[Oscillator, Oscillator, float], ...]:
    dw, dz = _STEP * mode.frequency, _DAMPING_STEP
    return (
        (
            replace(mode, frequency=mode.frequency + dw),
            replace(mode, frequency=mode.frequency - dw),
            2.0 * dw,
        ),
        (
            replace(mode, damping_ratio=mode.damping_ratio + dz),
            replace(mode, damping_ratio=mode.damping_ratio - dz),
            2.0 * dz,
        ),
    )


def _difference(
    effort: Matrix, h: float, pair: tuple[Oscillator, Oscillator, float]
) -> tuple[Matrix, Matrix]:
    ahead, behind = (_responses(one, effort, h) for one in pair[:2])
    return (ahead[0] - behind[0]) / pair[2], (ahead[1] - behind[1]) / pair[2]


def refined(
    record: Record,
    modes: tuple[Oscillator, ...],
    noise: Vector,
    rounds: int = _ROUNDS,
    progress: Callable[[float], None] | None = None,
) -> tuple[Solution, Vector]:
    """Return the least squares of the residual over frequencies and damping, and the noise found.

    Levenberg and Marquardt on the projected slopes (Kaufman 1975), with the noise of every output
    estimated again after each accepted step.

    Args:
        record: of the experiment.
        modes: to start from.
        noise: first estimate of every output's standard deviation, (outputs,).
        rounds: at most.
        progress: called with the cost after every step.
    """
    problem = ModalLeastSquares(record, noise)
    now, damping = problem.solve(modes), 1e-3
    for _ in range(rounds):
        if progress is not None:
            progress(now.cost)
        information, downhill = now.information, now.gradient
        if not len(modes):
            break
        step = np.linalg.solve(information + damping * np.diag(np.diag(information)), downhill)
        tried = _moved(now.modes, np.asarray(step, dtype=np.float64))
        there = ModalLeastSquares(record, problem.noise).solve(tried) if tried else None
        if there is None or there.cost > now.cost * (1.0 + 1e-12):
            damping = max(10.0 * damping, 1e-6)
            if damping > 1e8:
                break
            continue
        deviations = np.sqrt(np.maximum(step @ information @ step, 0.0))
        damping = 0.1 * damping if damping > 1e-9 else 0.0
        problem = ModalLeastSquares(record, noise_of(there))
        now = problem.solve(there.modes)
        if deviations < _CONVERGED:
            break
    return now, noise_of(now)


def _moved(modes: tuple[Oscillator, ...], step: Vector) -> tuple[Oscillator, ...]:
    """Return the modes after a step; empty where it leaves what an oscillator can be."""
    out = []
    for k, mode in enumerate(modes):
        w, zeta = mode.frequency + step[2 * k], mode.damping_ratio + step[2 * k + 1]
        if not (0.5 * mode.frequency < w < 2.0 * mode.frequency and -0.2 < zeta < 0.9):
            return ()
        out.append(Oscillator(float(w), float(zeta)))
    return tuple(out)


def noise_of(solution: Solution) -> Vector:
    """Return the standard deviation of the residual of every output, (outputs,)."""
    record = solution.problem.record
    n = len(record.measured)
    found = np.empty(len(record.outputs))
    for column in range(len(record.outputs)):
        part = next(p for p in solution.parts if column in (p.group.position, p.group.rate))
        fitted = part.weights.size / (2 if min(part.group.position, part.group.rate) >= 0 else 1)
        residual = solution.residual_of(column)
        found[column] = np.sqrt(residual @ residual / max(n - fitted, 1.0))
    smallest = 1e-14 * np.abs(record.measured).max(axis=0) + 1e-300
    return np.asarray(np.maximum(found, smallest))


def modal_fit(solution: Solution) -> ModalFit:
    """Return what a solution says, in rising order of frequency, with covariances."""
    problem, modes = solution.problem, solution.modes
    record, inputs = problem.record, problem.record.effort.shape[1]
    order = np.argsort([mode.frequency for mode in modes])
    covariance: Matrix = np.asarray(
        np.linalg.pinv(solution.information, hermitian=True), dtype=np.float64
    )
    both = np.array([[2 * k, 2 * k + 1] for k in order], dtype=int).ravel()
    displacements = [p for p in solution.parts if p.group.position >= 0]
    residues = np.zeros((len(modes), len(displacements), inputs))
    inverse, spread = [], []
    for row, part in enumerate(displacements):
        for place, k in enumerate(order):
            first = part.weights.size - (len(modes) - k) * (inputs + 2)
            scale = modes[k].frequency ** 2
            residues[place, row] = part.weights[first : first + inputs] * scale
        if part.group.rigid:
            first = 3 if part.group.rate >= 0 else 2
            inverse.append(part.weights[first : first + inputs])
            spread.append(
                _linear_covariance(part, covariance)[first : first + inputs, first : first + inputs]
            )
    joints = len(inverse)
    blocks = np.zeros((joints * inputs, joints * inputs))
    for k, block in enumerate(spread):
        blocks[k * inputs : (k + 1) * inputs, k * inputs : (k + 1) * inputs] = block
    residual = np.column_stack([solution.residual_of(k) for k in range(len(record.outputs))])
    return ModalFit(
        tuple(modes[k] for k in order),
        covariance[np.ix_(both, both)],
        residues,
        np.array(inverse).reshape(joints, inputs),
        blocks,
        noise_of(solution),
        residual,
        sum(p.weights.size for p in solution.parts) + 2 * len(modes),
    )


def _linear_covariance(part: _Part, nonlinear: Matrix) -> Matrix:
    """Return the covariance of a group's linear parameters, that of the modes included."""
    basis = part.basis
    scaled = part.sigma**2 * basis.projection.inverse + part.along @ nonlinear @ part.along.T
    return np.asarray(scaled / np.outer(basis.scale, basis.scale))
