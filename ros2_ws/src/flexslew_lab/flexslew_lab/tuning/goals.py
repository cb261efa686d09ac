"""Goals of a tuning as numbers of a closed loop: at most one where they are met."""

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
from scipy.signal import cont2discrete

from flexslew_lab.tuning.channels import (
    COMMAND,
    EFFORT,
    ERROR,
    MEASURED,
    PlantChannels,
    with_weights,
)
from flexslew_lab.tuning.closed_loop import ClosedLoop, PerformancePlant
from flexslew_lab.tuning.norms import Measure, Norm, damping, decay, h_infinity, h_two
from flexslew_lab.tuning.settings import (
    BandwidthGoal,
    GainGoal,
    Goal,
    MarginGoal,
    PoleGoal,
    RollOffGoal,
    TrackingGoal,
)
from flexslew_plant.arrays import Matrix, Vector
from flexslew_plant.errors import BadInput

_FLAT = 1e-3  # share of a corner below which a weight is constant [-]

_Filter = tuple[Matrix, Matrix, Matrix, Matrix]


@dataclass(frozen=True)
class GoalChannels:
    """From where to where a goal looks, and what it measures there.

    Args:
        sources: names of w.
        targets: names of z.
        norm: of the weighted loop from w to z.
        scale: factor on the norm; at most one in all: met.
        weight: of every z, A, B, C, D, or None.
        offset: what is added to the loop from w to z on its diagonal.
    """

    sources: tuple[str, ...]
    targets: tuple[str, ...]
    norm: Norm
    scale: float
    weight: _Filter | None = None
    offset: float = 0.0

    def plant(
        self, channels: PlantChannels, signals: Sequence[str], efforts: Sequence[str],
        scaling: Vector | None = None,
    ) -> PerformancePlant:  # fmt: skip
        """Return the plant of this goal, without its weight.

        Args:
            channels: of a model.
            signals: what the controller reads.
            efforts: what it commands.
            scaling: D of D (S - 1/2) / D, shape (channels,), or None.
        """
        plant = channels.between(self.sources, self.targets, signals, efforts)
        d, count = plant.d.copy(), len(self.targets)
        if self.offset:
            d[:count, :count] += self.offset * np.eye(count)
        scaled = PerformancePlant(
            plant.a, plant.b, plant.c, d, plant.controls, plant.measurements, plant.period
        )
        if scaling is not None:
            scaled = _with_scaling(scaled, scaling)
        return scaled

    def weighted(self, plant: PerformancePlant) -> PerformancePlant:
        """Return a plant with the weight of this goal on its outputs z.

        Poles of weights are near the limit of stability: a plant is reduced before.
        """
        return plant if self.weight is None else with_weights(plant, self.weight)

    def measure(self, loop: ClosedLoop) -> Measure:
        """Return the number of the goal with its gradient."""
        found = self.norm(loop)
        return Measure(self.scale * found.value, self.scale * found.gradient, found.frequency)


def _with_scaling(plant: PerformancePlant, scaling: Vector) -> PerformancePlant:
    rows = np.concatenate((scaling, np.ones(len(plant.d) - scaling.size)))
    columns = np.concatenate((1.0 / scaling, np.ones(plant.d.shape[1] - scaling.size)))
    return PerformancePlant(
        plant.a, plant.b * columns, rows[:, None] * plant.c, rows[:, None] * plant.d * columns,
        plant.controls, plant.measurements, plant.period,
    )  # fmt: skip


@dataclass(frozen=True)
class LoopPlaces:
    """Where a loop can be cut.

    Args:
        efforts: that the controller commands.
        sensors: that it reads.
    """

    efforts: tuple[str, ...]
    sensors: tuple[str, ...]

    def cut(self, at: str, names: tuple[str, ...], place: str) -> tuple[str, ...]:
        """Return the channels of a cut, the given ones or all.

        Raises:
            BadInput: if a name is none of them.
        """
        known = self.efforts if at == "efforts" else self.sensors
        prefix = EFFORT if at == "efforts" else ""
        given = tuple(n if n.startswith(prefix) else prefix + n for n in names) or known
        if unknown := [name for name in given if name not in known]:
            raise BadInput(f"one of {', '.join(known)}", key=place, value=unknown[0])
        return given


@dataclass(frozen=True)
class StatedGoal:
    """A goal of the file with its parts: a region of poles has one for decay and one for damping.

    Args:
        settings: of the file.
        label: for tables and messages.
        parts: that all must be met.
    """

    settings: Goal
    label: str
    parts: tuple[GoalChannels, ...] = field(repr=False)


def stated_goals(
    goals: Sequence[Goal], places: LoopPlaces, channels: PlantChannels
) -> tuple[StatedGoal, ...]:
    """Return the goals of a file for a loop.

    Raises:
        BadInput: if a signal is unknown, or a goal limits nothing; the message names the goal.
    """
    found = []
    for k, goal in enumerate(goals):
        where = f"goals.{k + 1}"
        try:
            parts = _parts(goal, places, channels.plant.period, where)
            for part in parts:
                channels.between(part.sources, part.targets, (), ())
        except BadInput as error:
            raise BadInput(f"{where}: {error}") from None
        found.append(StatedGoal(goal, _label(goal), parts))
    return tuple(found)


