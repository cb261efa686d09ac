"""Modes from measured frequency responses alone: poles of a rational fit, refined with intervals.

Every response of order d (0: displacement, 1: rate, 2: acceleration per effort) is, in the band,

    H(jw) = (jw)^d [ sum_i (R_i + jw S_i) / (w_i^2 - w^2 + 2 j zeta_i w_i w) - M / w^2 + K ],

with M for the rigid motion and modes below the band and K for modes above it (Ewins 2000, 4.3). The
poles start from a common denominator in z = exp(jwT) at every order (LSCF; Guillaume, Verboven and
Vanlanduit 1998; Peeters et al. 2004). Frequencies and damping ratios are then those of the least
squares of all responses, each weighed by its own noise, the rest eliminated (Golub and Pereyra
1973).
"""

from dataclasses import dataclass

import numpy as np
from scipy.optimize import least_squares

from flexslew_control.analysis.loop import Complex
from flexslew_lab.identification.modal.modes import FittedMode, interval
from flexslew_lab.identification.modal.oscillators import Oscillator, oscillators_of
from flexslew_lab.identification.modal.subspace import Poles, stable
from flexslew_plant.arrays import Matrix, Vector
from flexslew_plant.errors import BadInput

_ORDERS = tuple(range(4, 41, 2))  # of the common denominator
_MIN_LINES = 20
_NOISE_ROUNDS = 3
_SMALLEST = 1e-9  # noise of a response relative to its size, at least


@dataclass(frozen=True)
class MeasuredResponses:
    """Measured frequency responses of one bench.

    Args:
        frequency: of the lines, rising, above 0, (lines,) [rad/s].
        values: shape (lines, responses).
        orders: of derivative of each, 0 to 2, (responses,).
        outputs: name of what each measures.
        inputs: name of the effort of each.
        source: the file, for messages.
    """

    frequency: Vector
    values: Complex
    orders: tuple[int, ...]
    outputs: tuple[str, ...]
    inputs: tuple[str, ...]
    source: str

    def within(self, band: tuple[float, float]) -> "MeasuredResponses":
        """Return the lines of a band [rad/s]."""
        kept = (self.frequency >= band[0]) & (self.frequency <= band[1])
        return MeasuredResponses(
            self.frequency[kept], self.values[kept], self.orders, self.outputs, self.inputs,
            self.source,
        )  # fmt: skip


@dataclass(frozen=True)
class ResponseModel:
    """Modes of frequency responses.

    Args:
        responses: that were fitted.
        modes: rising; the shape is that of the responses' residues, largest 1.
        residues: R_i of every mode and response, (modes, responses).
        fitted: responses of the model at the lines, (lines, responses).
        noise: standard deviation of each response, real and imaginary part alike, (responses,).
    """

    responses: MeasuredResponses
    modes: tuple[FittedMode, ...]
    residues: Matrix
    fitted: Complex
    noise: Vector


def identify_responses(
    responses: MeasuredResponses, band: tuple[float, float] | None
) -> ResponseModel:
    """Return the modes of frequency responses with their intervals.

    Args:
        responses: measured.
        band: that is fitted [rad/s]; None: all lines.

    Raises:
        BadInput: if the band has less than twenty lines, or no mode is found.
    """
    if band is not None:
        responses = responses.within(band)
    w = responses.frequency
    if len(w) < _MIN_LINES:
        raise BadInput(
            f"{responses.source}: {len(w)} lines in the band are not enough; at least "
            f"{_MIN_LINES} are needed"
        )
    modes = stable(common_poles(responses), float(w[0]), float(w[-1]))
    noise = np.abs(responses.values).std(axis=0) + 1e-300
    modes, noise = _refined(responses, modes, noise)
    modes, noise = _pruned(responses, modes, noise)
    if not modes:
        raise BadInput(f"{responses.source}: no mode explains its responses in {w[0]:.4g} to "
                       f"{w[-1]:.4g} rad/s")  # fmt: skip
    return _model(responses, modes, noise)


def common_poles(responses: MeasuredResponses) -> Poles:
    """Return the poles of a common denominator in z for every order."""
    w = responses.frequency
    period = np.pi / w[-1]
    size = np.abs(responses.values).std(axis=0) + 1e-300
    values = responses.values / size
    found = {}
    for order in (one for one in _ORDERS if 2 * one < len(w)):
        x = np.exp(1j * period * np.outer(w, np.arange(order + 1)))
        r = (x.conj().T @ x).real
        m = np.zeros((order + 1, order + 1))
        for column in values.T:
            y = -column[:, None] * x
            s = (x.conj().T @ y).real
            m += (y.conj().T @ y).real - s.T @ np.linalg.solve(r + 1e-12 * np.trace(r) * np.eye(
                order + 1), s)  # fmt: skip
        # the coefficient of z^0 is 1: poles of the noise are then unstable, those of modes are not
        a = np.linalg.lstsq(m[1:, 1:], -m[1:, 0], rcond=None)[0]
        z = np.roots(np.concatenate((a[::-1], [1.0])))
        s_poles = np.log(z[np.abs(z) > 1e-9]) / period
        found[order] = oscillators_of(s_poles[s_poles.real < 0.0])
    return Poles("LSCF", found)


