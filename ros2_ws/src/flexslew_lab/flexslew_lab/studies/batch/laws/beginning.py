"""Observers of a group of members before their first tick, of whichever kind they are."""

from collections.abc import Iterable, Sequence
from typing import Any, NamedTuple, TypeVar

import numpy as np

from flexslew_control.controllers.linear_form import (
    KalmanForm,
    LinearObserver,
    Observer,
    OnModelForm,
    SmallMotionForm,
)
from flexslew_control.estimators.gained_filter import GainFilter
from flexslew_control.estimators.small_motion_observer import MotionConstants
from flexslew_lab.studies.batch.groups.batch_laws import by_member
from flexslew_lab.studies.batch.laws.by_member import (
    BatchFilter,
    BatchSteady,
    MemberSizes,
    kalman,
    small_motion,
    steady,
)
from flexslew_lab.studies.batch.laws.observers import (
    ObserverStep,
    combine_observer,
    gain_filter,
    linear,
)
from flexslew_lab.studies.batch.laws.on_model import BatchEfforts, on_model
from flexslew_plant.arrays import Indices, Vector
from flexslew_plant.testbeds.compiled.batch_kernel import BATCH_WIDTH
from flexslew_plant.testbeds.kernels import Kernels
from flexslew_plant.testbeds.model import Model

_Form = TypeVar("_Form", LinearObserver, GainFilter)


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
        return _linear(observers)
    if isinstance(found, SmallMotionForm):
        return _small_motion(found, observers)
    if isinstance(found, GainFilter):
        outputs, k = found.output.shape
        filtered = _by_member([found], (2, 2, 2, 2, 1, 2, 1))
        buffer, start_tick = (_zeros(k + outputs), _zeros(k + outputs)), _at_first()
        return Beginning(gain_filter(k), (start_tick, filtered), *buffer, start_tick)
    if isinstance(found, OnModelForm):
        first = beginning(found.observer, [one.observer for one in observers])
        efforts = BatchEfforts(*_stacked((one.model.packed, *one[2:]) for one in observers))
        m, read = len(found.surface), first.z.size // BATCH_WIDTH
        step = on_model(*_of(found.model), MemberSizes(0, m, read, found.model.joints, 0))
        return combined(first, Beginning(step, efforts, _zeros(m), _zeros(0)), in_series=True)
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


def combined(first: Beginning, then: Beginning, in_series: bool = False) -> Beginning:
    """Return two observers as one; see combine_observer."""
    rows = first.z.size
    return Beginning(
        combine_observer(first.observe, rows, first.memory.size, then.observe, in_series),
        (first.constants, then.constants),
        np.concatenate((first.z, then.z)),
        np.concatenate((np.zeros(rows * in_series), first.memory, then.memory)),
        first.started if in_series else None,
    )


def _small_motion(first: SmallMotionForm, forms: Sequence[SmallMotionForm]) -> Beginning:
    model = first.model
    n, outputs = model.coordinates, first.constants.gain.shape[2]
    sizes = MemberSizes(model.positions + n, 2 * n, outputs, model.joints, 0)
    parts = zip(*(form.constants for form in forms), strict=True)
    constants = MotionConstants(*(np.concatenate(part) for part in parts))
    step = small_motion(model.kernels, model.before_modes, sizes)
    motion = Beginning(step, constants, _zeros(sizes.estimate), _zeros(sizes.memory))
    return combined(motion, _linear([form.behind for form in forms]), in_series=True)


def _linear(observers: Sequence[LinearObserver]) -> Beginning:
    """Return linear observers, which can start again where all ticks have the same matrices."""
    found, start_tick = observers[0], _at_first()
    k, numbers = found.constant.shape[-1], _by_member(observers, (2, 2, 2, 2, 1, 2))
    started = start_tick if found.state.ndim == 2 else None
    return Beginning(linear(k), (start_tick, numbers), _zeros(k), _zeros(k), started)


def _by_member(parts: Sequence[_Form], dimensions: tuple[int, ...]) -> _Form:
    """Return matrices of every member, each with so many dimensions at one tick."""
    form = type(parts[0])
    names = zip(form._fields, dimensions, strict=True)
    return form(*(by_member(parts, name, size) for name, size in names))
