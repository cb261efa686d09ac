"""Several systems in parallel as a structure: each has its own states, their efforts add up."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.linalg import block_diag

from flexslew_lab.tuning.closed_loop import PerformancePlant
from flexslew_lab.tuning.pid_system import PidSystem
from flexslew_lab.tuning.structures import Parts, TridiagonalSystem, held_gain, linear_section
from flexslew_plant.arrays import Vector

_System = TridiagonalSystem | PidSystem


@dataclass(frozen=True)
class ParallelSystem:
    """Systems side by side: one for each axis, or several for one effort.

    Args:
        systems: with their own parameters.
        period: one tick [s]; 0: continuous.
    """

    systems: tuple[_System, ...]
    period: float

    @property
    def signals(self) -> tuple[str, ...]:
        """What they read, system after system."""
        return tuple(name for system in self.systems for name in system.signals)

    @property
    def efforts(self) -> tuple[str, ...]:
        """What they command."""
        return tuple(dict.fromkeys(name for system in self.systems for name in system.efforts))

    @property
    def labels(self) -> tuple[str, ...]:
        """Of the parameters."""
        return tuple(
            f"{k}.{name}" for k, system in enumerate(self.systems, 1) for name in system.labels
        )

    @property
    def start(self) -> Vector:
        """First values of all parameters."""
        return np.concatenate([system.start for system in self.systems])

    def other_start(self, rng: np.random.Generator) -> Vector:
        """Return other first values, shape (parameters,)."""
        return np.concatenate([system.other_start(rng) for system in self.systems])

    def prepared(self, plant: PerformancePlant) -> PerformancePlant:
        """Return the reduced plant with the states of all systems."""
        return plant.reduced().extended(len(self.parts(self.start)[0]))

    def parts(self, x: Any) -> Parts:
        """Return A, B, C and D at parameters, continuous."""
        sizes = [len(system.labels) for system in self.systems]
        each = np.split(x, np.cumsum(sizes)[:-1])
        found = [system.parts(some) for system, some in zip(self.systems, each, strict=True)]
        place = np.hstack([self._place(system.efforts) for system in self.systems])
        a, b, c, d = (block_diag(*[parts[k] for parts in found]) for k in range(4))
        return a, b, place @ c, place @ d

    def _place(self, efforts: Sequence[str]) -> Any:
        return np.array([[float(name == other) for other in efforts] for name in self.efforts])

    def matrix(self, x: Any) -> Any:
        """Return [[D, C], [B, A]], sampled."""
        return held_gain(self.parts(x), self.period)

    def section(self, x: Vector) -> dict[str, Any]:
        """Return the keys of the law `linear`."""
        return linear_section(self.parts(x), self.signals, self.efforts)
