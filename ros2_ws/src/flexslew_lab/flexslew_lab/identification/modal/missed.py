"""The mode that a fit has missed: what each oscillator of a grid would explain of its residual."""

import numpy as np
from scipy.linalg import LinAlgError, solve

from flexslew_lab.identification.modal.oscillators import Oscillator
from flexslew_lab.identification.modal.regressors import RegressorSignals
from flexslew_lab.identification.modal.separable import ModalLeastSquares, Solution
from flexslew_plant.arrays import Vector

_GRID = 0.05  # relative distance of its frequencies
# Next to a known mode: how many places on either side, and how many times its price a mode must
# explain there, where the non-linear part is left, too.
_OFFSET_COUNT, _PRICE_FACTOR = 6, 10.0


def missing_mode(
    signals: RegressorSignals, solution: Solution, noise: Vector, band: tuple[float, float]
) -> Oscillator | None:
    """Return the oscillator of a grid that explains most of what is left; None: none pays.

    Where none does, a mode may be hidden next to one that is known.

    Args:
        signals: signals of the experiment.
        solution: modes that were found.
        noise: standard deviation of every output, (outputs,).
        band: lowest and highest frequency of the search [rad/s].
    """
    problem = ModalLeastSquares(signals, noise)
    now = problem.solve(solution.modes, slopes=False)
    most, best = price(problem), None
    count = int(np.log(band[1] / band[0]) / _GRID) + 2
    for w in np.geomspace(*band, count):
        if any(abs(w / mode.frequency - 1.0) < 0.5 * _GRID for mode in solution.modes):
            continue
        one = Oscillator(float(w), 0.5 * _GRID)  # half its width: none falls between two
        cost_reduction = gain(now, one)
        if cost_reduction > most:
            most, best = cost_reduction, one
    if best is None:
        most *= _PRICE_FACTOR
        for one in _near_modes(solution.modes, signals.record.duration):
            cost_reduction = gain(now, one)
            if cost_reduction > most:
                most, best = cost_reduction, one
    return best


def _near_modes(modes: tuple[Oscillator, ...], duration: float) -> list[Oscillator]:
    """Return oscillators next to modes, from half a period of the record to half the grid away."""
    found = []
    for mode in modes:
        nearest = np.pi / (duration * mode.frequency)
        if nearest < 0.5 * _GRID:
            for offset in np.geomspace(nearest, 0.5 * _GRID, _OFFSET_COUNT).tolist():
                sides = (1.0 - offset, 1.0 + offset)
                found += [Oscillator(side * mode.frequency, 0.5 * offset) for side in sides]
    return found


def split_mode(
    signals: RegressorSignals, solution: Solution, noise: Vector
) -> tuple[Oscillator, ...] | None:
    """Return the modes with one of them as two, where that explains most; None: none pays.

    A mode that stands for two close ones is between them and is damped more.

    Args:
        signals: signals of the experiment.
        solution: modes that were found.
        noise: standard deviation of every output, (outputs,).
    """
    problem = ModalLeastSquares(signals, noise)
    now = problem.solve(solution.modes, slopes=False).cost
    most, best = now - _PRICE_FACTOR * price(problem), None
    for mode in solution.modes:
        others = tuple(one for one in solution.modes if one is not mode)
        nearest = np.pi / (signals.record.duration * mode.frequency)
        if nearest >= 0.5 * _GRID:
            continue
        for offset in np.geomspace(nearest, 0.5 * _GRID, _OFFSET_COUNT).tolist():
            for damping in (0.5 * offset, 0.2 * offset):
                pair = [
                    Oscillator(s * mode.frequency, damping) for s in (1.0 - offset, 1.0 + offset)
                ]
                candidate = tuple(sorted((*others, *pair), key=lambda one: one.frequency))
                cost = problem.solve(candidate, slopes=False).cost
                if cost < most:
                    most, best = cost, candidate
    return best


def price(problem: ModalLeastSquares) -> float:
    """Return what the parameters of a mode cost (Schwarz)."""
    groups, record = len(problem.groups), problem.record
    rows = problem.signals.measured.size
    return float(0.5 * np.log(rows) * (2 + groups * (record.effort.shape[1] + 2)))


def gain(solution: Solution, mode: Oscillator) -> float:
    """Return by how much the cost falls with one more oscillator, all residues fitted again.

    With its columns X made orthogonal to those of the fit, X' = (1 - P) X, it is
    |r^T X' (X'^T X')^-1 X'^T r| / 2: nothing that is fitted already has to be solved again.
    """
    problem = solution.problem
    pair = problem.signals.responses(mode)
    projected: dict[int, tuple[Vector, Vector]] = {}  # of groups with the same columns
    total = 0.0
    for part in solution.parts:
        key = id(part.basis)
        if key not in projected:
            columns = np.vstack([w * pair[which] for _, which, w in problem.rows(part.group)])
            columns = columns / np.sqrt(np.einsum("ij,ij->j", columns, columns))
            basis = part.basis
            columns -= basis.columns @ basis.projection.coordinates(columns)
            projected[key] = columns, columns.T @ columns
        columns, gram = projected[key]
        along = columns.T @ part.residual
        try:
            total += 0.5 * float(along @ solve(gram, along, assume_a="pos"))
        except LinAlgError:  # it is in the columns already
            continue
    return total
