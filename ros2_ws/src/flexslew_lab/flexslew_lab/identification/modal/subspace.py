"""Poles of a record for every order, by subspace identification and by OKID with ERA.

The modal fit starts from them, and a stabilisation diagram shows them: a mode of the bench is
found again at every order, a pole of the noise is not. MOESP is SLICOT's (IB01AD, IB01BD; Van
Overschee and De Moor 1996, chapter 4); OKID is the observer of Juang, Phan, Horta and Longman
(1993); ERA turns its Markov parameters into a state space (Juang and Pappa 1985).
"""

from collections.abc import Callable
from typing import NamedTuple, TypeAlias

import numpy as np

from flexslew_lab.identification.modal.oscillators import Oscillator, oscillators_of
from flexslew_lab.identification.records.record import Quantity, Record
from flexslew_plant.arrays import Matrix
from flexslew_plant.errors import BadInput
from flexslew_plant.extras import install_command

_SAMPLES = 5.0  # per period of the highest frequency of the band, at least
_BLOCK_ROWS = 30
_MARKOV = 200  # parameters that ERA gets
_OBSERVER = 30  # past samples of the observer
_MAX_DAMPING = 0.3
_SAME = 0.02  # relative distance within which two poles are one mode
_ORDER_SHARE = 0.5  # part of the orders in which a mode must be found


class Poles(NamedTuple):
    """What one method found."""

    method: str
    by_order: dict[int, tuple[Oscillator, ...]]


class ResampledRecord(NamedTuple):
    """A record at the rate that its band needs."""

    effort: Matrix  # (samples, inputs)
    measured: Matrix  # (samples, outputs)
    bounded: Matrix  # outputs with a bounded impulse response: rates, not positions
    period: float  # [s]
    feedthrough: bool  # whether an effort reaches an output at once


Method: TypeAlias = Callable[[ResampledRecord, tuple[int, ...]], Poles]


def resample(record: Record, highest: float) -> ResampledRecord:
    """Return a record with few samples per period of the band's end.

    Efforts are means over many ticks, outputs are read at their ends: the slow record is causal
    like the fast one, and its noise is as white, which a filter's would not be.

    Args:
        record: of the experiment.
        highest: frequency of the band [rad/s].
    """
    factor = max(int(2.0 * np.pi / (highest * _SAMPLES * record.period)), 1)
    effort = record.effort / record.effort.std(axis=0)
    measured = record.measured[:-1] - record.measured[:-1].mean(axis=0)
    spread = measured.std(axis=0)
    measured = measured / np.where(spread > 0.0, spread, 1.0)
    effort = _means(effort, factor)
    measured = measured[: len(effort) * factor : factor]
    period = factor * record.period
    drift = record.columns(Quantity.JOINT_POSITION)
    rates = measured.copy()
    for k in drift:  # by differences where no sensor gives the rate
        rates[:, k] = np.gradient(measured[:, k])
        rates[:, k] /= max(float(rates[:, k].std()), 1e-300)
    measured_rates = {record.outputs[k].joint for k in record.columns(Quantity.JOINT_RATE)}
    kept = [
        k for k, o in enumerate(record.outputs) if k not in drift or o.joint not in measured_rates
    ]
    return ResampledRecord(
        np.asfortranarray(effort),
        np.asfortranarray(measured),
        rates[:, kept],
        period,
        bool(record.columns(Quantity.ACCELERATION)),
    )


def _means(values: Matrix, factor: int) -> Matrix:
    """Return the means of `factor` rows each."""
    rows = len(values) // factor
    return np.asarray(values[: rows * factor].reshape(rows, factor, -1).mean(axis=1))


