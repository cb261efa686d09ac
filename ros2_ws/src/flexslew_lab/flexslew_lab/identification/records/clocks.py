"""Series with clocks of their own as one record: at the times of all samples, gaps left open."""

from dataclasses import replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import median_filter

from flexslew_lab.identification.records.record import Output, Record, UnknownEfforts
from flexslew_plant.arrays import Vector
from flexslew_plant.errors import BadInput

_EVEN = 1e-3  # of a tick: jitter up to which samples lie on ticks
_SAME = 1e-6  # of a tick, within which two stamps are one
_MEDIAN_WINDOW = 11  # steps; their median is a clock's present one
_GAP = 1.5  # steps of a clock beyond which a sample is missing
_SPREAD_LIMIT = 0.3  # spread of a clock's steps from which a gap must exceed it _SPREADS times
_GAP_FACTOR = 5.0
_QUARTILES = 1.349  # between the quartiles of a normal distribution, in standard deviations
_MOST_PIECES = 16  # of a gap: they lead a bench of seven modes to any state, as any effort does
_MOST_UNKNOWN = 1000  # pieces of a record
_RESOLVED = 1e-6  # of the largest effort: the least deviation of a guess


class Effort(NamedTuple):
    """Samples of an input, each held until the next one (or, if past, since the one before)."""

    joint: str
    t: Vector  # [s]
    values: Vector
    past: bool


class _PiecewiseEffort(NamedTuple):
    """A piecewise constant effort, with a guess for each span that no sample gives."""

    edges: Vector  # (spans + 1,) [s]
    values: Vector  # (spans,)
    spread: Vector  # standard deviation of a guess, 0 of a sample, (spans,)

    @property
    def unknown(self) -> NDArray[np.bool_]:
        """Which spans no sample gives, (spans,)."""
        return np.asarray(self.spread > 0.0)


def record_on_clocks(
    efforts: list[Effort],
    outputs: list[tuple[Output, Vector, Vector]],
    period: float | None,
    source: str,
) -> Record:
    """Return a record at the times of all samples.

    Args:
        efforts: of the inputs.
        outputs: what they measure, times [s] and values.
        period: of the ticks on which modes are searched [s]; None: the first effort's median step.
        source: for messages.

    Raises:
        BadInput: the series have no time in common, no effort moves, or too much is missing.
    """
    h = float(np.median(np.diff(efforts[0].t))) if period is None else period
    clocks = [*(one.t for one in efforts), *(t for _, t, _ in outputs)]
    first, last = max(t[0] for t in clocks), min(t[-1] for t in clocks)
    ticks = int((last - first) / h + 1e-6)
    if ticks < 1:
        raise BadInput(f"{source}: the columns have no time in common")
    piecewise = [_with_pieces(one) for one in efforts]
    grid = first + h * np.arange(ticks + 1)
    even = all(_on(t, grid, h) for t in clocks)
    if not even:
        grid = _union([*clocks, *(one.edges for one in piecewise)], first, last, h)
    middle = 0.5 * (grid[1:] + grid[:-1])
    measured = np.column_stack([np.interp(grid, t, values) for _, t, values in outputs])
    known = np.column_stack([_near(grid, t, (_EVEN if even else _SAME) * h) for _, t, _ in outputs])
    record = Record(
        h,
        np.column_stack([one.values[_span(one, middle)] for one in piecewise]),
        measured,
        tuple(one.joint for one in efforts),
        tuple(output for output, _, _ in outputs),
        source,
        np.full(len(efforts), np.inf),
        None if even else np.diff(grid),
        None if known.all() else known,
        _pieces(piecewise, middle, source),
    )
    return record.active_channels()


def clock_notes(name: str, t: Vector) -> list[str]:
    """Return what a reader should know about the clock of a column, a sentence each."""
    h = float(np.median(np.diff(t)))
    gaps = _missing_samples(t)
    notes = []
    if (missing := int(gaps.sum())) > 0:
        notes.append(
            f"{name}: {missing} samples are missing in {np.count_nonzero(gaps)} gaps, in which it "
            "counts as unknown"
        )
    jitter = float(np.diff(t)[gaps == 0].std())  # the median step is never a gap
    if jitter > _EVEN * h:
        notes.append(f"{name}: jitter of {jitter:.2g} s; samples count at their own times")
    if (spread := _spread(_relative_steps(t))) >= _SPREAD_LIMIT:
        notes.append(
            f"{name}: the clock is irregular; steps of up to "
            f"{(1.0 + _GAP_FACTOR * spread) * h:.3g} s "
            "count as whole, and samples that are missing in them show in the residual alone"
        )
    return notes


def resample_evenly(record: Record) -> Record:
    """Return a record on ticks of one period: mean efforts, outputs on lines between samples."""
    if record.steps is None and record.is_complete:
        return record
    t, h = record.times, record.period
    grid = h * np.arange(int(t[-1] / h + 1e-6) + 1)
    area = np.vstack(
        (np.zeros((1, len(record.inputs))), np.cumsum(record.effort * np.diff(t)[:, None], axis=0))
    )
    effort = np.column_stack([np.diff(np.interp(grid, t, one)) / h for one in area.T])
    measured = np.empty((len(grid), len(record.outputs)))
    for k in range(len(record.outputs)):
        at = np.ones(len(t), dtype=bool) if record.known is None else record.known[:, k]
        measured[:, k] = np.interp(grid, t[at], record.measured[at, k])
    return replace(record, effort=effort, measured=measured, steps=None, known=None, pieces=None)


