"""Factors of a testbed's stiffness and payload as parameters of its C code."""

from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np

from flexslew_lab.export.c_code.evaluator import Evaluator
from flexslew_lab.export.c_code.printer import Signal
from flexslew_lab.export.c_code.program import CLine
from flexslew_plant.arrays import Indices, Matrix, Vector
from flexslew_plant.errors import BadInput
from flexslew_plant.testbeds import Testbed, initial_state

_ROOTS = (2.0, 1.5)  # of the factors of stiffness from which the terms are found
_SAME = 1e-11  # relative difference up to which the numbers are those of the bench
_NAMES = ("stiffness", "payload")
_MEMBER = "memory->model_packed"
_SHAPES = ("tip", "curvature")  # of appendages, which no factor may change


class ModelNumbers(NamedTuple):
    """The numbers of a model's equations as functions of the factors s and c.

    p = p_0 + (s - 1) P_s + (sqrt(s) - 1) P_r + (c - 1) P_c: stiffness is proportional to s, damping
    of a given ratio to sqrt(s), and inertia to c.
    """

    start: Vector  # p_0, of all of them
    which: Indices  # the entries that depend on a factor
    terms: tuple[Vector, Vector, Vector]  # P_s, P_r, P_c of these
    signals: tuple[Signal, ...]  # the factors that have an effect

    @property
    def constants(self) -> dict[int, float]:
        """The entries that depend on no factor, by their places."""
        rest = np.setdiff1d(np.arange(self.start.size), self.which)
        return {int(k): float(self.start[k]) for k in rest}

    def write(self, e: Evaluator) -> None:
        """Write the entries for the factors in the memory, which are the start for factors of 1."""
        ops = e.ops
        names = [signal.name for signal in self.signals]
        s, c = (f"memory->parameters.{name}[0]" for name in _NAMES)
        factors = (f"({s} - 1.0)", f"(sqrt({s}) - 1.0)", f"({c} - 1.0)")
        used = [_NAMES[0] in names, _NAMES[0] in names, _NAMES[1] in names]
        where, first = ops.table(self.which), ops.table(self.start[self.which])
        terms = [
            (factor, ops.table(term))
            for factor, term, is_used in zip(factors, self.terms, used, strict=True)
            if is_used
        ]

        def put(index: tuple[str, ...]) -> None:
            parts = [first.entry(index), *(f"{f} * {term.entry(index)}" for f, term in terms)]
            text = " + ".join(parts)
            entry = f"{_MEMBER}[{where.entry(index)}]"
            ops.block.append(CLine(f"{entry} = {text};", _MEMBER, f"{text} {entry}"))

        ops.looped((self.which.size,), put)


def model_numbers(testbed: Testbed, on_bench: Callable[[Testbed], Testbed]) -> ModelNumbers:
    """Return the numbers of a testbed's model, with the factors of which they have this form.

    The terms are found from the bench's own scaled testbeds, and compared with others of them.

    Args:
        testbed: the testbed.
        on_bench: returns a testbed as it stands on the bench, with its schedule.
    """
    model, rest = on_bench(testbed).model(), initial_state(testbed)
    start, stiffness, payload = model.packed, np.zeros((2, model.packed.size)), model.packed * 0.0

    def change(s: float, c: float) -> Vector | None:
        try:
            scaled = testbed.scaled(s, c)
        except BadInput:
            return None
        other = on_bench(scaled).model()
        pairs = [
            (getattr(model.appendages, name), getattr(other.appendages, name)) for name in _SHAPES
        ]
        pairs.append((rest, initial_state(scaled)))
        if other.packed.size != start.size or not all(np.array_equal(*pair) for pair in pairs):
            return None
        return np.where(other.packed == start, 0.0, other.packed - start)

    def agrees(terms: Matrix, points: Sequence[tuple[float, float]]) -> bool:
        for s, c in points:
            right = change(s, c)
            found = np.array([s - 1.0, np.sqrt(s) - 1.0, c - 1.0]) @ terms
            if right is None or (np.abs(found - right) > _SAME * np.abs(start + right)).any():
                return False
        return True

    samples = [one for root in _ROOTS if (one := change(root**2, 1.0)) is not None]
    if len(samples) == len(_ROOTS):
        equations = np.array([[root**2 - 1.0, root - 1.0] for root in _ROOTS])
        fitted = np.linalg.solve(equations, np.array(samples))
        fitted[np.abs(fitted) < _SAME * np.abs(start)] = 0.0
        if agrees(np.vstack((fitted, payload)), ((0.49, 1.0), (1.21, 1.0))):
            stiffness = fitted
    heavier, both = change(1.0, 2.0), ((1.44, 1.7),) if stiffness.any() else ()
    points = (1.0, 0.5), (1.0, 1.7), *both
    if heavier is not None and agrees(np.vstack((stiffness, heavier)), points):
        payload = heavier
    which = np.flatnonzero(stiffness.any(axis=0) | (payload != 0.0))
    present = zip(_NAMES, (stiffness.any(), payload.any()), strict=True)
    signals = tuple(Signal(name, "", 1, (1.0,)) for name, found in present if found)
    terms = stiffness[0, which], stiffness[1, which], payload[which]
    return ModelNumbers(start, which, terms, signals)