def moesp(record: ResampledRecord, orders: tuple[int, ...]) -> Poles:
    """Return the poles of every order by MOESP.

    Raises:
        BadInput: ctrlsys is not installed.
    """
    try:
        import ctrlsys
    except ModuleNotFoundError:
        raise BadInput(
            f"subspace identification needs the package ctrlsys: {install_command('ctrlsys')}"
        ) from None
    inputs, outputs = record.effort.shape[1], record.measured.shape[1]
    rows = min(_BLOCK_ROWS, len(record.effort) // (4 * (inputs + outputs + 1)))
    _, r, _, _, failed = ctrlsys.ib01ad(
        "M",
        "Q",
        "M",
        "O",
        "N",
        "N",
        rows,
        inputs,
        outputs,
        record.effort,
        record.measured,
        0.0,
        0.0,
    )
    found = {}
    for order in orders if not failed else ():
        if order >= rows:
            continue
        out = ctrlsys.ib01bd(
            "M", "C", "N", rows, order, inputs, outputs, len(record.effort), r.copy(order="F"), 0.0
        )
        if not out[-1]:
            found[order] = modes_of(np.asarray(out[0])[:order, :order], record.period)
    return Poles("MOESP", found)


def okid_era(record: ResampledRecord, orders: tuple[int, ...]) -> Poles:
    """Return the poles of every order by ERA from the Markov parameters of an observer."""
    import control

    parameters = markov_parameters(record)
    found = {}
    for order in orders:
        system, _ = control.eigensys_realization(
            parameters, order, m=_MARKOV // 2 - 1, n=_MARKOV // 2 - 1
        )
        found[order] = modes_of(np.asarray(system.A), record.period)
    return Poles("OKID/ERA", found)


def markov_parameters(record: ResampledRecord) -> np.ndarray:
    """Return D, CB, CAB, ... by an observer's ARX model, shape (outputs, inputs, parameters)."""
    u, y = record.effort, record.bounded
    inputs, outputs, lags = u.shape[1], y.shape[1], _OBSERVER
    past = [u[lags:]] if record.feedthrough else []
    for k in range(1, lags + 1):
        past += [u[lags - k : -k], y[lags - k : -k]]
    found = np.linalg.lstsq(np.hstack(past), y[lags:], rcond=None)[0].T
    width = inputs + outputs
    direct: Matrix = np.zeros((outputs, inputs))
    if record.feedthrough:
        direct = np.asarray(found[:, :inputs], dtype=np.float64)
        found = found[:, inputs:]
    observer = [found[:, k * width : (k + 1) * width] for k in range(lags)]
    system = [direct]
    for k in range(1, _MARKOV):
        parameter = observer[k - 1][:, :inputs] if k <= lags else np.zeros((outputs, inputs))
        for i in range(1, min(k, lags) + 1):
            parameter = parameter + observer[i - 1][:, inputs:] @ system[k - i]
        system.append(np.asarray(parameter))
    return np.stack(system, axis=2)


def arx(record: ResampledRecord, orders: tuple[int, ...]) -> Poles:
    """Return the poles of y(k) = sum A_i y(k - i) + B_i u(k - i) + e(k) by least squares.

    They are consistent where the noise has the poles of the bench, as motion that no effort
    explains has (Ljung 1999, 4.2); at high orders also with other colours.
    """
    u, y = record.effort, record.bounded
    inputs, outputs = u.shape[1], y.shape[1]
    found = {}
    for order in orders:
        past = [u[order:], *(x[order - k : -k] for k in range(1, order + 1) for x in (u, y))]
        weights = np.linalg.lstsq(np.hstack(past), y[order:], rcond=None)[0].T
        companion = np.eye(order * outputs, k=-outputs)
        for k in range(order):
            first = 2 * inputs + k * (inputs + outputs)  # past the efforts now and of this lag
            companion[:outputs, k * outputs : (k + 1) * outputs] = weights[
                :, first : first + outputs
            ]
        found[order] = modes_of(companion, record.period)
    return Poles("ARX", found)


METHODS: dict[str, Method] = {"MOESP": moesp, "OKID/ERA": okid_era}


def modes_of(transition: Matrix, period: float) -> tuple[Oscillator, ...]:
    """Return the oscillating poles of x(k + 1) = A x(k) as oscillators, rising."""
    poles = np.linalg.eigvals(transition)
    poles = poles[(poles.imag > 0.0) & (np.abs(poles) > 1e-9)]
    return oscillators_of(np.log(poles) / period)


def stable(poles: Poles, low: float, high: float) -> tuple[Oscillator, ...]:
    """Return the modes that are found again as the order rises, rising.

    Args:
        poles: of one method.
        low: lowest frequency to look at [rad/s].
        high: highest [rad/s].
    """
    groups: list[list[tuple[int, Oscillator]]] = []
    for order, modes in sorted(poles.by_order.items()):
        for mode in modes:
            if not (low <= mode.frequency <= high and -0.05 < mode.damping_ratio < _MAX_DAMPING):
                continue
            near = [g for g in groups if _same(g[-1][1], mode)]
            if near:
                near[0].append((order, mode))
            else:
                groups.append([(order, mode)])
    kept = []
    last = max(poles.by_order, default=0)
    for group in groups:
        first = group[0][0]
        possible = sum(1 for order in poles.by_order if first <= order <= last)
        orders = {order for order, _ in group}
        if len(orders) >= max(_ORDER_SHARE * possible, 2):
            kept.append(
                Oscillator(
                    float(np.median([m.frequency for _, m in group])),
                    float(np.clip(np.median([m.damping_ratio for _, m in group]), 1e-4, 0.3)),
                )
            )
    return tuple(sorted(kept, key=lambda mode: mode.frequency))


def _same(one: Oscillator, other: Oscillator) -> bool:
    return abs(one.frequency - other.frequency) < _SAME * one.frequency
