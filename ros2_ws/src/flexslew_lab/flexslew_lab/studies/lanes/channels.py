"""The channels among the tips that read entries of the state: tachometers and resolvers."""

from typing import NamedTuple

import numpy as np

from flexslew_plant.arrays import Indices, Matrix
from flexslew_plant.testbeds.instruments import Resolver, Tachometer
from flexslew_plant.testbeds.instruments.instrument import channels
from flexslew_plant.testbeds.model import Model


class EntryChannels(NamedTuple):
    """One instrument."""

    where: slice  # its channels among the tips
    entries: Indices  # of the state, that it reads
    noise: float  # standard deviation of a reading

    def errors(self, seed: int, readings: int) -> Matrix:
        """Return its errors as the bench draws them, (readings, channels); see Appendages.begun."""
        size = len(self.entries)
        if not self.noise:
            return np.zeros((readings, size))
        rng = np.random.default_rng([seed, 0, 1 + self.where.start])
        drawn: Matrix = self.noise * rng.standard_normal((readings, size))
        return drawn


def entry_channels(model: Model) -> list[EntryChannels]:
    """Return the instruments of a model that read entries of its state, with white noise alone."""
    sensors = model.appendages
    if sensors.body is None:
        return []
    body = sensors.body(np.arange(float(model.positions + model.coordinates)))
    return [
        EntryChannels(channels(one), one.exact(body).astype(np.int64), one.settings.noise)
        for one in sensors.instruments
        if isinstance(one, Tachometer | Resolver)
    ]


def stands_of(model: Model, tips: int) -> tuple[int, ...]:
    """Return the entry of the state that each of the first tips reads; -1: modes move it."""
    stands = np.full(len(model.appendages.names), -1)
    for one in entry_channels(model):
        stands[one.where] = one.entries
    return tuple(stands[:tips].tolist())
