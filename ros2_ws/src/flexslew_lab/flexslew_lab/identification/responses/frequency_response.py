"""Frequency responses from efforts to outputs, with coherence and confidence bands.

In closed loop the effort carries the sensors' noise, so Y/U is biased. What the plan added is known
and free of noise: with R its spectrum over the orthogonal experiments, G = (Y R^-1)(U R^-1)^-1 is
consistent (the joint input-output method, Pintelon and Schoukens 2012, chapters 2 and 9). Periods
that follow one another differ by noise alone once the transient is over; their scatter gives the
covariance of the means, and with it that of G (Pintelon and Schoukens, (2-45)).
"""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.stats import f as fisher

from flexslew_control.plan import Plan
from flexslew_control.planners.excitation.excitation import EXCITATION
from flexslew_lab.identification.records.record import Output, Quantity, Record
from flexslew_plant.arrays import Matrix, Vector
from flexslew_plant.errors import BadInput

_LEAST = 3  # periods: the first has the transient, and two separate noise from response
CONFIDENCE = 0.95

Complex = NDArray[np.complex128]


@dataclass(frozen=True)
class FrequencyResponse:
    """G at the lines of the excitation.

    Args:
        frequency: of the lines, (lines,) [rad/s].
        inputs: names of the efforts.
        outputs: of the rows.
        response: (lines, outputs, inputs).
        deviation: standard deviation of each entry, real and imaginary part together.
        radius: of the circle that holds the truth with 95 %, same shape.
        coherence: part of each output's power that repeats from period to period, (lines, outputs).
        periods: averaged in every experiment.
    """

    frequency: Vector
    inputs: tuple[str, ...]
    outputs: tuple[Output, ...]
    response: Complex
    deviation: np.ndarray
    radius: np.ndarray
    coherence: Matrix
    periods: int


