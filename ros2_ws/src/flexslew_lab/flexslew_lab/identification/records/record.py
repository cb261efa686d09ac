"""The record of an experiment: the efforts applied and the readings of the sensors, on ticks."""

from dataclasses import dataclass, replace
from enum import Enum
from functools import cached_property
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from flexslew_plant.arrays import Matrix, Vector
from flexslew_plant.errors import BadInput

_MIN_TICKS = 64  # ticks


class Quantity(Enum):
    """What an output measures, as far as the fit must know."""

    JOINT_POSITION = "joint_position"
    JOINT_RATE = "joint_rate"
    DEFLECTION = "deflection"  # tips and other sensors that the rigid motion does not move
    DEFLECTION_RATE = "deflection_rate"
    ACCELERATION = "acceleration"  # of any point, with its rigid motion


@dataclass(frozen=True)
class Output:
    """One measured signal.

    Args:
        name: for people and files, `position.JOINT` or `tip.APPENDAGE`.
        unit: unit of its values.
        quantity: what it measures.
        joint: joint of a position or a rate; empty for all else.
    """

    name: str
    unit: str
    quantity: Quantity
    joint: str = ""


class UnknownEfforts(NamedTuple):
    """Spans of ticks over which an effort is constant and unknown.

    Args:
        first: tick at which each begins, rising, (pieces,).
        last: tick before which it ends, (pieces,).
        column: of the input, (pieces,).
        guess: effort from the samples around it, (pieces,) [N m or N].
        spread: standard deviation of the guess, rather too large than too small, (pieces,).
    """

    first: NDArray[np.int64]
    last: NDArray[np.int64]
    column: NDArray[np.int64]
    guess: Vector
    spread: Vector


