"""Margins and poles proved: the predictions against flights of the non-linear bench."""

from dataclasses import asdict, dataclass, replace
from typing import Any

import numpy as np
from scipy.sparse import csc_array
from scipy.sparse.linalg import eigs

from flexslew_control.analysis.linear_plant import PlantPath, sampled_plant
from flexslew_control.analysis.loop import Complex, ControlLoop, loop_of, visible_poles
from flexslew_control.analysis.ring_down import fit_decay
from flexslew_lab.analysis.analysis import Analysis
from flexslew_lab.analysis.mode_flight import mode_response, require_same_bench
from flexslew_lab.short_values import short
from flexslew_lab.trial.trial import Trial
from flexslew_plant.arrays import Vector
from flexslew_plant.errors import BadInput
from flexslew_plant.faults.actuators import MOST_TICKS
from flexslew_plant.notebook_table import in_notebook

MARGIN, FREQUENCY, DAMPING = 0.02, 0.005, 0.05  # largest differences that agree, of the prediction

_MARGIN_OFFSET = 0.01  # how far inside and outside of a margin is flown, of it
_PERIODS, _MIN_TICKS, _MOST = 1.0, 12, 1500  # length of a record: turns of the pole; ticks
_DECAY_TIMES = 7.0  # longest record of a pole that decays, in its time constants
_LEFT = 0.01  # of a record that is not its one pole, at most
_VISIBLE = 1e-6  # strength of a pole that is flown
_REAL = 1e-9  # imaginary part of a pole that is real, of its size
_FAST_POLE = 0.05  # z of a pole that is gone after a few ticks


@dataclass(frozen=True)
class ProvedPole:
    """A pole of the loop as it is.

    Args:
        frequency, damping: predicted [rad/s], [-].
        flown_frequency, flown_damping: of the ring-down of a bench that starts on its mode.
        left: of the record that is not this one pole, root mean square [-].
        agrees: within FREQUENCY and DAMPING, and the record is this one pole.
    """

    frequency: float
    damping: float
    flown_frequency: float
    flown_damping: float
    left: float
    agrees: bool


@dataclass(frozen=True)
class ProvedMargin:
    """A margin of an effort's loop.

    Args:
        channel: the effort.
        kind: gain up, gain down or delay.
        predicted: factor [-], or delay [s].
        flown: where the growth of the critical pole, flown inside and outside, is zero.
        frequency: of that pole, predicted at the margin [rad/s].
        flown_frequency: flown inside of it [rad/s].
        inside, outside: growth of that pole there [1/s]: decays, grows.
        left: of the records that is not this one pole, root mean square [-].
        agrees: within MARGIN, it decays inside and grows outside, and is all of the record.
    """

    channel: str
    kind: str
    predicted: float
    flown: float
    frequency: float
    flown_frequency: float
    inside: float
    outside: float
    left: float
    agrees: bool


@dataclass(frozen=True, repr=False)
class Proof:
    """What was predicted, and what was flown.

    Args:
        poles, margins: that were flown.
        skipped: in words, margins beyond what a fault can do to the bench.
    """

    poles: tuple[ProvedPole, ...]
    margins: tuple[ProvedMargin, ...]
    skipped: tuple[str, ...] = ()

    def __repr__(self) -> str:
        """Return one line: how many of what was predicted were flown."""
        poles = f"{sum(pole.agrees for pole in self.poles)} of {len(self.poles)} poles"
        margins = f"{sum(margin.agrees for margin in self.margins)} of {len(self.margins)} margins"
        more = "".join(f"; not flown: {words}" for words in self.skipped)
        return f"<Proof: {poles} and {margins} flown as predicted{more}>"

    def _repr_html_(self) -> str:
        """Return the table of predictions and flights, for notebooks."""
        rows = [
            (f"{m.channel}: {m.kind}", short(m.predicted), short(m.flown), m.agrees)
            for m in self.margins
        ]
        rows += [
            (f"pole: {what}", short(predicted), short(measured), pole.agrees)
            for pole in self.poles
            for what, predicted, measured in (
                ("frequency [rad/s]", pole.frequency, pole.flown_frequency),
                ("damping [-]", pole.damping, pole.flown_damping),
            )
        ]
        words = ("", "predicted", "flown", "agrees")
        return in_notebook(repr(self), words, ((*row, "yes" if ok else "NO") for *row, ok in rows))

    @property
    def checks(self) -> list[bool]:
        """Whether each pole, then each margin, agrees."""
        return [pole.agrees for pole in self.poles] + [margin.agrees for margin in self.margins]

    @property
    def holds(self) -> bool:
        """Everything agrees."""
        return all(self.checks)

    def plain(self) -> dict[str, Any]:
        """Return it as plain data."""
        return {
            "poles": [asdict(pole) for pole in self.poles],
            "margins": [asdict(margin) for margin in self.margins],
            "not_flown": list(self.skipped),
            "holds": self.holds,
        }


