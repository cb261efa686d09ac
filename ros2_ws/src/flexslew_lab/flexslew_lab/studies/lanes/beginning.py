"""Observers of a group of lanes before their first tick, of whichever kind they are."""

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np

from flexslew_control.estimators.gained_filter import GainedFilter
from flexslew_control.estimators.kalman_tick import FilterBelief
from flexslew_control.linear_form import LinearForm, LinearObserver
from flexslew_lab.studies.lanes.lane_laws import by_lane
from flexslew_lab.studies.lanes.observers import Observe, gained, kalman, linear
from flexslew_plant.arrays import Vector
from flexslew_plant.testbeds.compiled.lanes import LANES


class Beginning(NamedTuple):
    """An observer before its first tick."""

    observe: Observe
    constants: tuple[Any, ...]
    z: Vector  # flat
    memory: Vector  # what it keeps besides, flat


def beginning(form: LinearForm, observers: Sequence[Any]) -> Beginning:
    """Return the observer of a controller.

    Args:
        form: of the first lane.
        observers: one for all lanes, or one for each, which no Kalman filter has.
    """
    found = form.observer
    if isinstance(found, LinearObserver):
        k = found.constant.shape[-1]
        return Beginning(linear(k), _linear(observers), np.zeros(k * LANES), np.empty(k * LANES))
    if isinstance(found, GainedFilter):
        outputs, k = found.output.shape
        filtered = GainedFilter(*map(np.ascontiguousarray, found))
        return Beginning(gained(k), filtered, np.zeros((k + outputs) * LANES), np.empty(k * LANES))
    k, outputs = len(found.matrices.origin), len(found.matrices.c)
    constants = FilterBelief(found.model.packed, *map(np.ascontiguousarray, found.matrices))
    memory = np.empty(LANES * (k + k * k))
    model = found.model
    observe = kalman(model.kernels, model.before_modes, model.coordinates)
    return Beginning(observe, constants, np.zeros((k + outputs) * LANES), memory)


def _linear(observers: Sequence[LinearObserver]) -> LinearObserver:
    """Return the matrices of linear observers by lane."""
    sizes = zip(LinearObserver._fields, (2, 2, 2, 2, 1), strict=True)
    return LinearObserver(*(by_lane(observers, name, d) for name, d in sizes))