def _columns(w: Vector, order: int, modes: tuple[Oscillator, ...]) -> Complex:
    """Return what a response of an order is linear in: R and S of every mode, then M and K."""
    s = 1j * w
    parts = []
    for mode in modes:
        one = 1.0 / (mode.frequency**2 - w**2 + 2.0 * mode.damping_ratio * mode.frequency * s)
        parts += [mode.frequency**2 * one, mode.frequency * s * one]
    parts += [-((w[0] / w) ** 2) + 0j, np.ones_like(s)]
    return np.asarray(s[:, None] ** order * np.column_stack(parts))


def _real(values: Complex) -> Matrix:
    return np.concatenate((values.real, values.imag))


def _solved(responses: MeasuredResponses, modes: tuple[Oscillator, ...]) -> tuple[Matrix, Complex]:
    """Return the weights of every response, (2 modes + 2, responses), and the fit."""
    fitted = np.empty_like(responses.values)
    weights = np.empty((2 * len(modes) + 2, len(responses.orders)))
    for k, order in enumerate(responses.orders):
        columns = _columns(responses.frequency, order, modes)
        scale = np.linalg.norm(columns, axis=0)
        solved = np.linalg.lstsq(_real(columns / scale), _real(responses.values[:, k]), rcond=None)
        weights[:, k] = solved[0] / scale
        fitted[:, k] = columns @ weights[:, k]
    return weights, fitted


def _refined(
    responses: MeasuredResponses, modes: tuple[Oscillator, ...], noise: Vector
) -> tuple[tuple[Oscillator, ...], Vector]:
    """Return the modes of least squares and the noise of every response."""
    for _ in range(_NOISE_ROUNDS):
        if modes:
            found = least_squares(_residual, _numbers(modes), method="lm", x_scale="jac",
                                  args=(responses, noise))  # fmt: skip
            modes = _oscillators(found.x)
        noise = _noise(responses, modes)
    return modes, noise


def _numbers(modes: tuple[Oscillator, ...]) -> Vector:
    return np.array([(np.log(m.frequency), m.damping_ratio) for m in modes]).ravel()


def _oscillators(numbers: Vector) -> tuple[Oscillator, ...]:
    pairs = sorted(numbers.reshape(-1, 2).tolist())
    return tuple(Oscillator(float(np.exp(w)), float(zeta)) for w, zeta in pairs)


def _residual(numbers: Vector, responses: MeasuredResponses, noise: Vector) -> Vector:
    modes = tuple(Oscillator(float(np.exp(w)), float(z)) for w, z in numbers.reshape(-1, 2))
    left = (responses.values - _solved(responses, modes)[1]) / noise
    return np.asarray(_real(left).ravel())


def _noise(responses: MeasuredResponses, modes: tuple[Oscillator, ...]) -> Vector:
    left = responses.values - _solved(responses, modes)[1]
    freedom = max(2 * len(left) - 2 * len(modes) - 2 - 2 * len(modes) / left.shape[1], 1.0)
    noise = np.sqrt((np.abs(left) ** 2).sum(axis=0) / freedom)
    return np.asarray(np.maximum(noise, _SMALLEST * np.abs(responses.values).max(axis=0) + 1e-300))


def _pruned(
    responses: MeasuredResponses, modes: tuple[Oscillator, ...], noise: Vector
) -> tuple[tuple[Oscillator, ...], Vector]:
    """Return the modes without those that do not pay for their parameters (Schwarz)."""
    rows = 2 * responses.values.size
    price = 0.5 * np.log(rows) * (2 + 2 * len(responses.orders))
    while modes:
        gains = []
        for mode in modes:
            others = tuple(one for one in modes if one is not mode)
            gain = np.log(_noise(responses, others) / noise).sum() * 2 * len(responses.frequency)
            gains.append(float(gain))
        least = int(np.argmin(gains))
        grows = [k for k, mode in enumerate(modes) if not 0.0 < mode.damping_ratio < 1.0]
        if gains[least] > price and not grows:
            break
        gone = modes[grows[0] if grows else least]
        modes, noise = _refined(responses, tuple(m for m in modes if m is not gone), noise)
    return modes, noise


def _model(
    responses: MeasuredResponses, modes: tuple[Oscillator, ...], noise: Vector
) -> ResponseModel:
    found = least_squares(_residual, _numbers(modes), method="lm", x_scale="jac",
                          args=(responses, noise))  # fmt: skip
    modes = _oscillators(found.x)
    slopes = np.asarray(found.jac, dtype=np.float64)
    covariance = np.linalg.pinv(slopes.T @ slopes)
    spread = np.sqrt(np.diag(covariance)).reshape(-1, 2)[np.argsort(found.x[::2])]
    weights, fitted = _solved(responses, modes)
    inputs = tuple(dict.fromkeys(responses.inputs))
    fitted_modes = []
    residues = np.array([weights[2 * k] * m.frequency**2 for k, m in enumerate(modes)])
    for mode, (of_log, of_damping), row in zip(modes, spread, residues, strict=True):
        largest = float(row[int(np.argmax(np.abs(row)))]) or 1.0
        drive = [max(abs(r) for r, i in zip(row, responses.inputs, strict=True) if i == name)
                 for name in inputs]  # fmt: skip
        fitted_modes.append(
            FittedMode(
                interval(mode.frequency, mode.frequency * float(of_log)),
                interval(mode.damping_ratio, float(of_damping)),
                float(mode.frequency / np.diff(responses.frequency).min()),
                np.array(drive) / max(drive),
                row / largest,
            )
        )
    return ResponseModel(responses, tuple(fitted_modes), residues, fitted, noise)
