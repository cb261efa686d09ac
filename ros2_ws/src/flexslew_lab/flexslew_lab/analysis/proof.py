"""Margins and poles proved: what was predicted beside what the non-linear bench flies."""

from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from flexslew_control.analysis.linear_plant import Path, sampled_plant
from flexslew_control.analysis.loop import Complex, loop_of
from flexslew_control.analysis.ring_down import RingDown, ring_down
from flexslew_lab.analysis.analysis import Analysis
from flexslew_lab.analysis.pulse_flight import pulse_response, require_flyable
from flexslew_lab.analysis.record_poles import FADE, asked_poles, other_poles
from flexslew_lab.trial.trial import Trial
from flexslew_plant.arrays import Vector
from flexslew_plant.errors import BadInput

MARGIN, FREQUENCY, DAMPING = 0.02, 0.005, 0.05  # largest differences that agree, of the prediction

_BESIDE = 0.002  # how far inside and outside of a margin is flown, of it
_TURNS, _FEWEST, _MOST = 4.0, 400, 3000  # length of a record: turns of the pole; ticks
_TOLD_APART = 0.2  # a pole's deviation, of what it may differ by, at most


@dataclass(frozen=True)
class ProvedPole:
    """A pole of the loop as it is.

    Args:
        frequency, damping: predicted [rad/s], [-].
        flown_frequency, flown_damping: of the ring-down; nan: it does not tell this pole apart.
        agrees: within FREQUENCY and DAMPING; None: not told apart.
    """

    frequency: float
    damping: float
    flown_frequency: float
    flown_damping: float
    agrees: bool | None


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
        agrees: within MARGIN, and it grows faster outside than inside; None: not told apart.
    """

    channel: str
    kind: str
    predicted: float
    flown: float
    frequency: float
    flown_frequency: float
    inside: float
    outside: float
    agrees: bool | None


@dataclass(frozen=True)
class Proof:
    """What was predicted, and what was flown."""

    poles: tuple[ProvedPole, ...]
    margins: tuple[ProvedMargin, ...]

    @property
    def verdicts(self) -> list[bool | None]:
        """Whether each pole, then each margin, agrees."""
        return [pole.agrees for pole in self.poles] + [margin.agrees for margin in self.margins]

    @property
    def holds(self) -> bool:
        """Nothing that was told apart disagrees."""
        return False not in self.verdicts

    def plain(self) -> dict[str, Any]:
        """Return it as plain data."""
        return {
            "poles": [asdict(pole) for pole in self.poles],
            "margins": [asdict(margin) for margin in self.margins],
            "holds": self.holds,
        }


def proved(trial: Trial, analysis: Analysis) -> Proof:
    """Return the poles and the margins of an analysis beside those of the flown bench.

    Raises:
        BadInput: the loop is not stable, or its plant changes with time.
    """
    if not analysis.stable:
        raise BadInput("--prove: the loop is not stable: there is no margin to prove")
    require_flyable(analysis)
    flights = _Flights(trial, analysis)
    margins = []
    for channel, found in enumerate(analysis.efforts):
        asked = (
            ("gain up", found.gain_up, found.up_frequency),
            ("gain down", found.gain_down, found.down_frequency),
            ("delay", found.delay, found.delay_frequency),
        )
        margins += [
            flights.margin(channel, kind, size, frequency)
            for kind, size, frequency in asked
            if np.isfinite(size) and size > 0.0
        ]
    return Proof(flights.poles(), tuple(margins))


class _Flights:
    """Flights of the bench with faults, and what is predicted of each."""

    def __init__(self, trial: Trial, analysis: Analysis) -> None:
        self._trial, self._analysis = trial, analysis
        path, efforts = analysis.point.path, analysis.loop.efforts
        self._gain = np.ones(efforts) if path.gain is None else path.gain
        self._delay = np.zeros(efforts) if path.delay is None else path.delay

    def poles(self) -> tuple[ProvedPole, ...]:
        """Return the visible poles of the loop without a further fault."""
        s, found, asked = self._flown(self._gain, self._delay, None)
        together = _together(s, found.s)
        out = []
        for predicted, flown, deviation in zip(
            s[:asked], together[:asked], found.deviation[:asked], strict=True
        ):
            w, w_flown = float(abs(predicted)), float(abs(flown))
            damping, damping_flown = float(-predicted.real / w), float(-flown.real / w_flown)
            told = deviation <= _TOLD_APART * w * min(FREQUENCY, DAMPING * abs(damping))
            near = abs(w_flown - w) <= FREQUENCY * w and abs(
                damping_flown - damping
            ) <= DAMPING * abs(damping)
            none = float("nan")
            out.append(
                ProvedPole(w, damping, w_flown, damping_flown, bool(near))
                if told
                else ProvedPole(w, damping, none, none, None)
            )
        return tuple(out)

    def margin(self, channel: int, kind: str, size: float, frequency: float) -> ProvedMargin:
        """Return a margin, flown just inside and just outside of it."""
        outward = -1.0 if kind == "gain down" else 1.0
        sizes, growth, spread, at = [], [], [], []
        for side in (-1.0, 1.0):
            sizes.append(size * (1.0 + side * outward * _BESIDE))
            gain, delay = self._gain.copy(), self._delay.copy()
            if kind == "delay":
                delay[channel] += sizes[-1] / self._trial.period
            else:
                gain[channel] *= sizes[-1]
            s, found, _ = self._flown(gain, delay, frequency)
            critical = int(np.argmin(abs(s - 1j * frequency)))
            growth.append(float(found.s[critical].real))
            spread.append(float(found.deviation[critical]))
            at.append(float(abs(found.s[critical])))
        inside, outside = growth
        slope = (outside - inside) / (sizes[1] - sizes[0])
        flown = sizes[0] - inside / slope
        told = max(spread) <= _TOLD_APART * MARGIN * size * abs(slope)
        agrees = inside < outside and abs(flown - size) <= MARGIN * size
        return ProvedMargin(
            self._analysis.loop.effort_names[channel], kind, float(size), float(flown),
            float(frequency), at[0], inside, outside, bool(agrees) if told else None,
        )  # fmt: skip

    def _flown(self, gain: Vector, delay: Vector, w: float | None) -> tuple[Complex, RingDown, int]:
        """Return the poles predicted with these faults, those as flown, how many are the loop's.

        The others, which stand after them, are those of an estimator's error.

        Args:
            gain: of the motors, see Path.
            delay: of the motors, see Path [ticks].
            w: the frequency that matters [rad/s]; None: that of every pole.
        """
        period, point = self._trial.period, self._analysis.point
        path = Path(period, point.path.actuator, gain, delay)
        plant = sampled_plant(point.rest, path, applied=True)
        loop = loop_of(plant, self._analysis.running.form)
        asked = asked_poles(loop)
        s = _continuous(asked, period)
        slowest = float(min(abs(s))) if w is None else w
        ticks = int(np.clip(_TURNS * 2.0 * np.pi / slowest / period, _FEWEST, _MOST))
        begins = FADE + int(np.ceil(delay.max()))
        limits = np.asarray(self._trial.testbed.effort_limit)
        others = other_poles(loop, point.rest, limits, asked, begins, ticks)
        record = pulse_response(self._trial, self._analysis, begins + ticks, gain, delay)[begins:]
        every = np.concatenate((s, _continuous(others, period)))
        return every, ring_down(record, period, every), len(s)


def _together(predicted: Complex, flown: Complex) -> Complex:
    """Return the flown poles, those that no record tells apart moved alike.

    Of decays nearer to each other than they may differ, a record shows the mean and hardly the
    difference: each is its prediction, moved as their mean is.
    """
    near = abs(predicted[:, None] - predicted) <= FREQUENCY * abs(predicted)
    moved = near @ (flown - predicted) / near.sum(axis=1)
    return np.asarray(predicted + moved, dtype=np.complex128)


def _continuous(z: Complex, period: float) -> Complex:
    """Return poles in s, those that do not turn real [rad/s]."""
    s = np.log(z) / period
    return np.asarray(np.where(abs(s.imag) < 1e-9 * abs(s), s.real, s), dtype=np.complex128)
