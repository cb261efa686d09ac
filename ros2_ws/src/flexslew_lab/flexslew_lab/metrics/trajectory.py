"""The hash by which two runs are the same."""

import hashlib
from collections.abc import Mapping
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from flexslew_lab.metrics.metric import Block, Ending, Key, MetricEntry, RunSetup
from flexslew_plant.arrays import Matrix, Vector


class TrajectoryHash:
    """SHA-256 over the truth: tick, then position and velocity, as little-endian bytes."""

    def __init__(self) -> None:
        self._digest = hashlib.sha256()

    def update(self, tick: int, position: Vector, velocity: Vector) -> None:
        """Add one tick."""
        state = np.concatenate((position, velocity)).astype("<f8", copy=False)
        self._digest.update(tick.to_bytes(8, "little") + state.tobytes())

    def update_many(self, tick: NDArray[Any], position: Matrix, velocity: Matrix) -> None:
        """Add many ticks, in order; the same as one after another."""
        parts = (tick.astype("<u8")[:, None], position.astype("<f8"), velocity.astype("<f8"))
        rows = np.hstack([np.ascontiguousarray(part).view(np.uint8) for part in parts])
        self._digest.update(rows.tobytes())

    def hexdigest(self) -> str:
        """Return the hash so far, hexadecimal."""
        return self._digest.hexdigest()


class TrajectoryMetric:
    """Implements Metric."""

    KEYS: ClassVar[Mapping[str, Key]] = {
        "trajectory_hash": Key(
            "hex",
            False,
            "SHA-256 of tick (uint64) and state [q, v] (float64), little-endian, tick by tick",
        ),
    }

    def __init__(self, setup: RunSetup) -> None:
        self._hash = TrajectoryHash()

    def add(self, block: Block) -> None:
        """Take the next ticks."""
        self._hash.update_many(block.tick, block.position, block.velocity)

    def result(self, ending: Ending) -> dict[str, Any]:
        """Return the hash."""
        return {"trajectory_hash": self._hash.hexdigest()}


TRAJECTORY = MetricEntry(TrajectoryMetric, "run", needs_truth=False)
