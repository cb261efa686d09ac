"""Modes of a record whose residual is no white noise: the noise is made white by an ARX model.

Motion that no effort explains (process noise, a nonlinearity, quantised sensors) colours the
residual. In A(q) y = B(q) u + e of high order, 1 / A is the colour of the noise, whatever the modes
are (Ljung 1999, 4.2). The fit of A(q) y to the responses of A(q) u then has white errors, so its
estimates are those of maximum likelihood and its intervals count with the colour (Zhu and
Hjalmarsson 2016). A coloured residual also lets modes pay that are none: several follow the colour
of one. So each must explain more than what is left in its own band.
"""

from typing import NamedTuple

import numpy as np

from flexslew_lab.identification.modal.modal_fit import refined
from flexslew_lab.identification.modal.oscillators import Oscillator
from flexslew_lab.identification.modal.regressors import RegressorSignals
from flexslew_lab.identification.modal.selection import prune
from flexslew_lab.identification.modal.separable import ModalLeastSquares, Solution
from flexslew_lab.identification.modal.subspace import ResampledRecord, arx, stable
from flexslew_lab.identification.records.record import Record
from flexslew_plant.arrays import Matrix, Vector

_ORDER = 32  # of the ARX model
_ROWS = 4  # samples for each of its parameters, at least
_START_ORDERS = (6, 8, 10, 12, 16, 20, 24, 28)
_CLOSE = 0.1  # relative distance up to which modes may stand for one
_EXPLAINS = 2.0  # times the power that is left in a mode's band, without the mode
_LINES = 4.0  # half of that band, in resolutions of the record, at least
_GROWS = 3.0  # standard deviations of a negative damping ratio, which no mode has


class ColouredFit(NamedTuple):
    """A fit with coloured noise.

    Args:
        solution: of the filtered signals.
        innovations: what the modes and the noise model leave, (ticks + 1 - order, outputs).
        order: of the noise model.
    """

    solution: Solution
    innovations: Matrix
    order: int


def coloured_fit(
    solution: Solution, slow: ResampledRecord, edges: tuple[float, float]
) -> ColouredFit:
    """Return a fit of a complete record on even ticks with coloured noise, without ghosts.

    Args:
        solution: fit with white noise.
        slow: the record at the rate that the band needs.
        edges: lowest and highest frequency of a mode [rad/s].
    """
    filters = noise_filters(solution.problem.record)
    signals = RegressorSignals(solution.problem.record, None, filters=filters)
    poles = stable(arx(slow, _START_ORDERS), *edges)
    starts = {solution.modes, _replaced(solution.modes, poles)}
    fits = [_without_ghosts(_refined(signals, modes)) for modes in starts]
    fit = min(fits, key=lambda one: (len(one.modes), _spread(one)))
    return ColouredFit(fit, _residual(fit), filters.shape[1] - 1)


def noise_filters(record: Record) -> Matrix:
    """Return A(q) of an ARX model of each output of a complete record on even ticks.

    Shape (outputs, order + 1), by least squares.
    """
    u = np.vstack((record.effort, record.effort[-1:]))
    order = min(_ORDER, len(u) // (_ROWS * (u.shape[1] + 1) + 1))
    inputs = [u[order - k : len(u) - k] for k in range(order + 1)]
    found = [_autoregression(column, order, inputs) for column in record.measured.T]
    return np.array(found)


def _autoregression(values: Vector, order: int, inputs: list[Matrix]) -> Vector:
    """Return 1, a_1, ... of the best prediction from `order` past values and the inputs."""
    n = len(values)
    past = [values[order - k : n - k, None] for k in range(1, order + 1)]
    columns = np.hstack((*past, *inputs, np.ones((n - order, 1))))
    size = np.sqrt(np.einsum("ij,ij->j", columns, columns))
    columns /= np.where(size > 0.0, size, 1.0)
    weights = np.linalg.lstsq(columns, values[order:], rcond=1e-9)[0][:order]
    return np.concatenate(([1.0], -weights / size[:order]))


def _replaced(
    modes: tuple[Oscillator, ...], poles: tuple[Oscillator, ...]
) -> tuple[Oscillator, ...]:
    """Return the poles that are close to modes, and the modes without such a pole."""

    def close(one: Oscillator, other: Oscillator) -> bool:
        return bool(abs(np.log(one.frequency / other.frequency)) < _CLOSE)

    kept = [pole for pole in poles if any(close(pole, mode) for mode in modes)]
    alone = [mode for mode in modes if not any(close(mode, pole) for pole in kept)]
    return tuple(sorted((*kept, *alone), key=lambda mode: mode.frequency))


def _refined(signals: RegressorSignals, modes: tuple[Oscillator, ...]) -> Solution:
    """Return the refined modes that pay for their parameters."""
    first = ModalLeastSquares(signals, np.ones(len(signals.record.outputs))).solve(modes, False)
    solution, noise = refined(signals, modes, _residual(first).std(axis=0))
    kept = prune(signals, solution.modes, noise)
    return solution if len(kept) == len(solution.modes) else _refined(signals, kept)


def _without_ghosts(solution: Solution) -> Solution:
    """Return the fit without the modes that explain less than is left, or that grow."""
    modes, problem = solution.modes, solution.problem
    spread = np.sqrt(np.diag(solution.covariance))[1::2]
    candidates = []
    for mode, deviation in zip(modes, spread, strict=True):
        others = tuple(one for one in modes if one is not mode)
        gain = _explained(problem.solve(others, slopes=False), mode, solution)
        if mode.damping_ratio < -_GROWS * deviation:
            gain = 0.0
        alone = not any(abs(np.log(mode.frequency / one.frequency)) < _CLOSE for one in others)
        candidates.append((gain, alone, mode, others))
    for gain, alone, mode, others in sorted(candidates, key=lambda one: one[0]):
        if gain >= _EXPLAINS and alone:
            continue
        reduced = _refined(problem.signals, others)  # the others may take its place
        if gain == 0.0 or _explained(reduced, mode, solution) < _EXPLAINS:
            return _without_ghosts(reduced)
    return solution


def _explained(without: Solution, mode: Oscillator, fit: Solution) -> float:
    """Return the power in a mode's band without it relative to that with it, of the output most so.

    Both are of what one noise model leaves, so its colour does not count.
    """
    before, after = _residual(without), _residual(fit)
    w = 2.0 * np.pi * np.fft.rfftfreq(len(before), fit.problem.record.period)
    half = max(mode.frequency * abs(mode.damping_ratio), _LINES * w[1])
    band = np.abs(w - mode.frequency) <= half
    power = [(np.abs(np.fft.rfft(x, axis=0)[band]) ** 2).sum(axis=0) for x in (before, after)]
    return float(np.max(power[0] / np.maximum(power[1], 1e-300))) if band.any() else 1.0


def _residual(solution: Solution) -> Matrix:
    """Return what modes and noise model leave of every output, (rows, outputs)."""
    columns = range(len(solution.problem.record.outputs))
    return np.column_stack([solution.residual_of(column) for column in columns])


def _spread(solution: Solution) -> float:
    return float(np.log(_residual(solution).std(axis=0)).sum())
