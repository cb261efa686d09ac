"""Observers of a group of members before their first tick, of whichever kind they are."""

from collections.abc import Iterable, Sequence
from typing import Any, NamedTuple

import numpy as np

from flexslew_control.estimators.gained_filter import GainFilter
from flexslew_control.estimators.small_motion_observer import MotionConstants
from flexslew_control.linear_form import (
    KalmanForm,
    LinearObserver,
    Observer,
    OnModelForm,
    SmallMotionForm,
)
from flexslew_lab.studies.batch.groups.batch_laws import by_member
from flexslew_lab.studies.batch.laws.by_member import (
    BatchFilter,
    BatchMotion,
    BatchSteady,
    MemberSizes,
    kalman,
    observed_motion,
    small_motion,
    steady,
)
from flexslew_lab.studies.batch.laws.observers import ObserverStep, gain_filter, linear
from flexslew_lab.studies.batch.laws.on_model import BatchEfforts, on_model
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
    if isinstance(found, OnModelForm):
        first = beginning(found.observer, [one.observer for one in observers])
        efforts = BatchEfforts(*_stacked((one.model.packed, *one[2:]) for one in observers))
        step = on_model(*_of(found.model), first.observe, first.z.size)
        z = np.concatenate((first.z, _zeros(len(found.surface))))
        return Beginning(step, (first.constants, efforts), z, first.memory)
    outputs, k = found.output.shape
    numbers: tuple[Any, ...]
    if isinstance(found, KalmanForm):
        sizes = MemberSizes(k + k * k, k + outputs, outputs, found.model.joints, outputs)
        parts = [(one.model.packed, *one.matrices) for one in observers]
        kept = ((packed, q, c, r, p) for packed, _, _, q, c, r, _, p in parts)
        numbers, step = BatchFilter(*_stacked(kept)), kalman(*_of(found.model), sizes)
    else:
        sizes = MemberSizes(k + outputs, k + outputs, outputs, found.model.joints, outputs)
        numbers = BatchSteady(*_stacked((one.model.packed, *one[1:]) for one in observers))
        step = steady(*_of(found.model), sizes)
    memory = _zeros(sizes.memory + sizes.variances)
    return Beginning(step, numbers, _zeros(sizes.estimate), memory)


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
    model, states = first.model, first.behind.constant.shape[-1]
    n, outputs = model.coordinates, first.constants.gain.shape[2]
    sizes = MemberSizes(model.positions + n, 2 * n, outputs, model.joints, 0)
    parts = zip(*(form.constants for form in forms), strict=True)
    constants = MotionConstants(*(np.concatenate(part) for part in parts))
    batch = BatchMotion(constants, _linear([form.behind for form in forms]))
    motion = small_motion(model.kernels, model.before_modes, sizes)
    step = observed_motion(motion, sizes, states)
    memory = _zeros(sizes.memory + sizes.estimate + states)
    return Beginning(step, (_at_first(), batch), _zeros(sizes.estimate + states), memory)


def _linear(observers: Sequence[LinearObserver]) -> LinearObserver:
    """Return the matrices of linear observers by member."""
    sizes = zip(LinearObserver._fields, (2, 2, 2, 2, 1, 2), strict=True)
    return LinearObserver(*(by_member(observers, name, d) for name, d in sizes))
