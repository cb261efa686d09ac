"""What an experiment gave: the efforts that were applied and what the sensors said, on ticks."""

from dataclasses import dataclass
from enum import Enum
from functools import cached_property

import numpy as np

from flexslew_plant.arrays import Matrix, Vector
from flexslew_plant.errors import BadInput

_SHORTEST = 64  # ticks


class Quantity(Enum):
    """What an output measures, as far as the fit must know."""

    JOINT_POSITION = "joint_position"
    JOINT_RATE = "joint_rate"
    DEFLECTION = "deflection"  # tips and other sensors that the rigid motion does not move
    DEFLECTION_RATE = "deflection_rate"


@dataclass(frozen=True)
class Output:
    """One measured signal.

    Args:
        name: for people and files, `position.JOINT` or `tip.APPENDAGE`.
        unit: of its values.
        quantity: what it measures.
        joint: whose position or rate; empty for a deflection.
    """

    name: str
    unit: str
    quantity: Quantity
    joint: str = ""


@dataclass(frozen=True)
class Record:
    """Efforts held over every tick, and the outputs at its ends.

    Args:
        period: one tick [s].
        effort: really applied from tick k to k + 1, shape (ticks, inputs) [N m or N].
        measured: at tick k, shape (ticks + 1, outputs).
        inputs: names of the efforts' joints.
        outputs: of the columns of `measured`.
        source: the file, for messages.
        limits: of the drives, shape (inputs,) [N m or N]; infinite where they are not known.
    """

    period: float
    effort: Matrix
    measured: Matrix
    inputs: tuple[str, ...]
    outputs: tuple[Output, ...]
    source: str
    limits: Vector

    def __post_init__(self) -> None:
        """Check that an experiment can be read from it.

        Raises:
            BadInput: it is too short, an input never moves, or a number is missing.
        """
        if len(self.effort) < _SHORTEST:
            raise BadInput(
                f"{self.source}: {len(self.effort)} ticks are not enough to identify anything: "
                f"give at least {_SHORTEST}"
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
        return self.ticks * self.period

    @cached_property
    def joints(self) -> tuple[str, ...]:
        """Joints with a measured position, in the order of the outputs."""
        return tuple(o.joint for o in self.outputs if o.quantity is Quantity.JOINT_POSITION)

    @cached_property
    def driven(self) -> tuple[int, ...]:
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

    def moved(self) -> "Record":
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
        return Record(
            self.period,
            np.ascontiguousarray(self.effort[:, inputs]),
            np.ascontiguousarray(self.measured[:, outputs]),
            tuple(self.inputs[k] for k in inputs),
            tuple(self.outputs[k] for k in outputs),
            self.source,
            self.limits[inputs],
        )

    def columns(self, quantity: Quantity) -> tuple[int, ...]:
        """Return which outputs measure a quantity."""
        return tuple(k for k, o in enumerate(self.outputs) if o.quantity is quantity)

    def cut(self, first: int, last: int) -> "Record":
        """Return the ticks from `first` to before `last`."""
        return Record(
            self.period,
            self.effort[first:last],
            self.measured[first : last + 1],
            self.inputs,
            self.outputs,
            self.source,
            self.limits,
        )
