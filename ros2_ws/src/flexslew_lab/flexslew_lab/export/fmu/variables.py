"""The variables of a functional mock-up unit: one scalar for every number of the C structs."""

from collections.abc import Iterator, Mapping
from typing import Literal, NamedTuple, TypeAlias

from flexslew_lab.export.c_module import CModule, Signal

TIME = "time"  # the independent variable; the first member of an input struct may have this name


Causality: TypeAlias = Literal["input", "output", "local", "parameter"]


class SignalPart(NamedTuple):
    """A number of a signal."""

    name: str  # behind the signal's name: ".yaw", "[1]", or nothing
    unit: str


# by the name of a signal; those of others are numbered, with the signal's unit
SignalParts: TypeAlias = Mapping[str, tuple[SignalPart, ...]]


class FmuVariable(NamedTuple):
    """A variable; its value reference is its position in the table, from 1 on."""

    name: str
    unit: str
    start: float | None  # None: it is calculated
    causality: Causality
    place: int  # among the numbers of inputs, outputs, states, their derivatives, and parameters
    state: int | None = None  # value reference of the state whose derivative it is
    variability: Literal["continuous", "tunable", "fixed"] = "continuous"
    depends: tuple[int, ...] | None = None  # value references of what an output depends on


def variables_of(module: CModule, elements: SignalParts) -> tuple[FmuVariable, ...]:
    """Return the variables of a module, inputs first; its time is not among them."""
    inputs = tuple(_scalars(module.inputs, elements, "input", 0))
    outputs = tuple(_scalars(module.outputs, elements, "output", size_of(module.inputs)))
    states = () if module.continuous is None else module.continuous.states
    place, count = size_of((*module.inputs, *module.outputs)), len(states)
    parameters = tuple(
        one._replace(variability="tunable" if module.tunable else "fixed")
        for one in _scalars(module.parameters, elements, "parameter", place + 2 * count)
    )
    if not states:
        return (*inputs, *outputs, *parameters)
    first = len(inputs + outputs) + 1  # value reference of the first state
    return (
        *inputs,
        *(
            one._replace(start=None, depends=depends)
            for one, depends in zip(outputs, _dependencies(module), strict=True)
        ),
        *(
            FmuVariable(one.name, one.unit, one.start, "local", place + k)
            for k, one in enumerate(states)
        ),
        *(
            FmuVariable(
                f"der({one.name})", one.rate_unit, None, "local", place + count + k, first + k
            )
            for k, one in enumerate(states)
        ),
        *parameters,
    )


def _dependencies(module: CModule) -> Iterator[tuple[int, ...]]:
    """Yield the value references that each output of a plant depends on: time, inputs, states."""
    continuous = module.continuous
    assert continuous is not None
    places, reference = {TIME: range(1)}, 1
    for signal in module.inputs:
        if signal.name != TIME:
            places[signal.name] = range(reference, reference + signal.size)
            reference += signal.size
    reference += sum(signal.size for signal in module.outputs if signal.name != TIME)
    places["x"] = range(reference, reference + len(continuous.states))
    for signal in module.outputs:
        known = continuous.depends[signal.name]
        found = tuple(k for name, each in places.items() if name in known for k in each)
        yield from (found,) * (signal.size if signal.name != TIME else 0)


def _scalars(
    signals: tuple[Signal, ...],
    elements: SignalParts,
    causality: Causality,
    first: int,
) -> Iterator[FmuVariable]:
    place = first
    for signal in signals:
        parts = elements.get(signal.name) or _numbered(signal)
        for part, start in zip(parts, start_of(signal), strict=True):
            if signal.name != TIME:
                name = signal.name + part.name
                yield FmuVariable(name, part.unit, start, causality, place)
            place += 1


def _numbered(signal: Signal) -> tuple[SignalPart, ...]:
    if signal.size == 1:
        return (SignalPart("", signal.unit),)
    return tuple(SignalPart(f"[{i + 1}]", signal.unit) for i in range(signal.size))


def start_of(signal: Signal) -> tuple[float, ...]:
    """Return the numbers of a signal at the start; 0 where it names none."""
    return tuple(float(x) for x in signal.start) or (0.0,) * signal.size


def size_of(signals: tuple[Signal, ...]) -> int:
    """Return how many numbers a struct has."""
    return sum(signal.size for signal in signals)


def is_timed(module: CModule) -> bool:
    """Return whether the input struct begins with the time."""
    return bool(module.inputs) and module.inputs[0].name == TIME