def _missing_samples(t: Vector) -> NDArray[np.int64]:
    """Return how many samples are missing in every step of a clock."""
    ratio = _relative_steps(t)
    spread = _spread(ratio)
    gap_threshold = _GAP if spread < _SPREAD_LIMIT else 1.0 + _GAP_FACTOR * spread
    missing = np.where(ratio > gap_threshold, np.maximum(np.round(ratio) - 1.0, 1.0), 0.0)
    return np.asarray(missing, dtype=np.int64)


def _relative_steps(t: Vector) -> Vector:
    """Return the steps of a clock in medians of those around them: its rate may wander."""
    steps = np.diff(t)
    return np.asarray(steps / median_filter(steps, size=_MEDIAN_WINDOW, mode="nearest"))


def _spread(ratio: Vector) -> float:
    """Return the standard deviation of relative steps as their quartiles show it."""
    low, high = np.quantile(ratio, (0.25, 0.75))
    return float(high - low) / _QUARTILES


def _with_pieces(effort: Effort) -> _PiecewiseEffort:
    """Return an effort with its gaps cut into pieces of unknown values, a line for a guess."""
    t, values = effort.t, effort.values
    gaps = _missing_samples(t)
    known = values[1:] if effort.past else values[:-1]
    edges, piecewise, spread = [t[:1]], [], []
    for k, missing in enumerate(gaps):
        if not missing:
            edges.append(t[k + 1 : k + 2])
            piecewise.append(known[k : k + 1])
            spread.append(np.zeros(1))
            continue
        step = (t[k + 1] - t[k]) / (missing + 1)
        count = min(int(missing), _MOST_PIECES)
        begin, end = (t[k], t[k + 1] - step) if effort.past else (t[k] + step, t[k + 1])
        piece_edges = np.linspace(begin, end, count + 1)
        line = np.interp(0.5 * (piece_edges[1:] + piece_edges[:-1]), *_tick_centers(effort))
        guess_spread = np.full(count, _largest_guess_error(values, int(missing)))
        if effort.past:
            edges.append(np.append(piece_edges[1:], t[k + 1]))
            piecewise.append(np.append(line, known[k]))
            spread.append(np.append(guess_spread, 0.0))
        else:
            edges.append(piece_edges)
            piecewise.append(np.append(known[k], line))
            spread.append(np.append(0.0, guess_spread))
    return _PiecewiseEffort(*(np.concatenate(part) for part in (edges, piecewise, spread)))


def _largest_guess_error(values: Vector, missing: int) -> float:
    """Return the largest error that a line over so many samples has anywhere in a record.

    As a standard deviation it covers efforts that jump, too, where the mean error would not.
    """
    half = min(missing // 2 + 1, (len(values) - 1) // 2)
    errors = values[half:-half] - 0.5 * (values[: -2 * half] + values[2 * half :])
    return float(max(np.abs(errors).max(), _RESOLVED * np.abs(values).max(), 1e-300))


def _tick_centers(effort: Effort) -> tuple[Vector, Vector]:
    """Return the middles of the ticks over which samples are held, and these."""
    half = 0.5 * float(np.median(np.diff(effort.t)))
    return effort.t + (-half if effort.past else half), effort.values


def _pieces(
    piecewise: list[_PiecewiseEffort], middle: Vector, source: str
) -> UnknownEfforts | None:
    """Return the unknown spans as ticks of a grid, given the ticks' middles."""
    found = []
    for column, one in enumerate(piecewise):
        span = _span(one, middle)
        for k in np.unique(span[one.unknown[span]]):
            first, last = np.searchsorted(span, [k, k + 1])
            found.append(
                (int(first), int(last), column, float(one.values[k]), float(one.spread[k]))
            )
    if not found:
        return None
    if len(found) > _MOST_UNKNOWN:
        raise BadInput(
            f"{source}: the efforts have {len(found)} unknown spans; at most {_MOST_UNKNOWN} can "
            "be estimated: cut the record into shorter ones"
        )
    return UnknownEfforts(*map(np.array, zip(*sorted(found), strict=True)))


def _span(piecewise: _PiecewiseEffort, t: Vector) -> NDArray[np.int64]:
    """Return the span of an effort that holds each time."""
    found = np.searchsorted(piecewise.edges, t, side="right") - 1
    return np.asarray(np.clip(found, 0, len(piecewise.values) - 1), dtype=np.int64)


def _on(t: Vector, grid: Vector, h: float) -> bool:
    """Return whether all samples of a clock lie on ticks, one on each."""
    inner_times = t[(t > grid[0] - 0.5 * h) & (t < grid[-1] + 0.5 * h)]
    places = np.round((inner_times - grid[0]) / h)
    even = np.abs(inner_times - grid[0] - places * h).max() <= _EVEN * h
    return bool(even and len(np.unique(places)) == len(inner_times) == len(grid))


def _union(clocks: list[Vector], first: float, last: float, h: float) -> Vector:
    """Return the stamps of several clocks from first to last, those that are one only once."""
    t = np.sort(np.concatenate(clocks))
    t = t[(t >= first) & (t <= last)]
    union: Vector = t[np.append(True, np.diff(t) > _SAME * h)]
    return union


def _near(grid: Vector, t: Vector, distance: float) -> NDArray[np.bool_]:
    """Return at which times of a grid a clock has a sample."""
    after = np.clip(np.searchsorted(t, grid), 1, len(t) - 1)
    distances = np.minimum(np.abs(grid - t[after]), np.abs(grid - t[after - 1]))
    return np.asarray(distances <= distance, dtype=bool)
