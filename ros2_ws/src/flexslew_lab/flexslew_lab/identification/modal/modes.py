"""The modes of a record: where they start, how many there are, and how well they are known."""

from collections.abc import Callable, Iterable
from dataclasses import dataclass, replace

import numpy as np
from scipy.signal import welch
from scipy.stats import chi2, norm

from flexslew_lab.identification.modal.coloured import coloured_fit
from flexslew_lab.identification.modal.modal_fit import ModalFit, modal_fit, noise_of, refined
from flexslew_lab.identification.modal.oscillators import Oscillator
from flexslew_lab.identification.modal.parameter_groups import ParameterGroup, groups_of
from flexslew_lab.identification.modal.regressors import RegressorSignals
from flexslew_lab.identification.modal.selection import prune, selected
from flexslew_lab.identification.modal.separable import Solution
from flexslew_lab.identification.modal.subspace import METHODS, Poles, resample, stable
from flexslew_lab.identification.records.clocks import resample_evenly
from flexslew_lab.identification.records.record import Quantity, Record
from flexslew_plant.arrays import Matrix, Vector
from flexslew_plant.errors import BadInput

CONFIDENCE = 0.95
_ORDERS = tuple(range(4, 29, 2))
_WHITE_LAGS = 25  # of the residual's autocorrelation
_SEPARATE = 0.01  # relative distance of two modes, at least
_SINGULAR = 1e4  # condition number from which inertias cannot be separated
_POWER = 0.99  # of the efforts' power in the band, where no band is given
_BELOW = 0.5  # of the band, down to which modes are looked for [-]
_WHOLE = 0.65  # of half the sampling rate, the end of the widest band
_ABOVE = 1.3  # of the band, from which on a mode stands for others [-]
_DAMPING_LIMIT = 0.5  # damping ratio beyond which a mode may be none [-]
_SEARCH_LIMIT = 3  # at most, of a record with gaps, each with better estimates of its efforts
_MIN_POWER_SHARE = 1e-3  # of the efforts' power that a band must hold


@dataclass(frozen=True)
class Interval:
    """An estimate and its interval, which contains the truth with a probability of CONFIDENCE."""

    value: float
    low: float
    high: float


@dataclass(frozen=True)
class FittedMode:
    """One mode of the free bench.

    Args:
        frequency: undamped [rad/s].
        damping_ratio: [-].
        periods: how many of it the record holds.
        participation: how strongly each input drives it, largest 1, (inputs,).
        shape: displacement of each group of outputs per unit of it, largest 1, (groups,).
    """

    frequency: Interval
    damping_ratio: Interval
    periods: float
    participation: Vector
    shape: Vector


@dataclass(frozen=True)
class Whiteness:
    """Whether a residual is noise: Ljung and Box's sum over the first lags.

    Args:
        output: its name.
        statistic: of the sum.
        bound: that white noise of all outputs keeps to with a probability of 99 %.
    """

    output: str
    statistic: float
    bound: float

    @property
    def white(self) -> bool:
        """Whether it passes the test for white noise."""
        return self.statistic <= self.bound


