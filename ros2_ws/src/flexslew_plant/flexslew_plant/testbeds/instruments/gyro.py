"""A three-axis rate-integrating gyro.

Farrenkopf 1978; the discrete form is that of Crassidis and Junkins, Optimal Estimation of Dynamic
Systems, 2nd ed., section 7.2.
"""

from dataclasses import dataclass, replace
from typing import ClassVar, Literal

import numpy as np

from flexslew_plant.arrays import Matrix, Vector, compiled_once
from flexslew_plant.settings import NonNegative, section
from flexslew_plant.testbeds.instruments.instrument import RATE, BodyState, CompiledReader
from flexslew_plant.testbeds.orientation.attitude import quaternion, to_body
from flexslew_plant.testbeds.orientation.quaternions import multiply, rotation_vector_of

Triple = tuple[float, float, float]

BIAS = slice(4, 7)  # of the gyro at this tick, in what its reader remembers [rad/s]


@section
class GyroSettings:
    """A gyro on the platform, along the body axes."""

    kind: Literal["gyro"]
    angle_random_walk: NonNegative = 0.0  # density of a gyro's white noise [rad/sqrt(s)]
    rate_random_walk: NonNegative = 0.0  # of the random walk of its bias [rad/s/sqrt(s)]
    bias: Triple = (0.0, 0.0, 0.0)  # of a gyro at the start, in body axes [rad/s]
    bias_spread: NonNegative = 0.0  # standard deviation about it, drawn by the seed [rad/s]
    scale: Triple = (0.0, 0.0, 0.0)  # errors of the scale factors [-]
    misalignment: Triple = (0.0, 0.0, 0.0)  # rotation vector from the body's axes to its own [rad]


@dataclass(frozen=True)
class Gyro:
    """y = (1 + S) A w + b + n: the mean rate of the last tick, with bias and noise.

    Over a tick T the mean of n has the variance angle_random_walk^2 / T, and b is a random walk,
    with its mean over the tick as the bias. At tick 0 it reads the rate of that instant.

    Args:
        name: name of its section.
        first: its first channel.
        settings: its errors.
    """

    name: str
    first: int
    settings: GyroSettings
    axes: ClassVar[tuple[str, ...]] = ("x", "y", "z")

    def exact(self, body: BodyState) -> Vector:
        """Return the body rate, shape (3,) [rad/s]."""
        return body.rate

    def reader(self, period: float, rng: np.random.Generator | None) -> CompiledReader:
        """Return what reads it; see Instrument."""
        it = self if rng is not None else replace(self, settings=GyroSettings(kind="gyro"))
        s, root, memory = it.settings, np.sqrt(period), np.zeros(7)
        walk = s.rate_random_walk * root
        noise_sizes = [walk, walk / np.sqrt(12.0), s.angle_random_walk / root]
        if rng is not None:
            memory[BIAS] = np.array(s.bias) + s.bias_spread * rng.standard_normal(3)
        constants = np.concatenate((it.response.ravel(), noise_sizes, [period]))
        return CompiledReader(read_gyro, constants, memory, 0, 9)

    @property
    def response(self) -> Matrix:
        """(1 + S) A, shape (3, 3)."""
        s = self.settings
        response: Matrix = np.diag(1.0 + np.array(s.scale)) @ to_body(
            quaternion(np.array(s.misalignment))
        )
        return response


@compiled_once("memory", "out")
def read_gyro(
    k: int, constants: Vector, body: Vector, samples: Vector, memory: Vector, out: Vector
) -> None:
    """Write the reading of a gyro; its memory is the last tick's attitude, and its bias.

    The bias walks on, but for the first tick; draws are of this walk, its mean, the white noise.
    """
    walk, bridge, white, period = constants[9], constants[10], constants[11], constants[12]
    x, y, z = body[RATE], body[RATE + 1], body[RATE + 2]
    if k > 0:
        before = (-memory[0], -memory[1], -memory[2], memory[3])
        now = (body[0], body[1], body[2], body[3])
        x, y, z = rotation_vector_of(multiply(before, now))
        x, y, z = x / period, y / period, z / period
    for i in range(4):
        memory[i] = body[i]
    for i in range(3):
        bias, step = memory[4 + i], walk * samples[i] if k > 0 else 0.0
        memory[4 + i] = bias + step
        seen = constants[3 * i] * x + constants[3 * i + 1] * y + constants[3 * i + 2] * z
        out[i] = seen + (bias + 0.5 * step + bridge * samples[3 + i]) + white * samples[6 + i]
