"""Poles of a record that rings down, by variable projection."""

from typing import NamedTuple

import numpy as np
from scipy.optimize import least_squares

from flexslew_control.analysis.loop import Complex
from flexslew_plant.arrays import Matrix, Vector

_ROWS = 300  # of a record that are fitted
_SEEN = 1e-3  # of the largest channel: a smaller one is not fitted
_STEP = 1e-7  # of differences, in parts of a pole's distance from z = 1


class DecayFit(NamedTuple):
    """Poles of a record.

    Args:
        s: as they were found, with the imaginary part zero or positive, shape (k,) [rad/s].
        deviation: standard deviation of each, from what is left of the record, shape (k,) [rad/s].
        left: root mean square of what is left, of the record's [-].
    """

    s: Complex
    deviation: Vector
    left: float


def fit_decay(record: Matrix, period: float, start: Complex) -> DecayFit:
    """Return the poles of y(t) = sum of a_k exp(s_k t), least squares over s and a.

    The amplitudes are projected out (G. Golub and V. Pereyra, The differentiation of
    pseudo-inverses and nonlinear least squares problems whose variables separate, 1973).

    Args:
        record: shape (ticks, channels); each channel counts by its own size, those of less than
            a thousandth of the largest, in which rounding is seen, not at all.
        period: of the record [s].
        start: where to begin, one of each pair, imaginary part zero or positive, shape (k,)
            [rad/s].
    """
    sizes = np.linalg.norm(record, axis=0)
    seen = sizes > _SEEN * sizes.max(initial=0.0)
    y = record[:, seen] / sizes[seen]
    ticks = np.unique(np.linspace(0, len(y) - 1, min(len(y), _ROWS)).astype(int))
    time, y = period * ticks, y[ticks]
    wave = start.imag > 0.0
    scale = np.concatenate((abs(start), abs(start[wave])))

    def poles(x: Vector) -> Complex:
        s = start + scale[: len(start)] * x[: len(start)]
        s[wave] += 1j * scale[len(start) :] * x[len(start) :]
        return s

    def mismatch(x: Vector) -> Vector:
        s = poles(x)
        ends = np.where(s.real > 0.0, time[-1], 0.0)  # what grows is one at its end
        envelope = np.exp(np.clip((time[:, None] - ends) * s.real, -300.0, 300.0))
        phase = np.outer(time, s.imag[wave])
        columns = np.hstack((
            envelope[:, ~wave], envelope[:, wave] * np.cos(phase), envelope[:, wave] * np.sin(phase)
        ))  # fmt: skip
        sizes = np.linalg.norm(columns, axis=0)
        basis, _ = np.linalg.qr(columns / np.where(sizes > 0.0, sizes, 1.0))
        return np.asarray((y - basis @ (basis.T @ y)).ravel(), dtype=np.float64)

    found = least_squares(
        mismatch, np.zeros(len(scale)), method="trf", x_scale="jac",
        diff_step=np.full(len(scale), _STEP),
        xtol=1e-14, ftol=1e-14, gtol=1e-14, max_nfev=30,
    )  # fmt: skip
    left = float(np.sqrt(2.0 * found.cost / y.size))
    jacobian = np.asarray(found.jac, dtype=np.float64)
    information = np.linalg.pinv(jacobian.T @ jacobian, rcond=1e-30, hermitian=True)
    spread = scale * left * np.sqrt(np.maximum(np.diag(information), 0.0))
    deviation = spread[: len(start)].copy()
    deviation[wave] = np.hypot(deviation[wave], spread[len(start) :])
    return DecayFit(
        poles(found.x),
        np.asarray(deviation, dtype=np.float64),
        left / float(np.sqrt(np.mean(y**2))),
    )