@dataclass(frozen=True)
class ModalModel:
    """Modes and inertias of a record.

    Args:
        record: that it is from.
        band: where modes were looked for [rad/s].
        modes: rising.
        inertia: of the rigid bench as its joints see it, entries of the inverse of R0; empty where
            a joint that is shaken is not measured.
        fit: all numbers, with covariances.
        starts: what subspace identification found.
        whiteness: of the residual of every output, less its prediction by the noise model.
        noise_order: of the autoregressive model of the residual; 0: it is white, or the record is
            not complete on even ticks.
    """

    record: Record
    band: tuple[float, float]
    modes: tuple[FittedMode, ...]
    inertia: tuple[tuple[Interval, ...], ...]
    fit: ModalFit
    starts: tuple[Poles, ...]
    whiteness: tuple[Whiteness, ...]
    noise_order: int = 0

    @property
    def groups(self) -> tuple[ParameterGroup, ...]:
        """Groups of outputs, in the order of the residues and of the shapes."""
        return groups_of(self.record)

    @property
    def white(self) -> bool:
        """Whether what is left of every output is white noise."""
        return all(one.white for one in self.whiteness)

    @property
    def outside(self) -> int:
        """How many of the modes lie outside of the band, where nothing shook them."""
        return sum(self._outside(mode) for mode in self.modes)

    def _outside(self, mode: FittedMode) -> bool:
        low, high = _BELOW * self.band[0], _ABOVE * self.band[1]
        return not low <= mode.frequency.value <= high

    @property
    def doubts(self) -> tuple[str, ...]:
        """What the model lacks, and modes that may be none: outside of the band, or fading fast."""
        not_white = ", ".join(w.output for w in self.whiteness if not w.white)
        warning = (
            f"the residual of {not_white} is not white: something moves that the model lacks, the "
            "steps of a sensor are coarser than its noise, or efforts were not held from sample to "
            "sample (--hold); intervals are too narrow"
        )
        outside = tuple(
            f"mode {k} swings at {mode.frequency.value:.3g} rad/s, which nothing shook: it may "
            f"stand for what lies outside of the band of {self.band[0]:.3g} to "
            f"{self.band[1]:.3g} rad/s, and inertias may be further off than their intervals"
            for k, mode in enumerate(self.modes, 1)
            if self._outside(mode)
        )
        fast = tuple(
            f"mode {k} has a damping ratio of {mode.damping_ratio.value:.2g}: it may be friction "
            "of the motors, of which the rigid motion that is assumed has none, and inertias may "
            "be further off than their intervals"
            for k, mode in enumerate(self.modes, 1)
            if mode.damping_ratio.value > _DAMPING_LIMIT
        )
        return ((warning,) if not_white else ()) + outside + fast


def identify_modes(
    record: Record,
    band: tuple[float, float] | None = None,
    progress: Callable[[str], None] | None = None,
) -> ModalModel:
    """Return the modes of a record with their confidence intervals.

    Candidates are the poles that subspace identification finds again at every order; frequencies,
    damping ratios, residues and initial conditions are then those of the least squared residual,
    and a mode that does not pay for its parameters (Schwarz's criterion) goes.

    Args:
        record: of an experiment.
        band: that was shaken [rad/s]; None: where the efforts have their power.
        progress: called with what is being done.

    Raises:
        BadInput: the drives were saturated, the record is shorter than ten periods of the band's
            end, the efforts do not shake the band, or ctrlsys is missing.
    """
    report = progress or (lambda words: None)
    if record.pieces is not None and record.columns(Quantity.ACCELERATION):
        raise BadInput(
            f"{record.source}: an effort is unknown in gaps, and accelerations follow it at once: "
            "give a part of the record without gaps, or outputs that are no accelerations"
        )
    even = resample_evenly(record)
    if band is not None:
        return _identified(record, even, band, report)
    found = _identified(record, even, power_band(even), report)
    if record.held and found.noise_order and not found.white:
        report("what is left is no noise: searched again in the whole band of the samples")
        wide = found.band[0], _WHOLE * np.pi / even.period
        wider = _identified(record, even, wide, report)
        return wider if wider.white else found
    return found


def _identified(
    record: Record, even: Record, band: tuple[float, float], report: Callable[[str], None]
) -> ModalModel:
    """Return the modes in a band; `even` is the record on even ticks."""
    _require(even, band)
    slow = resample(even, band[1])
    starts = []
    for name, method in METHODS.items():
        report(f"poles by {name}")
        starts.append(method(slow, _ORDERS))
    edges = _BELOW * band[0], min(1.05 * band[1], 0.8 * np.pi / slow.period)
    candidates = _merged([mode for poles in starts for mode in stable(poles, *edges)])
    report(f"{len(candidates)} candidates, refined on {record.ticks} ticks")
    lowest = 0.0 if record.pieces is None else edges[0]
    modes, noise = _select_modes(RegressorSignals(even, band[1], lowest), candidates, edges)
    solution = _refined_whole(RegressorSignals(record, None), modes, noise)
    for _ in range(_SEARCH_LIMIT if record.pieces is not None else 0):
        report(f"{len(solution.modes)} modes; searched again with the efforts that were estimated")
        signals = RegressorSignals(resample_evenly(_filled(solution)), band[1])
        modes, noise = _select_modes(signals, solution.modes, edges)
        if len(modes) == len(solution.modes):
            break
        solution = _refined_whole(solution.problem.signals, modes, noise)
    fit = modal_fit(solution)
    record = solution.problem.record
    whiteness, order = whiteness_of(record, fit.residual), 0
    even_ticks = record.steps is None and record.is_complete
    if even_ticks and not (record.held and all(one.white for one in whiteness)):
        report("what is left is no white noise: fitted with a model of it")
        coloured = coloured_fit(solution, slow, edges)
        fit, order = modal_fit(coloured.solution), coloured.order
        whiteness = whiteness_of(record, coloured.innovations)
    return ModalModel(
        record,
        band,
        _fitted_modes(fit, record),
        _inertia(fit, record),
        fit,
        tuple(starts),
        whiteness,
        order,
    )


