"""A shape with some of its modes, or seen in other axes."""

from typing import NamedTuple

import numpy as np

from flexslew_plant.arrays import Matrix
from flexslew_plant.testbeds.spacecraft.shapes.integrals import Integrals
from flexslew_plant.testbeds.spacecraft.shapes.shape import FlexibleShape, PlacedShape, Spot


class _Chosen(NamedTuple):
    """Places along a shape of which some modes count."""

    along: PlacedShape
    modes: list[int]

    def spot(self, s: float) -> Spot:
        """Return what these modes do at the distance s."""
        return _chosen(self.along.spot(s), self.modes)


def _chosen(spot: Spot, n: list[int]) -> Spot:
    return Spot(spot.place, spot.displacement[:, n], spot.turn[:, n], spot.curvature[:, n])


def chosen_modes(shape: FlexibleShape, n: list[int]) -> FlexibleShape:
    """Return a shape with some of its modes, counted from 0."""
    i = shape.integrals
    return FlexibleShape(
        Integrals(
            i.mass,
            i.first,
            i.second,
            i.translation[:, n],
            i.rotation[:, n],
            i.second_1[n],
            i.second_2[np.ix_(n, n)],
            i.gyroscopic[np.ix_(n, n)],
            None if i.shortening is None else i.shortening.chosen(n),
        ),
        shape.mass[n],
        shape.stiffness[n],
        _chosen(shape.tip, n),
        shape.line,
        shape.line_shape[:, :, n],
        None if shape.along is None else _Chosen(shape.along, n),
        None if shape.damping is None else shape.damping[np.ix_(n, n)],
        shape.tip_scaled,
    )


class Turned(NamedTuple):
    """Places along a beam, in appendage axes."""

    axes: Matrix  # beam to appendage
    along: PlacedShape

    def spot(self, s: float) -> Spot:
        """Return what the modes do at the distance s."""
        return turned_spot(self.axes, self.along.spot(s))


def turned_spot(r: Matrix, spot: Spot) -> Spot:
    """Return a spot in other axes."""
    return Spot(r @ spot.place, r @ spot.displacement, r @ spot.turn, r @ spot.curvature)
