"""What the sensors on the appendages read."""

from collections.abc import Callable
from typing import NamedTuple, TypeAlias

import numpy as np

from flexslew_plant.arrays import Matrix, Vector
from flexslew_plant.testbeds.instruments import BodyState, Instrument
from flexslew_plant.testbeds.instruments.instrument import TickReader, channels
from flexslew_plant.testbeds.instruments.packed_readers import PackedReaders, packed_readers

# from a state and the readings of the tips to those with the instruments'; once a tick, in order
InstrumentReader: TypeAlias = Callable[[Vector, Vector], Vector]


class Appendages(NamedTuple):
    """Linear maps from the modal coordinates to what a sensor at each appendage reads."""

    names: tuple[str, ...]
    tip: Matrix  # (appendages, modes) [-]
    curvature: Matrix  # at the root, (appendages, modes) [1/m^2]
    rate: Matrix | None = None  # of the modes' rates, added to the tip's reading [s]
    # from state, its derivative and time to what accelerometers add, (appendages,) [m/s^2]
    exact_reading: Callable[[Vector, Vector, float], Vector] | None = None
    # noise, bias and quantisation of every reading, (3, appendages); None: of the channel alone
    errors: Matrix | None = None
    # largest |tip| at which the equations of small deflections hold, (appendages,) [m]; None: any
    small: Vector | None = None
    # that read the platform's attitude or rate, with errors of their own, and their platform
    instruments: tuple[Instrument, ...] = ()
    body: Callable[[Vector], BodyState] | None = (
        None  # from a state; None: there are no instruments
    )
    units: tuple[str, ...] = ()  # of the tips' readings, "" for a plain number; (): all m
    # whether the truth holds each: of rates and instruments it holds nothing; (): all
    in_truth: tuple[bool, ...] = ()

    @property
    def all_tips(self) -> bool:
        """Whether every reading is that of a tip: no instrument, and no errors of its own."""
        exact = self.errors is None or not self.errors.any()
        return exact and self.exact_reading is None and self.body is None

    @property
    def sensors(self) -> list[tuple[int, str, str]]:
        """Place, name and unit of all readings."""
        count = len(self.names)
        return list(zip(range(count), self.names, self.units or ("m",) * count, strict=True))

    @property
    def deflections(self) -> list[tuple[int, str, str]]:
        """Those of the readings that the truth holds: displacements and strains."""
        truth_mask = self.in_truth or (True,) * len(self.names)
        return [known for known, included in zip(self.sensors, truth_mask, strict=True) if included]

    def started(self, period: float, seed: list[int] | None = None) -> InstrumentReader | None:
        """Return what reads the instruments from tick 0 on; None: there are none.

        Args:
            period: one tick [s].
            seed: of their noises, each with its own; None: no errors, but delays and gaps.
        """
        platform = self.body
        if platform is None:
            return None
        pairs = zip(self.instruments, self._generators(seed), strict=True)
        readers = [(channels(one), TickReader(one, period, rng)) for one, rng in pairs]

        def read(x: Vector, tip: Vector) -> Vector:
            body, tip = platform(x), tip.copy()
            for where, reader in readers:
                tip[where] = reader(body)
            return tip

        return read

    def packed(self, period: float, seed: list[int] | None) -> PackedReaders:
        """Return the same for machine code; see begun."""
        return packed_readers(self.instruments, period, self._generators(seed))

    def _generators(self, seed: list[int] | None) -> list[np.random.Generator | None]:
        """Return what draws the noises of each instrument."""
        if seed is None:
            return [None for _ in self.instruments]
        return [np.random.default_rng([*seed, 1 + one.first]) for one in self.instruments]
