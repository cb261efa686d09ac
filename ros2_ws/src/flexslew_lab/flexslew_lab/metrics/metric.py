"""What a metric is: it measures one epoch of a run, block after block."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, ClassVar, NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from flexslew_plant.arrays import Matrix, Vector
from flexslew_plant.events import Event
from flexslew_plant.testbeds import Testbed


class Key(NamedTuple):
    """What a key of metrics.json holds."""

    unit: str
    per_joint: bool  # an object by joint name; units are those of the joint where two are given
    meaning: str
    axes: bool = False  # values, also those by part, come for x, y, z, or as None for all three
    spectrum: bool = False  # by frequency, which is no number of a trial
    never: str = ""  # where this key has a value, None means never, which is worse than any number
    some: bool = False  # parts may have no value; the largest is that of those which have one


class ReferenceManoeuvre(NamedTuple):
    """What the numbers are measured against."""

    start: float  # [s]
    end: float  # [s]
    goal: Vector | None  # (joints,)
    displacement: Vector  # goal - position at the start of the plan, (joints,)
    rate: Vector | None = None  # of the joints at the end, (joints,); None: the plan ends at rest


class RunSetup(NamedTuple):
    """What is known of a run before its first tick."""

    joint_names: tuple[str, ...]
    manoeuvre: ReferenceManoeuvre
    limit: Vector  # of the effort, (joints,); (0,) where not given
    testbed: Testbed | None  # None: of a version that this one does not know


class Block(NamedTuple):
    """The truth of some ticks, in order."""

    tick: NDArray[Any]  # (ticks,)
    time: Vector  # (ticks,) [s]
    held: Vector  # how long the effort was applied that led to each tick, (ticks,) [s]
    position: Matrix  # q, (ticks, n)
    velocity: Matrix  # v, (ticks, n)
    effort: Matrix  # applied from the tick before to this one, (ticks, joints)
    tip: Matrix  # deflection by appendage, (ticks, appendages) [m]
    error: Matrix | None  # joint position - goal, (ticks, joints); None: no goal
    started: NDArray[Any]  # whether the manoeuvre has started, (ticks,)
    over: NDArray[Any]  # whether it has ended, (ticks,)


def add_rows(before: Vector, terms: Matrix) -> Vector:
    """Return before and all rows of terms, added one after the other, shape (n,).

    So a sum is the same to the last bit however the ticks of a run come in blocks.
    """
    return np.asarray(np.add.accumulate(np.vstack((before, terms)))[-1])


class Ending(NamedTuple):
    """The facts of a run that the truth does not contain."""

    events: Sequence[Event]  # of the epoch
    wall_times: Sequence[float]  # recorded besides the events [s]
    complete: bool  # the log was finished
    warnings: tuple[str, ...] = ()  # why the numbers may not be those of the run


class Metric(Protocol):
    """One or more keys of metrics.json that are measured together; made with the RunSetup.

    A streaming measure: its memory does not grow with the run.
    """

    KEYS: ClassVar[Mapping[str, Key]]

    def __init__(self, setup: RunSetup) -> None:
        """Begin before the first tick."""

    def add(self, block: Block) -> None:
        """Take the next ticks."""

    def result(self, ending: Ending) -> dict[str, Any]:
        """Return the values by key, ready for JSON; a key that does not apply may be left out."""


@dataclass(frozen=True)
class MetricEntry:
    """A metric as the rest of the bench uses it.

    Args:
        metric: the class; its keys name what it measures.
        group: heading under which people read it.
        of: protocol of the testbeds that have it; None: all have.
        needs_truth: batches record the truth for it, as they do for metrics of a user's own; False:
            their loop accumulates what it needs, or it reads events alone.
    """

    metric: type[Metric]
    group: str = "motion"
    of: type | None = None
    needs_truth: bool = True

    @property
    def name(self) -> str:
        """What errors call it."""
        return self.metric.__name__

    def is_for(self, testbed: Testbed | None) -> bool:
        """Return whether runs of a testbed have it; None: of a version that is not known here."""
        return self.of is None or isinstance(testbed, self.of)


def goal_by_joint(setup: RunSetup) -> dict[str, float]:
    """Return where the manoeuvre ends, by joint; empty without a plan."""
    goal = setup.manoeuvre.goal
    return {} if goal is None else dict(zip(setup.joint_names, goal.tolist(), strict=True))


def update_maximum(before: Vector | None, values: Matrix) -> Vector:
    """Return the largest absolute values of each column so far."""
    largest: Vector = abs(values).max(axis=0)
    return largest if before is None else np.maximum(before, largest)


def plain(values: Mapping[str, Vector]) -> dict[str, list[float]]:
    """Return arrays by name, ready for JSON."""
    return {name: value.tolist() for name, value in values.items()}


def ready(setup: RunSetup, keys: Mapping[str, Key], values: Mapping[str, Vector]) -> dict[str, Any]:
    """Return the values of one run by key, those of joints by name; None where not finite."""
    return {
        key: by_joint(setup, value) if keys[key].per_joint else _finite(float(value))
        for key, value in values.items()
    }


def by_joint(setup: RunSetup, values: Vector) -> dict[str, float | None]:
    """Return one value per joint by its name; None where it is not finite."""
    return dict(zip(setup.joint_names, map(_finite, values.tolist()), strict=True))


def _finite(value: float) -> float | None:
    return value if abs(value) < float("inf") else None
