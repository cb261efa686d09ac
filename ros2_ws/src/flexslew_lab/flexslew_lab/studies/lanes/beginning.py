"""Observers of a group of lanes before their first tick, of whichever kind they are."""

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np

from flexslew_control.estimators.gained_filter import GainedFilter
from flexslew_control.estimators.kalman_tick import FilterBelief
from flexslew_control.estimators.small_motion_observer import MotionBelief
from flexslew_control.linear_form import LinearForm, LinearObserver, SmallMotionForm
from flexslew_lab.studies.lanes.lane_laws import by_lane
from flexslew_lab.studies.lanes.observers import Observe, gained, kalman, linear
from flexslew_lab.studies.lanes.small_motions import LaneMotions, small_motions
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
    if isinstance(found, SmallMotionForm):
        return _small_motions(found, observers)
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


def _small_motions(first: SmallMotionForm, forms: Sequence[SmallMotionForm]) -> Beginning:
    model, behind = first.model, first.behind.constant.shape[-1]
    n = model.coordinates
    parts = zip(*(form.belief for form in forms), strict=True)
    beliefs = MotionBelief(*(np.array(part) for part in parts))
    motions = LaneMotions(beliefs, _linear([form.behind for form in forms]))
    observe = small_motions(model.kernels, n, model.before_modes, behind)
    memory = np.zeros((model.positions + 3 * n + behind) * LANES)
    return Beginning(observe, motions, np.zeros((2 * n + behind) * LANES), memory)


def _linear(observers: Sequence[LinearObserver]) -> LinearObserver:
    """Return the matrices of linear observers by lane."""
    sizes = zip(LinearObserver._fields, (2, 2, 2, 2, 1), strict=True)
    return LinearObserver(*(by_lane(observers, name, d) for name, d in sizes))