def _label(goal: Goal) -> str:
    s = goal
    if isinstance(s, MarginGoal):
        return f"disk margin {s.disk:g} at {s.at}"
    if isinstance(s, BandwidthGoal):
        return f"bandwidth {s.frequency:g} rad/s at {s.at}"
    if isinstance(s, RollOffGoal):
        return f"roll-off from {s.frequency:g} rad/s, slope {s.slope}, at {s.at}"
    if isinstance(s, TrackingGoal):
        return f"tracking of {', '.join(s.joints)} in {s.time:g} s"
    if isinstance(s, PoleGoal):
        parts = [f"{key} {getattr(s, key):g}" for key in ("decay", "damping") if getattr(s, key)]
        return f"poles with {' and '.join(parts)}"
    return f"{s.norm} gain {_few(s.source)} to {_few(s.to)} below {s.below:g}"


def _few(names: Sequence[str]) -> str:
    return names[0] if len(names) == 1 else f"{names[0]} and {len(names) - 1} more"


def _parts(goal: Goal, places: LoopPlaces, period: float, where: str) -> tuple[GoalChannels, ...]:
    s = goal
    if isinstance(s, GainGoal):
        norm = h_infinity if s.norm == "peak" else h_two
        weight = None if s.corner is None else first_order(s.corner, 1.0, period)
        return (GoalChannels(s.source, s.to, norm, 1.0 / s.below, weight),)
    if isinstance(s, TrackingGoal):
        weight = _tracking_weight(s, period)
        sources, targets = (tuple(f"{k}{j}" for j in s.joints) for k in ("reference.", ERROR))
        return (GoalChannels(sources, targets, h_infinity, 1.0, weight),)
    if isinstance(s, PoleGoal):
        pairs = ((decay, s.decay), (damping, s.damping))
        found = tuple(GoalChannels((), (), norm, v) for norm, v in pairs if v is not None)
        if not found:
            raise BadInput("give decay or damping", key=where)
        return found
    names = places.cut(s.at, s.channels, "channels")
    sources = tuple(
        name.replace(EFFORT, "disturbance.", 1) if s.at == "efforts" else f"noise.{name}"
        for name in names
    )
    cut = tuple(
        name.replace(EFFORT, COMMAND, 1) if s.at == "efforts" else f"{MEASURED}{name}"
        for name in names
    )
    if isinstance(s, MarginGoal):
        return (GoalChannels(sources, cut, h_infinity, s.disk, None, -0.5),)
    if isinstance(s, BandwidthGoal):
        return (GoalChannels(sources, cut, h_infinity, 1.0, _low_pass(s.frequency, period)),)
    weight = _roll_off(s.frequency, s.slope, period)
    return (GoalChannels(sources, names, h_infinity, 1.0, weight),)


def _sampled(a: float, b: float, c: float, d: float, at: float, period: float) -> _Filter:
    """Return a filter of first order by Tustin's method, exact at one frequency."""
    one = tuple(np.array([[value]]) for value in (a, b, c, d))
    if not period:
        return one[0], one[1], one[2], one[3]
    step = 2.0 * np.tan(0.5 * min(at * period, 3.0)) / at
    found = cont2discrete((one[0], one[1], one[2], one[3]), step, "bilinear")
    return found[0], found[1], found[2], found[3]


def first_order(corner: float, high: float, period: float) -> _Filter:
    """Return high (s + w) / (s + 0.001 w): the inverse of a bound that falls below w."""
    slow = _FLAT * corner
    return _sampled(-slow, 1.0, high * (corner - slow), high, corner, period)


def _low_pass(corner: float, period: float) -> _Filter:
    slow = _FLAT * corner
    return _sampled(-slow, 1.0, corner, 0.0, corner, period)


def _tracking_weight(s: TrackingGoal, period: float) -> _Filter:
    """Return (s + w) / (peak s + steady w), the inverse of the largest error."""
    w = 2.0 / s.time
    pole = s.steady * w / s.peak
    return _sampled(-pole, 1.0, (w - pole) / s.peak, 1.0 / s.peak, w, period)


def _roll_off(corner: float, slope: int, period: float) -> _Filter:
    """Return (s / w)^slope up to a pole at half the sampling rate over pi."""
    fast = 2.0 / period if period else 100.0 * corner
    one = _sampled(-fast, 1.0, -(fast**2) / corner, fast / corner, corner, period)
    found = one
    for _ in range(slope - 1):
        a, b, c, d = found
        found = (
            np.block([[a, np.zeros((len(a), 1))], [one[1] @ c, one[0]]]),
            np.vstack((b, one[1] @ d)), np.hstack((one[3] @ c, one[2])), one[3] @ d,
        )  # fmt: skip
    return found


def all_channels(goals: Sequence[StatedGoal]) -> tuple[tuple[str, ...], tuple[str, ...]]:
    """Return all sources and targets of goals."""
    parts = [part for goal in goals for part in goal.parts]
    return tuple(dict.fromkeys(n for p in parts for n in p.sources)), tuple(
        dict.fromkeys(n for p in parts for n in p.targets)
    )
