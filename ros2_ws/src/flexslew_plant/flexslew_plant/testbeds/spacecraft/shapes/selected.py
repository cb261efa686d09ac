"""A shape with some of its modes, or seen in other axes."""

from collections.abc import Callable
from functools import partial
from typing import NamedTuple

import numpy as np

from flexslew_plant.arrays import Matrix
from flexslew_plant.testbeds.spacecraft.shapes.integrals import Integrals
from flexslew_plant.testbeds.spacecraft.shapes.shape import (
    AppendagePoint,
    DeflectionLine,
    FlexibleShape,
)


class MappedLine(NamedTuple):
    """Places along a shape, each changed: some of its modes, or other axes."""

    along: DeflectionLine
    change: Callable[[AppendagePoint], AppendagePoint]

    def point(self, s: float) -> AppendagePoint:
        """Return what the modes do at the distance s."""
        return self.change(self.along.point(s))


def _mode_subset(n: list[int], point: AppendagePoint) -> AppendagePoint:
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
        _mode_subset(n, shape.tip),
        shape.line,
        shape.line_shape[:, :, n],
        None if shape.along is None else MappedLine(shape.along, partial(_mode_subset, n)),
        None if shape.damping is None else shape.damping[np.ix_(n, n)],
        shape.tip_scaled,
    )


def transform_point(r: Matrix, point: AppendagePoint) -> AppendagePoint:
    """Return a spot in other axes."""
    return AppendagePoint(
        r @ point.place, r @ point.displacement, r @ point.turn, r @ point.curvature
    )
