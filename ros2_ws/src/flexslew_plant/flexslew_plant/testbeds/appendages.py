"""What the sensors on the appendages read."""

from collections.abc import Callable
from typing import NamedTuple

from flexslew_plant.arrays import Matrix, Vector


class Appendages(NamedTuple):
    """Linear maps from the modal coordinates to what a sensor at each appendage reads."""

    names: tuple[str, ...]
    tip: Matrix  # (appendages, modes) [-]
    curvature: Matrix  # at the root, (appendages, modes) [1/m^2]
    rate: Matrix | None = None  # of the modes' rates, added to the tip's reading [s]
    # from state, its derivative and time to what accelerometers add, (appendages,) [m/s^2]
    felt: Callable[[Vector, Vector, float], Vector] | None = None
    # noise, bias and quantisation of every reading, (3, appendages); None: of the channel alone
    errors: Matrix | None = None
    # largest |tip| at which the equations of small deflections hold, (appendages,) [m]; None: any
    small: Vector | None = None

    def reading(self, modes: Vector, rates: Vector) -> Vector:
        """Return what the tips read of the modes and their rates, shape (appendages,)."""
        tip: Vector = self.tip.dot(modes)
        return tip if self.rate is None else tip + self.rate.dot(rates)
