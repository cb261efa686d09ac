"""Which of the candidates are modes: those that pay for their parameters and are passive."""

import numpy as np

from flexslew_lab.identification.modal.missed import missing_mode, price, split_mode
from flexslew_lab.identification.modal.modal_fit import FLOOR, modal_fit, noise_of, refined
from flexslew_lab.identification.modal.oscillators import Oscillator
from flexslew_lab.identification.modal.regressors import RegressorSignals
from flexslew_lab.identification.modal.separable import ModalLeastSquares, Solution
from flexslew_lab.identification.records.record import Record
from flexslew_plant.arrays import Vector

_BACKWARD = 2.0  # times that a mode must push forward more than back
_NOISE_FACTOR = 2.0  # times the noise that a record shows by itself
_FIRST_ITERATIONS = 10  # candidates that are no modes hardly converge


def selected(
    signals: RegressorSignals, modes: tuple[Oscillator, ...], band: tuple[float, float]
) -> Solution:
    """Return the refined modes that pay for their parameters and can be modes of a bench.

    A start that was too far away is lost on the way: what the kept modes leave is searched for it.
    Where more than noise is left then, a start has led astray, and the search begins without any.

    Args:
        signals: of the experiment.
        modes: candidates.
        band: lowest and highest frequency that a mode may have [rad/s].
    """
    noise_estimate = _estimate_noise(signals.record)
    solution = _search(signals, modes, band, noise_estimate)
    if modes and (noise_of(solution) > _NOISE_FACTOR * noise_estimate).any():
        other = _search(signals, (), band, noise_estimate)
        if np.log(noise_of(other)).sum() < np.log(noise_of(solution)).sum():
            return other
    return solution


def _search(
    signals: RegressorSignals,
    modes: tuple[Oscillator, ...],
    band: tuple[float, float],
    noise_estimate: Vector,
) -> Solution:
    """Return what is found from these candidates on; see selected."""
    first = noise_of(ModalLeastSquares(signals, noise_estimate).solve(modes, slopes=False))
    # a start that is out of phase explains little: no candidate goes before it has moved
    solution, noise = refined(signals, modes, first, _FIRST_ITERATIONS)
    solution, noise = _refine_selection(signals, prune(signals, solution.modes, noise), noise)
    while (more := _more(signals, solution, noise, band)) is not None:
        solution, noise = more
    return solution


def _more(
    signals: RegressorSignals, solution: Solution, noise: Vector, band: tuple[float, float]
) -> tuple[Solution, Vector] | None:
    """Return a fit with more modes: one that was missed, or two for one; None: there are none."""
    missing = missing_mode(signals, solution, noise, band)
    starts = [] if missing is None else [(*solution.modes, missing)]
    for start in (*starts, None):
        modes = split_mode(signals, solution, noise) if start is None else start
        if modes is None:
            continue
        modes = tuple(sorted(modes, key=lambda mode: mode.frequency))
        candidate, found = refined(signals, modes, noise, _FIRST_ITERATIONS)
        candidate, found = _refine_selection(signals, prune(signals, candidate.modes, found), found)
        if len(candidate.modes) > len(solution.modes):
            return candidate, found
    return None


def _refine_selection(
    signals: RegressorSignals, modes: tuple[Oscillator, ...], noise: Vector
) -> tuple[Solution, Vector]:
    """Return the refined modes when none is left that must go, and the noise."""
    solution, noise = refined(signals, modes, noise)
    while True:
        reduced = _passive(solution, prune(signals, solution.modes, noise))
        if len(reduced) == len(solution.modes):
            return solution, noise
        solution, noise = refined(signals, reduced, noise)


def _passive(solution: Solution, modes: tuple[Oscillator, ...]) -> tuple[Oscillator, ...]:
    """Return the modes that are physically possible, where sensors at the drives show it.

    There the residues of a mode are phi phi^T: one that pushes back is an error of another mode.
    """
    record = solution.problem.record
    fit, rows = modal_fit(solution), list(record.actuation)
    if not rows:
        return modes
    wrong = set()
    for mode, residues in zip(fit.modes, fit.residues, strict=True):
        values = np.linalg.eigvalsh(0.5 * (residues[rows] + residues[rows].T))
        if not values[-1] > _BACKWARD * max(-float(values[0]), 0.0):
            wrong.add(mode)
    return tuple(mode for mode in modes if mode not in wrong)


def _estimate_noise(record: Record) -> Vector:
    """Return the noise of every output as differences of third order show it."""
    differences = np.diff(record.measured, n=3, axis=0).std(axis=0) / np.sqrt(20.0)
    spread = record.measured.std(axis=0)
    return np.asarray(np.maximum(differences, FLOOR * np.maximum(spread, 1e-300)))


def prune(
    signals: RegressorSignals, modes: tuple[Oscillator, ...], noise: Vector
) -> tuple[Oscillator, ...]:
    """Return the modes without those with a smaller gain than the price of their parameters."""
    problem = ModalLeastSquares(signals, noise)
    kept = list(modes)
    now = problem.solve(tuple(kept), slopes=False).cost if kept else 0.0
    parameter_price = price(problem)
    while kept:
        costs = [_cost_without(problem, kept, one) for one in kept]
        least = int(np.argmin(costs))
        if costs[least] - now > parameter_price:
            break
        now = costs[least]
        del kept[least]
    return tuple(kept)


def _cost_without(problem: ModalLeastSquares, modes: list[Oscillator], one: Oscillator) -> float:
    return problem.solve(tuple(m for m in modes if m is not one), slopes=False).cost