def _select_modes(
    signals: RegressorSignals, candidates: tuple[Oscillator, ...], edges: tuple[float, float]
) -> tuple[tuple[Oscillator, ...], Vector]:
    """Return the candidates that are modes and the noise; the signals of the search are freed."""
    selection = selected(signals, candidates, edges)
    return selection.modes, noise_of(selection)


def _filled(solution: Solution) -> Record:
    """Return the record with the fit where an output has no sample."""
    record = solution.problem.record
    if record.known is None:
        return record
    fitted = solution.problem.fitted_in_time(solution.modes, solution.parts)
    measured = np.where(record.known, record.measured, fitted)
    return replace(record, measured=measured, known=None)


def _refined_whole(
    whole: RegressorSignals, modes: tuple[Oscillator, ...], noise: Vector
) -> Solution:
    """Return the fit of all ticks without the modes that do not pay.

    The low end of a band alone would tie the noise to the efforts fed back from it.
    """
    solution, noise = refined(whole, modes, noise)
    whole = solution.problem.signals
    remaining_modes = prune(whole, solution.modes, noise)
    if len(remaining_modes) < len(solution.modes):  # one stood for what complex shapes explain now
        solution, _ = refined(whole, remaining_modes, noise)
    return solution if whole.record.pieces is None else _without_drift(solution)


def _without_drift(solution: Solution) -> Solution:
    """Return a fit without the modes that estimated efforts make superfluous.

    Errors of the first guesses add up to a drift that a slow mode may follow.
    """
    for mode in solution.modes:
        others = tuple(one for one in solution.modes if one is not mode)
        reduced, _ = refined(solution.problem.signals, others, solution.problem.noise)
        if modal_fit(reduced).criterion < modal_fit(solution).criterion:
            return _without_drift(reduced)
    return solution


def power_band(record: Record) -> tuple[float, float]:
    """Return the frequencies between which the efforts have their power [rad/s]."""
    w, share = _power_below(record)
    last = int(np.searchsorted(share, _POWER))
    first = int(np.searchsorted(share, 0.5 * (1.0 - _POWER)))
    return float(w[min(first, len(w) - 2)]), float(w[min(max(last, first + 1), len(w) - 1)])