def verify_margins(trial: Trial, analysis: Analysis) -> Proof:
    """Return the poles and the margins of an analysis together with those of the flown bench.

    Raises:
        BadInput: if the loop is not stable, its plant changes with time, or the trial has another.
    """
    if not analysis.stable:
        raise BadInput("--prove: the loop is not stable: there is no margin to prove")
    require_same_bench(trial, analysis)
    simulator = _BenchSimulator(trial, analysis)
    margins, excluded = [], []
    for channel, found in enumerate(analysis.efforts):
        candidates = (
            ("gain up", found.gain_up, found.up_frequency),
            ("gain down", found.gain_down, found.down_frequency),
            ("delay", found.delay, found.delay_frequency),
        )
        margins += [
            simulator.margin(channel, kind, size, frequency)
            for kind, size, frequency in candidates
            if np.isfinite(size) and size > 0.0 and simulator.can(channel, kind, size)
        ]
        if np.isfinite(found.delay) and not simulator.can(channel, "delay", found.delay):
            excluded.append(
                f"{found.name}: delay of {found.delay:.4g} s, above {MOST_TICKS:g} ticks"
            )
    return Proof(simulator.poles(), tuple(margins), tuple(excluded))


class _BenchSimulator:
    """Flights of the bench with faults, and what is predicted of each."""

    def __init__(self, trial: Trial, analysis: Analysis) -> None:
        self._trial, self._analysis = trial, analysis
        path, efforts = analysis.point.path, analysis.loop.efforts
        self._gain = np.ones(efforts) if path.gain is None else path.gain
        self._delay = np.zeros(efforts) if path.delay is None else path.delay

    def poles(self) -> tuple[ProvedPole, ...]:
        """Return the visible poles of the loop without a further fault."""
        path, loop = self._with_faults(self._gain, self._delay)
        out = []
        for s, mode in _modes(loop, _VISIBLE):
            measured, left = measured_pole(self._trial, self._analysis, loop, path, s, mode)
            w, w_measured = float(abs(s)), float(abs(measured))
            damping, damping_measured = float(-s.real / w), float(-measured.real / w_measured)
            near = (
                abs(w_measured - w) <= FREQUENCY * w
                and abs(damping_measured - damping) <= DAMPING * abs(damping)
                and left <= _LEFT
            )
            out.append(ProvedPole(w, damping, w_measured, damping_measured, left, bool(near)))
        return tuple(out)

    def can(self, channel: int, kind: str, size: float) -> bool:
        """Return whether a fault can take the bench just outside of a margin."""
        late = self._delay[channel] + size * (1.0 + _MARGIN_OFFSET) / self._trial.period
        return kind != "delay" or bool(late <= MOST_TICKS)

    def margin(self, channel: int, kind: str, size: float, frequency: float) -> ProvedMargin:
        """Return a margin, flown just inside and just outside of it."""
        direction = -1.0 if kind == "gain down" else 1.0
        sizes, real_parts, residuals, at = [], [], [], []
        for side in (-1.0, 1.0):
            sizes.append(size * (1.0 + side * direction * _MARGIN_OFFSET))
            gain, delay = self._gain.copy(), self._delay.copy()
            if kind == "delay":
                delay[channel] += sizes[-1] / self._trial.period
            else:
                gain[channel] *= sizes[-1]
            path, loop = self._with_faults(gain, delay)
            s, mode = mode_near(loop, frequency)
            measured, left = measured_pole(self._trial, self._analysis, loop, path, s, mode)
            real_parts.append(float(measured.real))
            residuals.append(left)
            at.append(float(abs(measured)))
        inside, outside = real_parts
        measured_margin = float(sizes[0] - inside / (outside - inside) * (sizes[1] - sizes[0]))
        agrees = (
            inside < 0.0 < outside
            and abs(measured_margin - size) <= MARGIN * size
            and max(residuals) <= _LEFT
        )
        return ProvedMargin(
            self._analysis.loop.effort_names[channel], kind, float(size), measured_margin,
            float(frequency), at[0], inside, outside, max(residuals), bool(agrees),
        )  # fmt: skip

    def _with_faults(self, gain: Vector, delay: Vector) -> tuple[PlantPath, ControlLoop]:
        """Return a path with these gains and delays of the motors, and the loop predicted."""
        point = self._analysis.point
        path = replace(point.path, gain=gain, delay=delay)
        plant = sampled_plant(point.rest, path, applied=True)
        return path, loop_of(plant, self._analysis.running.form)


