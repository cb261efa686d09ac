"""The steps of all faults of the table as one compiled function, for the bench and for batches.

It is made of the table once per process. So the code around it is compiled once, whichever faults a
trial has, and a fault that joins the table is served by it without a further edit.
"""

from collections.abc import Callable
from functools import lru_cache
from typing import Any, TypeAlias, cast

import numpy as np
from numpy.typing import NDArray

from flexslew_plant.arrays import Matrix, Vector, called, compiled
from flexslew_plant.faults import FAULTS, Fault
from flexslew_plant.faults.effects import Effect, FaultContext
from flexslew_plant.faults.steps import FaultAction, FaultStep, Where
from flexslew_plant.hardware.sensors import Readings

# (number of the fault's kind, numbers, memory, since, value) -> value; see FaultStep
AnyStep: TypeAlias = Callable[[int, Vector, Vector, int, float], float]

_STEPS: dict[type[Any], FaultStep] = {
    entry.settings: entry.step for entry in FAULTS.values() if entry.step is not None
}
_NUMBERS = {kind: number for number, kind in enumerate(_STEPS)}
_NOW = np.ones(1, np.bool_)


def number_of(fault: Fault) -> int | None:
    """Return the number by which `any_step` calls the step of a fault; None: it has no step.

    A subclass of a kind has none of its own: it may do more than the step does.
    """
    return _NUMBERS.get(type(fault))


@lru_cache
def any_step() -> AnyStep:
    """Return one function for the steps of all kinds, for calls from compiled ones."""
    found: AnyStep = _identity_step
    for number, step in enumerate(_STEPS.values()):
        found = _either(number, step, found)
    return found


@called
def _identity_step(kind: int, numbers: Vector, memory: Vector, since: int, value: float) -> float:
    return value


def _either(number: int, step: FaultStep, others: AnyStep) -> AnyStep:
    @called
    def either(kind: int, numbers: Vector, memory: Vector, since: int, value: float) -> float:
        if kind == number:
            return step(numbers, memory, since, value)
        return others(kind, numbers, memory, since, value)

    return cast(AnyStep, either)


@lru_cache
def advance_fault() -> Callable[..., None]:
    """Return what applies a fault to some ticks of the entries on which it acts.

    It takes (number of its kind, numbers, memory of all entries, ticks since the fault began,
    whether it acts at each tick, values, shape (ticks, entries)).
    """
    step = any_step()

    @compiled
    def advance(
        kind: int,
        numbers: Vector,
        memory: Vector,
        since: int,
        is_active: NDArray[np.bool_],
        values: Matrix,
    ) -> None:
        size = memory.size // max(values.shape[1], 1)
        for k in range(is_active.size):
            if is_active[k]:
                for i in range(values.shape[1]):
                    view = memory[i * size : (i + 1) * size]
                    values[k, i] = step(kind, numbers, view, since + k, values[k, i])

    return cast(Callable[..., None], advance)


def load_steps() -> None:
    """Compile or load the steps, so that no fault waits for them in flight."""
    advance_fault()(-1, np.zeros(1), np.zeros(1), 0, _NOW, np.zeros((1, 1)))


class StepFault:
    """Numbers and memory of a fault while it acts on the bench.

    Args:
        kind: number of its kind.
        action: of the fault.
        context: when it sets in.
    """

    def __init__(self, kind: int, action: FaultAction, context: FaultContext) -> None:
        self._kind, self._action, self._context = kind, action, context
        before = context.effort if action.where is Where.EFFORT else context.demand
        if action.where is Where.READING:
            before = np.zeros(action.last)
        self._numbers = np.array(action.numbers, dtype=np.float64)
        self._memory = np.repeat(before[action.first : action.last], action.memory)
        self._advance = advance_fault()

    def effect(self) -> Effect:
        """Return the effect on readings, demands or efforts."""
        match self._action.where:
            case Where.READING:
                return Effect(read=self._read)
            case Where.LATE:
                return Effect(late=self.changed)
            case Where.DEMAND:
                return Effect(demand=self.changed)
            case Where.EFFORT:
                return Effect(effort=self.changed)

    def changed(self, values: Vector) -> Vector:
        """Return the values of a tick after the fault: of a channel, or of all joints."""
        action, context = self._action, self._context
        if action.probability < 1.0 and not context.happens(action.probability):
            return values
        found = values.copy()
        view, since = found[None, action.first : action.last], context.since()
        self._advance(self._kind, self._numbers, self._memory, since, _NOW, view)
        return found

    def _read(self, readings: Readings) -> Readings:
        channel = self._action.channel
        return readings._replace(**{channel: self.changed(getattr(readings, channel))})


def effect_of(fault: Any, context: FaultContext) -> Effect:
    """Return what a fault does on the bench from now on, by its step or by itself."""
    kind = number_of(fault)
    if kind is None:
        effect: Effect = fault.begin(context)
        return effect
    return StepFault(kind, fault.action(context.names), context).effect()
