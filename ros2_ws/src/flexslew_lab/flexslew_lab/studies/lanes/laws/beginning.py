"""Observers of a group of lanes before their first tick, of whichever kind they are."""

from collections.abc import Iterable, Sequence
from typing import Any, NamedTuple

import numpy as np

from flexslew_control.estimators.gained_filter import GainedFilter
from flexslew_control.estimators.kalman_tick import FilterBelief
from flexslew_control.estimators.small_motion_observer import MotionBelief
from flexslew_control.linear_form import (
    KalmanForm,
    LinearObserver,
    Observer,
    SmallMotionForm,
    SteadyForm,
)
from flexslew_lab.studies.lanes.groups.lane_laws import by_lane
from flexslew_lab.studies.lanes.laws.observers import Observe, gained, kalman, linear
from flexslew_lab.studies.lanes.laws.on_model import (
    LaneEfforts,
    LaneSteady,
    observed_and_acted,
    on_model,
    steady,
)
from flexslew_lab.studies.lanes.laws.small_motions import LaneMotions, small_motions
from flexslew_plant.arrays import Indices, Vector
from flexslew_plant.testbeds.compiled.lanes import LANES
from flexslew_plant.testbeds.kernels import Kernels
from flexslew_plant.testbeds.model import Model


class Beginning(NamedTuple):
    """An observer before its first tick."""

    observe: Observe
    constants: tuple[Any, ...]
    z: Vector  # flat
    memory: Vector  # what it keeps besides, flat
    begun: Indices | None = None  # tick at which it began, (1,); None: it cannot start again


def beginning(found: Observer, observers: Sequence[Any]) -> Beginning:
    """Return the observer of a controller.

    Args:
        found: of the first lane.
        observers: one for all lanes, or one for each, which no GainedFilter is.
    """
    if isinstance(found, LinearObserver):
        k = found.constant.shape[-1]
        begun, whole = _at_first(), found.state.ndim == 2  # else each tick has its own gains
        given = begun, _linear(observers)
        return Beginning(linear(k), given, _room(k), _room(k), begun if whole else None)
    if isinstance(found, SmallMotionForm):
        return _small_motions(found, observers)
    if isinstance(found, GainedFilter):
        outputs, k = found.output.shape
        filtered = GainedFilter(*map(np.ascontiguousarray, found))
        room, begun = (_room(k + outputs), _room(k + outputs)), _at_first()
        return Beginning(gained(k), (begun, filtered), *room, begun)
    if isinstance(found, KalmanForm):
        k, outputs = len(found.matrices.origin), len(found.matrices.c)
        belief = FilterBelief(*_stacked((one.model.packed, *one.matrices) for one in observers))
        memory = _room(k + k * k + outputs)
        return Beginning(kalman(*_of(found.model)), belief, _room(k + outputs), memory)
    if isinstance(found, SteadyForm):
        gains = LaneSteady(*_stacked((one.model.packed, *one[1:]) for one in observers))
        room = _room(sum(found.gain.shape)), _room(len(found.output))
        return Beginning(steady(*_of(found.model)), gains, *room)
    first = beginning(found.observer, [one.observer for one in observers])
    efforts = LaneEfforts(*_stacked((one.model.packed, *one[2:]) for one in observers))
    observe = observed_and_acted(first.observe, first.z.size, on_model(*_of(found.model)))
    z = np.concatenate((first.z, _room(len(found.surface))))
    return Beginning(observe, (first.constants, efforts), z, first.memory)


def _of(model: Model) -> tuple[Kernels, int, int]:
    return model.kernels, model.before_modes, model.coordinates


def _at_first() -> Indices:
    return np.zeros(1, np.int64)


def _room(rows: int) -> Vector:
    return np.zeros(rows * LANES)


def _stacked(parts: Iterable[tuple[Any, ...]]) -> list[Any]:
    """Return arrays of every lane, an axis for lanes in front."""
    return [np.array(arrays, dtype=float) for arrays in zip(*parts, strict=True)]


def _small_motions(first: SmallMotionForm, forms: Sequence[SmallMotionForm]) -> Beginning:
    model, behind = first.model, first.behind.constant.shape[-1]
    n = model.coordinates
    parts = zip(*(form.belief for form in forms), strict=True)
    beliefs = MotionBelief(*(np.array(part) for part in parts))
    motions = LaneMotions(beliefs, _linear([form.behind for form in forms]))
    observe = small_motions(model.kernels, n, model.before_modes, behind)
    memory = np.zeros((model.positions + 3 * n + behind) * LANES)
    room = np.zeros((2 * n + behind) * LANES)
    return Beginning(observe, (_at_first(), motions), room, memory)


def _linear(observers: Sequence[LinearObserver]) -> LinearObserver:
    """Return the matrices of linear observers by lane."""
    sizes = zip(LinearObserver._fields, (2, 2, 2, 2, 1, 2), strict=True)
    return LinearObserver(*(by_lane(observers, name, d) for name, d in sizes))
