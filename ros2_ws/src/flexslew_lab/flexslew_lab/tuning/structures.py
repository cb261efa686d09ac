"""Controllers with free parameters: a constant gain of the parameters around a prepared plant.

A structure keeps to its form for every value of its parameters. Its matrix takes complex numbers,
so that complex steps give its exact derivative (Squire and Trapp, SIAM Review 40, 1998).
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np

from flexslew_lab.tuning.closed_loop import PerformancePlant
from flexslew_lab.tuning.settings import StateSpaceBlock
from flexslew_plant.arrays import Matrix, Vector

_STEP = 1e-30  # of complex steps

Parts = tuple[Any, Any, Any, Any]  # A, B, C, D, real or complex


class ControllerStructure(Protocol):
    """A controller with free parameters."""

    @property
    def signals(self) -> tuple[str, ...]:
        """What it reads."""
        ...

    @property
    def efforts(self) -> tuple[str, ...]:
        """What it commands."""
        ...

    @property
    def labels(self) -> tuple[str, ...]:
        """Of the parameters."""
        ...

    @property
    def start(self) -> Vector:
        """First values of the parameters, shape (parameters,)."""
        ...

    def other_start(self, rng: np.random.Generator) -> Vector:
        """Return other first values, shape (parameters,)."""
        ...

    def prepared(self, plant: PerformancePlant) -> PerformancePlant:
        """Return the plant around which the matrix is the controller."""
        ...

    def matrix(self, x: Any) -> Any:
        """Return the gain of the prepared plant at parameters, which may be complex."""
        ...

    def section(self, x: Vector) -> dict[str, Any]:
        """Return the controller's keys at parameters, plain data."""
        ...


def matrix_and_slopes(structure: ControllerStructure, x: Vector) -> tuple[Matrix, Matrix]:
    """Return the gain and its derivatives, shapes (u, y) and (parameters, u, y)."""
    steps = [structure.matrix(x + 1j * _STEP * unit) for unit in np.eye(x.size)]
    slopes = np.array([np.imag(value) / _STEP for value in steps])
    return np.real(structure.matrix(x.astype(np.complex128))), slopes


def held_gain(parts: Parts, period: float) -> Any:
    """Return [[D, C], [B, A]] of a continuous controller sampled by Tustin's method.

    As the law `linear` samples it. A period of zero leaves it continuous.
    """
    a, b, c, d = parts
    if period and len(a):
        eye, half = np.eye(len(a)), 0.5 * period
        inverse = np.linalg.inv(eye - half * a)
        a, b, c, d = (
            inverse @ (eye + half * a), period * inverse @ b, c @ inverse,
            d + half * c @ inverse @ b,
        )  # fmt: skip
    return np.block([[d, c], [b, a]])


def linear_section(parts: Parts, signals: Sequence[str], efforts: Sequence[str]) -> dict[str, Any]:
    """Return the keys of the law `linear`; a sum of signals becomes an input for each."""
    a, b, c, d = (np.real(part) for part in parts)
    names = [[part.strip() for part in text.split("+")] for text in signals]
    columns = [k for k, parts_of in enumerate(names) for _ in parts_of]
    inputs = [name for parts_of in names for name in parts_of]
    if len(set(inputs)) < len(inputs):  # a signal in two inputs
        unique = list(dict.fromkeys(inputs))
        gather = np.zeros((len(signals), len(unique)))
        for column, name in zip(columns, inputs, strict=True):
            gather[column, unique.index(name)] += 1.0
        b, d, inputs = b @ gather, d @ gather, unique
    else:
        b, d = b[:, columns], d[:, columns]
    system = {"a": a.tolist(), "b": b.tolist(), "c": c.tolist(), "d": d.tolist()}
    if not len(a):
        system = {"d": d.tolist()}
    return {
        "law": "linear",
        "system": {**system, "period": 0.0, "inputs": inputs, "outputs": list(efforts)},
    }


@dataclass(frozen=True)
class TridiagonalSystem:
    """A state space of fixed order with a real tridiagonal A, which reaches every transfer function.

    (McKelvey and Helmersson, System identification using an over-parametrized model class, CDC
    1997.)

    Args:
        settings: of the tuning file.
        period: one tick [s]; 0: continuous.
    """  # noqa: E501

    settings: StateSpaceBlock
    period: float

    @property
    def signals(self) -> tuple[str, ...]:
        """What it reads."""
        return tuple(self.settings.inputs)

    @property
    def efforts(self) -> tuple[str, ...]:
        """What it commands."""
        return tuple(self.settings.outputs)

    @property
    def _sizes(self) -> tuple[int, ...]:
        """Numbers of parameters on the diagonal, above, below it, in B, C and D."""
        s, n = self.settings, self.settings.order
        p, m = len(s.inputs), len(s.outputs)
        beside = max(n - 1, 0)
        return n, beside, beside, n * p, m * n, m * p if s.direct or not n else 0

    @property
    def labels(self) -> tuple[str, ...]:
        """Of the parameters."""
        names = ("diagonal", "above", "below", "b", "c", "d")
        return tuple(
            f"{name}.{k + 1}" for name, size in zip(names, self._sizes, strict=True)
            for k in range(size)
        )  # fmt: skip

    @property
    def start(self) -> Vector:
        """Small random entries about poles at the typical bandwidth."""
        return self.other_start(np.random.default_rng(0))

    def other_start(self, rng: np.random.Generator) -> Vector:
        """Return other first values, shape (parameters,)."""
        found = rng.standard_normal(sum(self._sizes))
        found[: self._sizes[0]] -= 1.0
        return np.asarray(found)

    def prepared(self, plant: PerformancePlant) -> PerformancePlant:
        """Return the reduced plant with the controller's states."""
        return plant.reduced().extended(self.settings.order)

    def parts(self, x: Any) -> Parts:
        """Return A, B, C and D at parameters, continuous."""
        s, n = self.settings, self.settings.order
        diagonal, above, below, b, c, d = np.split(x, np.cumsum(self._sizes)[:-1])
        inputs, outputs = (np.array(list(sizes.values())) for sizes in (s.inputs, s.outputs))
        p, m = inputs.size, outputs.size
        a = s.speed * (np.diag(diagonal) + np.diag(above, 1)[:n, :n] + np.diag(below, -1)[:n, :n])
        direct = d.reshape(m, p) if d.size else np.zeros((m, p))
        return (
            a, s.speed * b.reshape(n, p) / inputs, outputs[:, None] * c.reshape(m, n),
            outputs[:, None] * direct / inputs,
        )  # fmt: skip

    def matrix(self, x: Any) -> Any:
        """Return [[D, C], [B, A]], sampled."""
        return held_gain(self.parts(x), self.period)

    def section(self, x: Vector) -> dict[str, Any]:
        """Return the keys of the law `linear`."""
        return linear_section(self.parts(x), self.signals, self.efforts)
