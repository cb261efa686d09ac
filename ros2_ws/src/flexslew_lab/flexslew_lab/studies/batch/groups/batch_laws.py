"""Laws side by side: the same in every member, or one for each."""

from collections.abc import Hashable, Sequence
from typing import Any, NamedTuple

import numpy as np

from flexslew_control.allocation import sharing
from flexslew_control.controllers.linear_form import LawForm, LinearForm, LinearObserver
from flexslew_control.estimators.attitude_tick import AttitudeNumbers
from flexslew_control.estimators.flexible_attitude_tick import FlexibleForm
from flexslew_control.estimators.gained_filter import GainFilter
from flexslew_plant.arrays import Tensor
from flexslew_plant.testbeds.compiled.batch_kernel import BatchKernel
from flexslew_plant.testbeds.compiled.scalar_kernel import scalar_kernel
from flexslew_plant.testbeds.compiled.traced_kernel import traced_kernel
from flexslew_plant.testbeds.model import Model

_MOST = 400_000  # numbers of an observer, tick by tick, that each member may have for itself


class BatchLaws(NamedTuple):
    """The laws of a group, and what they know: one for all members, or one for each."""

    laws: list[LawForm]
    observers: list[Any]
    allocation: Any  # sharing.AllocationNumbers of all; None: there is none
    filters: list[AttitudeNumbers]  # of the attitude; none: there is none
    spacecraft_models: list[FlexibleForm]  # what these believe besides; none: nothing


def kind_of(form: LinearForm) -> Hashable:
    """Return what is equal for laws that may fly side by side."""
    known = _kind_of_observer(form.observer)
    if known is None or is_large(form):
        return id(form)
    law, shared = form.law, form.shared
    shapes = tuple(part.shape for part in law if isinstance(part, np.ndarray))
    has_integral, tracking_rate, limit = law.integration
    integrand = law.integrand.tobytes() if has_integral else b""
    reference = () if shared is None else (shared.position.tobytes(), shared.velocity.tobytes())
    kind = shared and sharing.kind_of(shared.allocation)
    integral = has_integral, tracking_rate, limit.tobytes(), integrand
    return known, shapes, *integral, reference, kind, _kind_of_filters(form)


def _kind_of_observer(found: Any) -> Hashable:
    """Return what is equal for observers, or parts of them, side by side.

    None: there is one for all members, since a GainFilter has the gains of a tick for all.
    """
    if isinstance(found, Model):
        return found.kernels, found.before_modes, found.packed.shape
    if isinstance(found, GainFilter):
        return None
    array = isinstance(found, np.ndarray)
    kinds: tuple[Hashable, ...] = found.shape if array else tuple(map(_kind_of_observer, found))
    return None if None in kinds else kinds


def spacecraft_kernel(form: FlexibleForm) -> BatchKernel:
    """Return how the craft flies in a batch that a filter believes in."""
    return traced_kernel(form.model, False) or scalar_kernel(form.model)


def _kind_of_filters(form: LinearForm) -> Hashable:
    """Return what is equal for filters of the attitude that may go side by side."""
    numbers, spacecraft = form.attitude, form.flexible
    if numbers is None or spacecraft is None:
        return tuple(part.shape for part in numbers or ())
    shapes = tuple(part.shape for part in (*numbers, *spacecraft.numbers))
    return (
        shapes,
        spacecraft_kernel(spacecraft).advance,
        spacecraft.steps,
        numbers.tracker.tobytes(),
    )


def is_large(form: LinearForm) -> bool:
    """Return whether such an observer, another at every tick, is too large for each member."""
    return size_of(form) > _MOST


def size_of(form: LinearForm) -> int:
    """Return how many numbers a linear observer holds, those of all ticks; of others zero."""
    observer = form.observer
    return sum(part.size for part in observer) if isinstance(observer, LinearObserver) else 0


def outputs_of(form: LinearForm, joints: int) -> int:
    """Return how many readings a law needs: joints, their rates, the first of the tips."""
    if form.shared is None:
        return int(form.law.from_output.shape[-1])
    drives = form.shared.allocation.drives
    tips = np.concatenate((drives.speeds, drives.angles))
    return 2 * joints + (int(tips.max()) + 1 if tips.size else 0)


def batch_laws(forms: Sequence[LinearForm]) -> BatchLaws:
    """Return the laws of all members of a group."""
    members = forms[:1] if all(form is forms[0] for form in forms) else forms
    shared = [form.shared.allocation for form in members if form.shared is not None]
    allocation = sharing.side_by_side(shared) if shared else None
    filters = [form.attitude for form in members if form.attitude is not None]
    spacecraft_list = [form.flexible for form in members if form.flexible is not None]
    laws, observers = [form.law for form in members], [form.observer for form in members]
    return BatchLaws(laws, observers, allocation, filters, spacecraft_list)


def by_member(parts: Sequence[Any], name: str, dimensions: int) -> Tensor:
    """Return an array of laws or observers with an axis for ticks in front, one for members behind.

    Either has one entry where all ticks, or all members, have the same.

    Args:
        parts: one for all members, or one for each.
        name: of the field.
        dimensions: of the field at one tick.
    """
    arrays = [getattr(part, name) for part in parts]
    ticks = [array if array.ndim > dimensions else array[None] for array in arrays]
    return np.ascontiguousarray(np.stack(ticks, axis=-1))
