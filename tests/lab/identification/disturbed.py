"""Records as public ones are: motion that no effort explains, and a spring that stiffens."""

import numpy as np
from scipy.signal import lfilter

from flexslew_lab.identification.modal.oscillators import Oscillator
from flexslew_lab.identification.records.record import Output, Quantity, Record
from flexslew_plant.arrays import Vector

ARM = (Oscillator(0.367, 0.0035), Oscillator(0.797, 0.0045))  # [rad/sample]
SPRING = Oscillator(436.75, 0.0488)  # [rad/s]
RATE = 610.35  # [1/s]


def arm_record(seed: int, ticks: int = 1024, disturbance: float = 0.05) -> Record:
    """Return an acceleration of two lightly damped modes, disturbed, with coloured noise.

    The disturbance is a second effort of white noise, which is not measured.

    Args:
        seed: of effort, disturbance and noise.
        ticks: of one second.
        disturbance: its deviation relative to that of the effort.
    """
    rng = np.random.default_rng((seed, 41))
    band = lfilter([1.0], [1.0, -0.5], rng.standard_normal(ticks + 200))[200:]
    efforts = np.column_stack((band, disturbance * rng.standard_normal(ticks)))
    clean = np.zeros(ticks + 1)
    for mode, gains in zip(ARM, ((1.0, 0.6), (-0.7, 0.9)), strict=True):
        q, rate = (x[:, :2] / mode.frequency**2 for x in mode.responses(efforts, 1.0))
        held = np.vstack((efforts, efforts[-1:]))
        drag = 2.0 * mode.damping_ratio * mode.frequency
        clean += (held - drag * rate - mode.frequency**2 * q) @ np.array(gains)
    noise = lfilter([1.0], [1.0, -0.8], rng.standard_normal(ticks + 201))[200:]
    measured = clean + 0.005 * clean.std() * noise
    output = Output("acc.tip", "m/s^2", Quantity.ACCELERATION)
    limit = np.array([np.inf])
    return Record(1.0, efforts[:, :1], measured[:, None], ("hub",), (output,), "arm", limit)


def spring_record(seed: int, ticks: int = 8192, stiffening: float = 0.02) -> Record:
    """Return the position of an oscillator with a cubic spring, excited by an odd multisine.

    It is integrated with eight steps per tick, the effort held (Runge-Kutta of fourth order).

    Args:
        seed: of the phases and the noise.
        ticks: of the record, one period of the multisine.
        stiffening: force of the cubic part relative to that of the spring, at one deviation.
    """
    rng = np.random.default_rng((seed, 43))
    lines = np.arange(1, int(ticks * 200.0 / RATE), 2)
    spectrum = np.zeros(ticks // 2 + 1, dtype=complex)
    spectrum[lines] = np.exp(1j * rng.uniform(0.0, 2.0 * np.pi, lines.size))
    u = np.fft.irfft(spectrum, ticks)
    u /= u.std()
    linear = SPRING.responses(u[:, None], 1.0 / RATE)[0][:, 0]  # times w^2
    q = _stiffening_response(u, stiffening / float(linear.std()) ** 2)
    noisy = q + 1e-3 * q.std() * rng.standard_normal(q.size)
    output = Output("y", "V", Quantity.DEFLECTION)
    limit = np.array([np.inf])
    return Record(1.0 / RATE, u[:, None], noisy[:, None], ("u",), (output,), "spring", limit)


def _stiffening_response(u: Vector, cubic: float) -> Vector:
    """Return q of q'' + 2 zeta w q' + w^2 (q + cubic q^3) = w^2 u at the ticks, from rest."""
    w, drag = SPRING.frequency, 2.0 * SPRING.damping_ratio * SPRING.frequency
    h = 1.0 / RATE / 8

    def slope(x: float, v: float, force: float) -> tuple[float, float]:
        return v, w * w * (force - x - cubic * x**3) - drag * v

    x = v = 0.0
    found = [x]
    for force in u.tolist():
        for _ in range(8):
            a1, b1 = slope(x, v, force)
            a2, b2 = slope(x + 0.5 * h * a1, v + 0.5 * h * b1, force)
            a3, b3 = slope(x + 0.5 * h * a2, v + 0.5 * h * b2, force)
            a4, b4 = slope(x + h * a3, v + h * b3, force)
            x += h / 6.0 * (a1 + 2.0 * a2 + 2.0 * a3 + a4)
            v += h / 6.0 * (b1 + 2.0 * b2 + 2.0 * b3 + b4)
        found.append(x)
    return np.array(found)
