"""Modes of a bench from its record, by maximum likelihood: frequencies and damping ratios."""

from dataclasses import dataclass

import numpy as np

from flexslew_lab.identification.modal.oscillators import Oscillator
from flexslew_lab.identification.modal.parameter_groups import (
    ParameterGroup,
    bias_columns,
    groups_of,
)
from flexslew_lab.identification.modal.parts import Part
from flexslew_lab.identification.modal.projection import Projection
from flexslew_lab.identification.modal.regressors import RegressorSignals
from flexslew_lab.identification.modal.separable import ModalLeastSquares, Solution
from flexslew_lab.identification.records.record import Record
from flexslew_plant.arrays import Matrix, Vector

FLOOR = 1e-6  # of an output's largest value: what no sensor resolves, and no fit may explain
_MAX_ITERATIONS = 30
_MAX_EXPONENT = 20.0  # exponent by which a mode may grow over the record: it rings, or is none
_CONVERGED = 1e-2  # of a step, in standard deviations


@dataclass(frozen=True)
class ModalFit:
    """The modes of a record, with covariances.

    Args:
        modes: oscillators in rising order of frequency, (modes,).
        covariance: of (w_1, zeta_1, w_2, ...), (2 modes, 2 modes).
        residues: R_i, displacement of each group of outputs per unit of each modal force, shape
            (modes, groups, inputs); joint positions come first, then deflections.
        lags: S_i, displacement per unit of the rate of each modal force, same shape [s].
        inverse_inertia: R0 of the joints, (joints, inputs) [1/(kg m^2) or 1/kg].
        inverse_inertia_covariance: of its entries row by row.
        rigid: weights of the rigid columns of every group, none of a deflection.
        noise: standard deviation of every output, (outputs,).
        residual: measured minus fitted, (ticks + 1, outputs).
        parameters: how many numbers were fitted.
    """

    modes: tuple[Oscillator, ...]
    covariance: Matrix
    residues: np.ndarray
    lags: np.ndarray
    inverse_inertia: Matrix
    inverse_inertia_covariance: Matrix
    rigid: tuple[Vector, ...]
    noise: Vector
    residual: Matrix
    parameters: int

    @property
    def criterion(self) -> float:
        """Bayesian information criterion: smaller is better."""
        n = self.residual.size
        rows = len(self.residual)
        return float(2.0 * rows * np.log(self.noise).sum() + self.parameters * np.log(n))


def refined(
    signals: RegressorSignals,
    modes: tuple[Oscillator, ...],
    noise: Vector,
    iterations: int = _MAX_ITERATIONS,
) -> tuple[Solution, Vector]:
    """Return the least squares of the residual over frequencies and damping, and the noise found.

    Levenberg and Marquardt on the projected slopes (Kaufman 1975), with the noise of every output
    estimated again after each accepted step.

    Args:
        signals: of the experiment.
        modes: to start from.
        noise: first estimate of every output's standard deviation, (outputs,).
        iterations: at most.
    """
    problem = ModalLeastSquares(signals, noise)
    now, damping = problem.solve(modes), 1e-3
    for _ in range(iterations):
        information, gradient = now.information, now.gradient
        if not len(gradient):
            break
        step = np.asarray(
            np.linalg.solve(information + damping * np.diag(np.diag(information)), gradient)
        )
        candidate = _after_step(now.modes, step[: 2 * len(modes)], signals.record.duration)
        next_solution = None
        if candidate is not None:
            step_signals = now.problem.signals.with_effort_step(step[2 * len(modes) :])
            next_solution = ModalLeastSquares(step_signals, problem.noise).solve(candidate)
        if next_solution is None or next_solution.cost > now.cost * (1.0 + 1e-12):
            damping = max(10.0 * damping, 1e-6)
            if damping > 1e8:
                break
            continue
        step_deviation = np.sqrt(np.maximum(step @ information @ step, 0.0))
        damping = 0.1 * damping if damping > 1e-9 else 0.0
        problem = ModalLeastSquares(next_solution.problem.signals, noise_of(next_solution))
        now = problem.solve(next_solution.modes)
        if step_deviation < _CONVERGED:
            break
    return now, noise_of(now)


def _after_step(
    modes: tuple[Oscillator, ...], step: Vector, duration: float
) -> tuple[Oscillator, ...] | None:
    """Return the modes after a step; None where it leaves what an oscillator can be."""
    out = []
    for k, mode in enumerate(modes):
        w, zeta = mode.frequency + step[2 * k], mode.damping_ratio + step[2 * k + 1]
        near = 0.5 * mode.frequency < w < 2.0 * mode.frequency
        if not (near and zeta * w * duration > -_MAX_EXPONENT and zeta < 0.9):
            return None
        out.append(Oscillator(float(w), float(zeta)))
    return tuple(out)


def noise_of(solution: Solution) -> Vector:
    """Return the standard deviation of the residual of every output, (outputs,)."""
    record = solution.problem.record
    whole = solution.problem.signals.rows  # of a signal below a frequency, not one for each tick
    found = np.empty(len(record.outputs))
    for column in range(len(record.outputs)):
        part = next(p for p in solution.parts if column in dict(p.group.columns))
        fitted = part.weights.size / len(part.group.columns)
        if record.pieces is not None:  # those that this output's group takes for unknown efforts
            group_terms = slice(2 * len(solution.modes), None)
            fitted += np.sum(
                solution.covariance[group_terms, group_terms]
                * part.information[group_terms, group_terms]
            )
        residual = solution.residual_of(column)
        n = whole if record.known is None else record.samples(column)
        found[column] = np.sqrt(residual @ residual / max(n - fitted, 1.0))
    smallest = FLOOR * np.abs(record.measured).max(axis=0) + 1e-300
    return np.asarray(np.maximum(found, smallest))


