"""Readings of sensors, from the exact values: bias, noise and quantisation.

One set of steps serves the bench and the batches. Each step is about one reading.
"""

from typing import NamedTuple

import numpy as np

from flexslew_plant.arrays import Indices, Matrix, Vector, called, compiled_once


class SensorNumbers(NamedTuple):
    """The errors of all sensors of a bench, each of one reading and in its unit."""

    place: Indices  # of the reading among all, (errors,); of one with two errors both name it
    bias: Vector  # (errors,)
    quantum: Vector  # 0: none, (errors,)
    column: Indices  # of its noise among those of a tick, (errors,); -1: it has none
    noise: Vector  # standard deviation of each noise, (noises,)

    def draw(self, rng: np.random.Generator, ticks: int) -> Matrix:
        """Return the noises of the next ticks, shape (ticks, noises)."""
        drawn: Matrix = self.noise * rng.standard_normal((ticks, self.noise.size))
        return drawn


@called
def nearest_multiple(value: float, quantum: float) -> tuple[float, float]:
    """Return the multiple of a quantum that is next to a value, and the margin of the value.

    The margin is the distance to the edge at which another multiple is the next one.
    """
    parts = value / quantum
    whole = np.round(parts)
    return quantum * whole, quantum * abs(abs(parts - whole) - 0.5)


@called
def read_sensor(exact: float, bias: float, noise: float, quantum: float) -> tuple[float, float]:
    """Return the reading s round((x + b + n) / s), and its margin, see nearest_multiple.

    Args:
        exact: x.
        bias: b.
        noise: n at this tick.
        quantum: s; 0: the reading is x + b + n, with any margin.
    """
    value = exact + bias + noise
    multiple, margin = nearest_multiple(value, quantum if quantum > 0.0 else 1.0)
    return multiple if quantum > 0.0 else value, margin if quantum > 0.0 else np.inf


@compiled_once("readings")
def add_errors(n: SensorNumbers, noise: Vector, readings: Vector) -> None:
    """Add the errors of a tick to the exact values of all readings.

    Args:
        n: constants.
        noise: a row of SensorNumbers.draw.
        readings: in and out, shape (readings,).
    """
    for i in range(n.place.size):
        at, column = n.place[i], n.column[i]
        drawn = noise[column] if column >= 0 else 0.0
        readings[at], _ = read_sensor(readings[at], n.bias[i], drawn, n.quantum[i])
