"""A shape with some of its modes, or seen in other axes."""

from typing import NamedTuple

import numpy as np

from flexslew_plant.arrays import Matrix
from flexslew_plant.testbeds.spacecraft.shapes.integrals import Integrals
from flexslew_plant.testbeds.spacecraft.shapes.shape import (
    AppendagePoint,
    DeflectionLine,
    FlexibleShape,
)


class _ModeSubset(NamedTuple):
    """Places along a shape of which some modes count."""

    along: DeflectionLine
    modes: list[int]

    def point(self, s: float) -> AppendagePoint:
        """Return what these modes do at the distance s."""
        return _mode_subset(self.along.point(s), self.modes)


def _mode_subset(point: AppendagePoint, n: list[int]) -> AppendagePoint:
    return AppendagePoint(
        point.place, point.displacement[:, n], point.turn[:, n], point.curvature[:, n]
    )


def select_modes(shape: FlexibleShape, n: list[int]) -> FlexibleShape:
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
            None if i.shortening is None else i.shortening.select_modes(n),
        ),
        shape.mass[n],
        shape.stiffness[n],
        _mode_subset(shape.tip, n),
        shape.line,
        shape.line_shape[:, :, n],
        None if shape.along is None else _ModeSubset(shape.along, n),
        None if shape.damping is None else shape.damping[np.ix_(n, n)],
        shape.tip_scaled,
    )


class TransformedShape(NamedTuple):
    """Places along a beam, in appendage axes."""

    axes: Matrix  # beam to appendage
    along: DeflectionLine

    def point(self, s: float) -> AppendagePoint:
        """Return what the modes do at the distance s."""
        return transform_point(self.axes, self.along.point(s))


def transform_point(r: Matrix, point: AppendagePoint) -> AppendagePoint:
    """Return a spot in other axes."""
    return AppendagePoint(
        r @ point.place, r @ point.displacement, r @ point.turn, r @ point.curvature
    )