def period_count(plan: Plan, ticks: int) -> int:
    """Return how many periods of every experiment were flown in so many ticks.

    Raises:
        BadInput: it is no multisine of at least three periods.
    """
    layout = _layout(replace(plan, start=0.0), "the experiment")
    begin = layout.first + (layout.experiments - 1) * layout.repeated * layout.period
    return min(max((ticks - begin) // layout.period, 0), layout.repeated)


def frequency_response(
    records: list[Record], plans: list[Plan], periods: int | None = None
) -> FrequencyResponse:
    """Return the frequency responses of one run, or of several with the same excitation.

    The first period of every experiment, in which the transient dies, is left out. A straight line
    is taken out of joint positions over every period: a free joint drifts.

    Args:
        records: of the runs.
        plans: with which each was shaken.
        periods: of every experiment that count, the first ones, at least 3; None: all that every
            record holds.

    Raises:
        BadInput: a plan is no multisine of at least three periods, the runs differ, or one ended
            before three periods of its last experiment.
    """
    layouts = [_layout(plan, one.source) for plan, one in zip(plans, records, strict=True)]
    first = layouts[0]
    for record, layout in zip(records, layouts, strict=True):
        same = layout.period == first.period and layout.experiments == first.experiments
        same = same and layout.lines == first.lines and record.period == records[0].period
        if record.inputs != records[0].inputs or not same:
            raise BadInput(f"{record.source}: is not the experiment of {records[0].source}")
    last = min(_whole_periods(record, plan) for record, plan in zip(records, plans, strict=True))
    last = last if periods is None else min(last, periods)
    spectra = [
        _spectra(record, plan, layout, last)
        for record, plan, layout in zip(records, plans, layouts, strict=True)
    ]
    effort = np.concatenate([one[0] for one in spectra], axis=1)  # (experiments, periods, n, lines)
    output = np.concatenate([one[1] for one in spectra], axis=1)
    added = spectra[0][2]
    average_count = effort.shape[1]
    u, y = effort.mean(axis=1), output.mean(axis=1)  # (experiments, n, lines)
    lines = len(first.lines)
    response = np.empty((lines, y.shape[1], u.shape[1]), dtype=np.complex128)
    deviation = np.empty(response.shape)
    for line in range(lines):
        r = np.linalg.inv(added[:, :, line].T)  # (joints, experiments) turned
        gu, gy = u[:, :, line].T @ r, y[:, :, line].T @ r
        g = gy @ np.linalg.inv(gu)
        response[line] = g
        noise = output[:, :, :, line] - np.einsum("oi,epi->epo", g, effort[:, :, :, line])
        scatter = (np.abs(noise - noise.mean(axis=1, keepdims=True)) ** 2).sum(axis=1)
        variance = (
            scatter.mean(axis=0) / (average_count - 1) / average_count
        )  # of a mean, (outputs,)
        inverse = np.linalg.inv(u[:, :, line].T)  # (experiments, inputs)
        deviation[line] = np.sqrt(np.outer(variance, (np.abs(inverse) ** 2).sum(axis=0)))
    dof = 2 * u.shape[0] * (average_count - 1)
    radius = deviation * np.sqrt(float(fisher.ppf(CONFIDENCE, 2, dof)))
    repeated = (np.abs(y) ** 2).mean(axis=0)
    scatter = output.var(axis=1).mean(axis=0) * average_count / (average_count - 1)
    coherence = repeated / (repeated + scatter + 1e-300)
    return FrequencyResponse(
        first.frequency,
        records[0].inputs,
        records[0].outputs,
        response,
        deviation,
        radius,
        np.asarray(coherence.T),
        average_count,
    )


def _whole_periods(record: Record, plan: Plan) -> int:
    """Return how many periods of every experiment a record holds.

    Raises:
        BadInput: less than three.
    """
    found = period_count(plan, len(record.effort) - round(plan.start / plan.period))
    if found < _LEAST:
        raise BadInput(
            f"{record.source}: ends after {found} periods of its last experiment: frequency "
            f"responses need {_LEAST}"
        )
    return found


@dataclass(frozen=True)
class _Layout:
    lines: tuple[int, ...]
    frequency: Vector
    first: int  # tick of the first whole period
    period: int  # ticks
    repeated: int
    experiments: int


def _layout(plan: Plan, source: str) -> _Layout:
    summary = plan.summary
    if plan.method != EXCITATION.name or plan.request.get("signal") != "multisine":
        raise BadInput(
            f"{source}: frequency responses need a multisine "
            "(plan: {method: excitation, signal: multisine})"
        )
    period = round(summary["period"] / plan.period)
    spacing = 2.0 * np.pi / (period * plan.period)
    low, high = summary["band"]
    lines = tuple(range(max(int(np.ceil(low / spacing - 1e-9)), 1), int(high / spacing + 1e-9) + 1))
    if summary["periods"] < _LEAST:
        raise BadInput(
            f"{source}: {summary['periods']} periods of an experiment are not enough: the "
            "first holds the transient, and two separate noise from response; shake for longer"
        )
    start = round(plan.start / plan.period) + round(summary["taper"] / plan.period)
    return _Layout(
        lines,
        spacing * np.array(lines, dtype=np.float64),
        start,
        period,
        summary["periods"],
        summary["experiments"],
    )


def _spectra(
    record: Record, plan: Plan, layout: _Layout, periods: int
) -> tuple[Complex, Complex, Complex]:
    """Return the spectra of efforts and outputs by experiment and period, and what was added."""
    columns = [plan.joint_names.index(name) for name in record.inputs]
    h, n = record.period, layout.period
    half_tick = np.exp(-0.5j * layout.frequency * h) * np.sinc(layout.frequency * h / 2.0 / np.pi)
    efforts, outputs, added = [], [], []
    for e in range(layout.experiments):
        of_effort, of_output = [], []
        for p in range(1, periods):
            first = layout.first + (e * layout.repeated + p) * n
            part = record.effort[first : first + n]
            of_effort.append(_lines(part, layout) * half_tick)
            of_output.append(_lines(_remove_line(record, first, n), layout))
        begin = first - round(plan.start / plan.period)
        added.append(_lines(plan.effort[begin : begin + n][:, columns], layout) * half_tick)
        efforts.append(np.array(of_effort))
        outputs.append(np.array(of_output))
    return np.array(efforts), np.array(outputs), np.array(added)


def _remove_line(record: Record, first: int, ticks: int) -> Matrix:
    """Return the outputs of a period, joint positions without the line from end to end."""
    values = record.measured[first : first + ticks].copy()
    ends = record.measured[first + ticks] - record.measured[first]
    for k in record.columns(Quantity.JOINT_POSITION):
        values[:, k] -= ends[k] * np.arange(ticks) / ticks
    return np.asarray(values)


def _lines(values: Matrix, layout: _Layout) -> Complex:
    """Return the spectrum at the lines, (columns, lines)."""
    spectrum = np.fft.rfft(values, axis=0)[list(layout.lines)]
    return np.asarray(spectrum.T * 2.0 / len(values))