def modal_fit(solution: Solution) -> ModalFit:
    """Return the modes of a solution in rising order of frequency, with covariances."""
    problem, modes = solution.problem, solution.modes
    inputs = problem.record.effort.shape[1]
    order = np.argsort([mode.frequency for mode in modes])
    covariance = solution.covariance
    indices = np.array([[2 * k, 2 * k + 1] for k in order], dtype=int).ravel()
    residues = np.zeros((len(modes), len(solution.parts), inputs))
    lags = np.zeros(residues.shape)
    inverse, spread, rigid = [], [], []
    for row, part in enumerate(solution.parts):
        for place, k in enumerate(order):
            group_terms, w = part.of_modes[k], modes[k].frequency
            residues[place, row] = group_terms[:inputs] * w**2
            if group_terms.size > inputs + 2:
                lags[place, row] = group_terms[inputs + 2 :]
        first = bias_columns(part.group)
        width = part.group.rigid * inputs * (2 if part.group.acceleration >= 0 else 1)
        rigid.append(part.weights[first : first + width])
        if part.group.rigid and part.group.position >= 0:
            inverse.append(rigid[-1])
            spread.append(
                _linear_covariance(part, covariance)[first : first + inputs, first : first + inputs]
            )
    joints = len(inverse)
    blocks = np.zeros((joints * inputs, joints * inputs))
    for k, block in enumerate(spread):
        blocks[k * inputs : (k + 1) * inputs, k * inputs : (k + 1) * inputs] = block
    residual = problem.residual_in_time(modes, solution.parts)
    return ModalFit(
        tuple(modes[k] for k in order),
        covariance[np.ix_(indices, indices)],
        residues,
        lags,
        np.array(inverse).reshape(joints, inputs),
        blocks,
        tuple(rigid),
        problem.record.deviation(residual),
        residual,
        sum(p.weights.size for p in solution.parts) + 2 * len(modes),
    )


def _linear_covariance(part: Part, nonlinear: Matrix) -> Matrix:
    """Return the covariance of a group's linear parameters, that of the modes included."""
    basis = part.basis
    scaled = part.sigma**2 * basis.projection.inverse + part.along @ nonlinear @ part.along.T
    return np.asarray(scaled / np.outer(basis.scale, basis.scale))


def prediction_error(record: Record, fit: ModalFit) -> Matrix:
    """Return what the modes of another record leave of this one, (ticks + 1, outputs).

    Bias and the motion before the record are this record's own; all else is the other's.
    """
    signals, inputs = RegressorSignals(record, None), record.effort.shape[1]
    terms = signals.columns(fit.modes)
    left = np.empty_like(record.measured)
    for row, group in enumerate(groups_of(record)):
        for column, which in group.columns:
            remainder = record.measured[:, column].copy()
            if group.rigid:
                remainder -= signals.rigid[which] @ fit.rigid[row]
            group_terms = [signals.line if which == 0 and group.rigid else signals.constant]
            for k, (mode, columns) in enumerate(zip(fit.modes, terms[which].modes, strict=True)):
                remainder -= columns[:, :inputs] @ (fit.residues[k, row] / mode.frequency**2)
                remainder -= columns[:, inputs + 2 :] @ fit.lags[k, row]
                group_terms.append(columns[:, inputs : inputs + 2])
            free = np.hstack(group_terms)
            free /= np.sqrt(np.einsum("ij,ij->j", free, free))
            left[:, column] = _left(record, column, free, remainder)
    return left


def _left(record: Record, column: int, free: Matrix, remainder: Vector) -> Vector:
    """Return what free motions leave of an output, 0 where it has no sample, (ticks + 1,)."""
    if record.known is None:
        return Projection(free).solve(remainder)[1]
    left, at = np.zeros_like(remainder), record.known[:, column]
    left[at] = Projection(free[at]).solve(remainder[at])[1]
    return left


def modal_response(fit: ModalFit, groups: tuple[ParameterGroup, ...], w: Vector) -> np.ndarray:
    """Return the frequency responses of a fit, (frequencies, displacements, inputs).

    G(jw) = -R0 / w^2 + sum of (R_i + j w S_i) / (w_i^2 - w^2 + 2 j zeta_i w_i w), R0 of the joints
    alone.

    Args:
        fit: modes and residues.
        groups: of its record.
        w: frequencies [rad/s].
    """
    square = (w**2)[:, None, None]
    displacements = [g for g in groups if g.position >= 0]
    count = len(displacements)
    rigid = np.zeros((count, fit.residues.shape[2]))
    rigid[[k for k, g in enumerate(displacements) if g.rigid]] = fit.inverse_inertia
    found: np.ndarray = -rigid / square + 0j
    s = 1j * w[:, None, None]
    for mode, residues, lags in zip(fit.modes, fit.residues, fit.lags, strict=True):
        drag = 2.0 * mode.damping_ratio * mode.frequency * s
        found = found + (residues + s * lags)[:, :count] / (mode.frequency**2 - square + drag)
    return found