def measured_pole(
    trial: Trial, analysis: Analysis, loop: ControlLoop, path: PlantPath, s: complex, mode: Complex
) -> tuple[complex, float]:
    """Return the pole [rad/s] that the bench rings down with, and what it leaves [-].

    Args:
        trial: what flies, see mode_response.
        analysis: of that trial.
        loop: predicted, closed.
        path: gains and delays that faults add.
        s: predicted pole [rad/s].
        mode: its eigenvector, shape (states,).
    """
    period = trial.period
    ticks = int(np.clip(_PERIODS * 2.0 * np.pi / (abs(s) * period), _MIN_TICKS, _MOST))
    if abs(s.real) > 0.0:
        ticks = max(_MIN_TICKS, min(ticks, int(_DECAY_TIMES / (abs(s.real) * period))))
    record = mode_response(trial, analysis, loop, path, mode, ticks)
    found = fit_decay(record, period, np.array([s]))
    return complex(found.s[0]), found.left


def mode_near(loop: ControlLoop, frequency: float) -> tuple[complex, Complex]:
    """Return the pole [rad/s] of the closed loop nearest to a frequency [rad/s], and its mode.

    By inverse iteration, as the queue of a long delay has thousands of states, one entry a row.
    """
    closed = loop.closed
    near = np.exp(1j * frequency * closed.period)
    found, modes = eigs(csc_array(closed.a), k=1, sigma=near, v0=np.ones(len(closed.a)))
    z, mode = complex(found[0]), modes[:, 0]
    mode = mode / mode[np.argmax(abs(mode))]  # real where the pole is
    if abs(z.imag) < _REAL * abs(z):
        z = complex(z.real, 0.0)
    return complex(np.log(z) / closed.period), mode


def _modes(loop: ControlLoop, strength: float) -> list[tuple[complex, Complex]]:
    """Return poles [rad/s], one of each pair, and their modes, the slowest first.

    Args:
        loop: closed.
        strength: of their residues between efforts and sensors, of the strongest, at least [-].
    """
    closed = loop.closed
    visible, _ = visible_poles(loop, strength)
    z, right = np.linalg.eig(closed.a)
    out = []
    for value, mode in zip(z, right.T, strict=True):
        if value.imag < 0.0 or abs(value) < _FAST_POLE or value not in visible:
            continue
        s = complex(np.log(complex(value)) / closed.period)
        real = abs(s.imag) < _REAL * abs(s)
        out.append((complex(s.real, 0.0 if real else s.imag), mode))
    return sorted(out, key=lambda pair: abs(pair[0]))