@dataclass(frozen=True)
class Record:
    """Efforts held over every tick, and the outputs at its ends.

    Ticks are of one length unless `steps` gives the length of each. Where a sample is missing,
    `effort` and `measured` hold estimates, which `pieces` and `known` mark.

    Args:
        period: one tick [s].
        effort: really applied from tick k to k + 1, shape (ticks, inputs) [N m or N].
        measured: at tick k, shape (ticks + 1, outputs).
        inputs: names of the efforts' joints.
        outputs: of the columns of `measured`.
        source: the file, for messages.
        limits: of the drives, shape (inputs,) [N m or N]; infinite where they are not known.
        steps: length of every tick, shape (ticks,) [s]; None: all are one period long.
        known: which entries of `measured` are samples, same shape; None: all.
        pieces: where efforts are unknown; None: nowhere.
        held: whether the efforts were held; else their equivalents leave an error that is no noise.
    """

    period: float
    effort: Matrix
    measured: Matrix
    inputs: tuple[str, ...]
    outputs: tuple[Output, ...]
    source: str
    limits: Vector
    steps: Vector | None = None
    known: NDArray[np.bool_] | None = None
    pieces: UnknownEfforts | None = None
    held: bool = True

    def __post_init__(self) -> None:
        """Check that an experiment can be read from it.

        Raises:
            BadInput: it is too short, an input never moves, or a number is missing.
        """
        if len(self.effort) < _MIN_TICKS:
            raise BadInput(
                f"{self.source}: {len(self.effort)} ticks are not enough to identify anything: "
                f"give at least {_MIN_TICKS}"
            )
        for values, names in (
            (self.effort, self.inputs),
            (self.measured, tuple(o.name for o in self.outputs)),
        ):
            missing = ~np.isfinite(values).all(axis=0)
            if missing.any():
                name = names[int(np.argmax(missing))]
                tick = int(np.argmax(~np.isfinite(values[:, int(np.argmax(missing))])))
                raise BadInput(f"{self.source}: {name} has no value at tick {tick}")

    @property
    def ticks(self) -> int:
        """Number of ticks."""
        return len(self.effort)

    @property
    def duration(self) -> float:
        """From the first reading to the last [s]."""
        return self.ticks * self.period if self.steps is None else float(self.steps.sum())

    @property
    def lengths(self) -> float | Vector:
        """Length of all ticks, or of each of them [s]."""
        return self.period if self.steps is None else self.steps

    @property
    def is_complete(self) -> bool:
        """Whether no sample is missing."""
        return self.known is None and self.pieces is None

    @cached_property
    def times(self) -> Vector:
        """Times of the ticks from the first, shape (ticks + 1,) [s]."""
        if self.steps is None:
            return self.period * np.arange(self.ticks + 1, dtype=np.float64)
        return np.concatenate(([0.0], np.cumsum(self.steps)))

    def samples(self, column: int) -> int:
        """Return how many samples of an output there are."""
        return self.ticks + 1 if self.known is None else int(self.known[:, column].sum())

    def deviation(self, residual: Matrix) -> Vector:
        """Return the standard deviation of residuals at the samples, (outputs,).

        Args:
            residual: measured minus fitted, shape (ticks + 1, outputs).
        """
        if self.known is None:
            return np.asarray(residual.std(axis=0))
        return np.asarray(residual.std(axis=0, where=self.known))

    def with_efforts(self, values: Vector) -> "Record":
        """Return the record with other estimates of the unknown efforts, shape (pieces,)."""
        assert self.pieces is not None
        effort = self.effort.copy()
        for first, last, column, value in zip(*self.pieces[:3], values, strict=True):
            effort[first:last, column] = value
        return replace(self, effort=effort)

    @cached_property
    def joints(self) -> tuple[str, ...]:
        """Joints with a measured position, in the order of the outputs."""
        return tuple(o.joint for o in self.outputs if o.quantity is Quantity.JOINT_POSITION)

    @cached_property
    def actuation(self) -> tuple[int, ...]:
        """Which of the joints have an effort of their own, in the order of the efforts.

        Empty where the position of a joint that is shaken is not measured.
        """
        if not set(self.inputs) <= set(self.joints):
            return ()
        return tuple(self.joints.index(name) for name in self.inputs)

    @cached_property
    def saturated(self) -> float:
        """Fraction of the ticks in which a drive was at its limit [-]."""
        at_limit = np.abs(self.effort) >= self.limits * (1.0 - 1e-9)
        return float(at_limit.any(axis=1).mean())

    def active_channels(self) -> "Record":
        """Return the record with the inputs that moved alone, and the outputs that did.

        Raises:
            BadInput: no input moved.
        """
        inputs = np.flatnonzero(np.ptp(self.effort, axis=0) > 0.0)
        outputs = np.flatnonzero(np.ptp(self.measured, axis=0) > 0.0)
        if not inputs.size or not outputs.size:
            raise BadInput(
                f"{self.source}: no effort moves: an experiment must shake the bench; see "
                "`plan: {method: excitation}`"
            )
        pieces = self.pieces
        if pieces is not None:
            kept = np.isin(pieces.column, inputs)
            pieces = UnknownEfforts(
                pieces.first[kept],
                pieces.last[kept],
                np.searchsorted(inputs, pieces.column[kept]),
                pieces.guess[kept],
                pieces.spread[kept],
            )
        return replace(
            self,
            effort=np.ascontiguousarray(self.effort[:, inputs]),
            measured=np.ascontiguousarray(self.measured[:, outputs]),
            inputs=tuple(self.inputs[k] for k in inputs),
            outputs=tuple(self.outputs[k] for k in outputs),
            limits=self.limits[inputs],
            known=None if self.known is None else self.known[:, outputs],
            pieces=pieces if pieces is not None and pieces.first.size else None,
        )

    def columns(self, quantity: Quantity) -> tuple[int, ...]:
        """Return which outputs measure a quantity."""
        return tuple(k for k, o in enumerate(self.outputs) if o.quantity is quantity)

    def cut(self, first: int, last: int) -> "Record":
        """Return the ticks from `first` to before `last` of a record without unknown efforts."""
        assert self.pieces is None
        return replace(
            self,
            effort=self.effort[first:last],
            measured=self.measured[first : last + 1],
            steps=None if self.steps is None else self.steps[first:last],
            known=None if self.known is None else self.known[first : last + 1],
        )