def _power_below(record: Record) -> tuple[Vector, Vector]:
    """Return frequencies [rad/s] and the part of the efforts' power up to each of them [-]."""
    length = min(record.ticks, max(record.ticks // 8, 1024))
    f, power = welch(record.effort, 1.0 / record.period, nperseg=length, axis=0)
    share = np.cumsum(power[1:].sum(axis=1))
    return 2.0 * np.pi * f[1:], share / share[-1]


def _require(record: Record, band: tuple[float, float]) -> None:
    """Refuse a record that cannot identify modes, with the numbers."""
    if record.saturated > 0.01:
        raise BadInput(
            f"{record.source}: a drive was at its limit in {record.saturated:.0%} of the ticks, "
            "and the fit needs the demanded effort without limits: shake less"
        )
    periods = record.duration * band[1] / (2.0 * np.pi)
    if periods < 10.0:
        raise BadInput(
            f"{record.source}: {record.duration:g} s hold {periods:.2g} periods of {band[1]:.3g} "
            "rad/s, the end of the band; at least 10 are needed"
        )
    w, share = _power_below(record)
    power_share = float(
        np.interp(band[1], w, share) - np.interp(_BELOW * band[0], w, share, left=0.0)
    )
    if power_share < _MIN_POWER_SHARE:
        low, high = power_band(record)
        raise BadInput(
            f"{record.source}: the band of {band[0]:.3g} to {band[1]:.3g} rad/s holds "
            f"{power_share:.1g} "
            f"of the efforts' power, and at least {_MIN_POWER_SHARE:g} is needed: no excitation "
            "there, they "
            f"shake {low:.3g} to {high:.3g} rad/s"
        )


def _merged(found: list[Oscillator]) -> tuple[Oscillator, ...]:
    """Return the modes without doubles, rising."""
    kept: list[Oscillator] = []
    for mode in found:  # the first method's word goes before the second's
        if all(abs(mode.frequency / other.frequency - 1.0) > _SEPARATE for other in kept):
            kept.append(mode)
    return tuple(sorted(kept, key=lambda mode: mode.frequency))


def _fitted_modes(fit: ModalFit, record: Record) -> tuple[FittedMode, ...]:
    found = []
    spread = np.sqrt(np.diag(fit.covariance))
    for k, mode in enumerate(fit.modes):
        residues = fit.residues[k]
        left, _, right = np.linalg.svd(residues)
        shape, input_shape = left[:, 0], right[0]
        sign = 1.0 if input_shape[int(np.argmax(np.abs(input_shape)))] > 0.0 else -1.0
        found.append(
            FittedMode(
                interval(mode.frequency, spread[2 * k]),
                interval(mode.damping_ratio, spread[2 * k + 1]),
                record.duration * mode.frequency / (2.0 * np.pi),
                sign * input_shape / np.abs(input_shape).max(),
                sign * shape / np.abs(shape).max(),
            )
        )
    return tuple(found)


def _inertia(fit: ModalFit, record: Record) -> tuple[tuple[Interval, ...], ...]:
    """Return the inverse of R0 with intervals by the delta method."""
    rows, inputs = list(record.actuation), len(record.inputs)
    inverse = fit.inverse_inertia[rows]
    # a drive on an appendage moves the same rigid body as those on the platform do
    if not rows or np.linalg.cond(inverse) > _SINGULAR:
        return ()
    inertia = np.linalg.inv(inverse)
    slopes = -np.kron(inertia, inertia.T)  # d vec(J)/d vec(R0), row by row
    places = np.array([row * inputs + k for row in rows for k in range(inputs)])
    covariance = fit.inverse_inertia_covariance[np.ix_(places, places)]
    spread = np.sqrt(np.diag(slopes @ covariance @ slopes.T))
    return tuple(
        tuple(interval(inertia[i, j], spread[i * len(inertia) + j]) for j in range(len(inertia)))
        for i in range(len(inertia))
    )


def interval(value: float, deviation: float) -> Interval:
    """Return a normal estimate's interval."""
    half = float(norm.ppf(0.5 + 0.5 * CONFIDENCE)) * float(deviation)
    return Interval(float(value), float(value) - half, float(value) + half)


def autocorrelation(values: Vector, lags: Iterable[int]) -> Vector:
    """Return the autocorrelation of values at lags in samples, shape (lags,) [-]."""
    centered = values - values.mean()
    size = float(centered @ centered) or 1.0
    return np.array([float(centered[k:] @ centered[: len(centered) - k]) for k in lags]) / size


def whiteness_of(record: Record, residual: Matrix) -> tuple[Whiteness, ...]:
    """Return the whiteness of every output of a record; all of them, if white, pass with 99 %.

    Args:
        record: record of the outputs.
        residual: measured minus fitted, (ticks + 1, outputs).
    """
    n, lags = len(residual), np.arange(1, _WHITE_LAGS + 1)
    bound = float(chi2.ppf(0.99 ** (1.0 / len(record.outputs)), _WHITE_LAGS))
    found = []
    for output, column in zip(record.outputs, residual.T, strict=True):
        r = autocorrelation(column, lags)
        found.append(
            Whiteness(output.name, float(n * (n + 2.0) * (r**2 / (n - lags)).sum()), bound)
        )
    return tuple(found)
