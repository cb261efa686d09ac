"""Observers of a group of members before their first tick, of whichever kind they are."""

from collections.abc import Iterable, Sequence
from typing import Any, NamedTuple

import numpy as np

from flexslew_control.estimators.gained_filter import GainFilter
from flexslew_control.estimators.kalman_tick import FilterConstants
from flexslew_control.estimators.small_motion_observer import MotionConstants
from flexslew_control.linear_form import (
    KalmanForm,
    LinearObserver,
    Observer,
    SmallMotionForm,
    SteadyForm,
)
from flexslew_lab.studies.batch.groups.batch_laws import by_member
from flexslew_lab.studies.batch.laws.observers import ObserverStep, gain_filter, kalman, linear
from flexslew_lab.studies.batch.laws.on_model import (
    BatchEfforts,
    BatchSteady,
    observer_with_law,
    on_model,
    steady,
)
from flexslew_lab.studies.batch.laws.small_motions import BatchMotion, small_motion_observer
from flexslew_plant.arrays import Indices, Vector
from flexslew_plant.testbeds.compiled.batch_kernel import BATCH_WIDTH
from flexslew_plant.testbeds.kernels import Kernels
from flexslew_plant.testbeds.model import Model


class Beginning(NamedTuple):
    """An observer before its first tick."""

    observe: ObserverStep
    constants: tuple[Any, ...]
    z: Vector  # flat
    memory: Vector  # what it keeps besides, flat
    started: Indices | None = None  # tick at which it began, (1,); None: it cannot start again


def beginning(found: Observer, observers: Sequence[Any]) -> Beginning:
    """Return the observer of a controller.

    Args:
        found: of the first member.
        observers: one for all members, or one for each, which no GainFilter is.
    """
    if isinstance(found, LinearObserver):
        k = found.constant.shape[-1]
        start_tick, whole = _at_first(), found.state.ndim == 2  # else each tick has its own gains
        given = start_tick, _linear(observers)
        return Beginning(linear(k), given, _zeros(k), _zeros(k), start_tick if whole else None)
    if isinstance(found, SmallMotionForm):
        return _small_motion(found, observers)
    if isinstance(found, GainFilter):
        outputs, k = found.output.shape
        filtered = GainFilter(*map(np.ascontiguousarray, found))
        buffer, start_tick = (_zeros(k + outputs), _zeros(k + outputs)), _at_first()
        return Beginning(gain_filter(k), (start_tick, filtered), *buffer, start_tick)
    if isinstance(found, KalmanForm):
        k, outputs = len(found.matrices.origin), len(found.matrices.c)
        design_model = FilterConstants(
            *_stacked((one.model.packed, *one.matrices) for one in observers)
        )
        memory = _zeros(k + k * k + outputs)
        return Beginning(kalman(*_of(found.model)), design_model, _zeros(k + outputs), memory)
    if isinstance(found, SteadyForm):
        gains = BatchSteady(*_stacked((one.model.packed, *one[1:]) for one in observers))
        buffer = _zeros(sum(found.gain.shape)), _zeros(len(found.output))
        return Beginning(steady(*_of(found.model)), gains, *buffer)
    first = beginning(found.observer, [one.observer for one in observers])
    efforts = BatchEfforts(*_stacked((one.model.packed, *one[2:]) for one in observers))
    observer_step = observer_with_law(first.observe, first.z.size, on_model(*_of(found.model)))
    z = np.concatenate((first.z, _zeros(len(found.surface))))
    return Beginning(observer_step, (first.constants, efforts), z, first.memory)


def _of(model: Model) -> tuple[Kernels, int, int]:
    return model.kernels, model.before_modes, model.coordinates


def _at_first() -> Indices:
    return np.zeros(1, np.int64)


def _zeros(rows: int) -> Vector:
    return np.zeros(rows * BATCH_WIDTH)


def _stacked(parts: Iterable[tuple[Any, ...]]) -> list[Any]:
    """Return arrays of every member, an axis for members in front."""
    return [np.array(arrays, dtype=float) for arrays in zip(*parts, strict=True)]


def _small_motion(first: SmallMotionForm, forms: Sequence[SmallMotionForm]) -> Beginning:
    model, output_states = first.model, first.behind.constant.shape[-1]
    n = model.coordinates
    parts = zip(*(form.belief for form in forms), strict=True)
    design_models = MotionConstants(*(np.array(part) for part in parts))
    batch_motion = BatchMotion(design_models, _linear([form.behind for form in forms]))
    observer_step = small_motion_observer(model.kernels, n, model.before_modes, output_states)
    memory = np.zeros((model.positions + 3 * n + output_states) * BATCH_WIDTH)
    buffer = np.zeros((2 * n + output_states) * BATCH_WIDTH)
    return Beginning(observer_step, (_at_first(), batch_motion), buffer, memory)


def _linear(observers: Sequence[LinearObserver]) -> LinearObserver:
    """Return the matrices of linear observers by member."""
    sizes = zip(LinearObserver._fields, (2, 2, 2, 2, 1, 2), strict=True)
    return LinearObserver(*(by_member(observers, name, d) for name, d in sizes))
