"""Efforts that were sampled but not held: the held efforts of the same response."""

from dataclasses import replace
from typing import Literal

import numpy as np

from flexslew_lab.identification.modal.modes import ModalModel, identify_modes
from flexslew_lab.identification.records.record import Quantity, Record
from flexslew_plant.arrays import Matrix
from flexslew_plant.errors import BadInput

Hold = Literal["held", "band-limited"]
_TAPS = 24  # samples on either side of a tick's middle
_BAND = 0.8  # of half the sampling rate, in which the response is the same
_LINES = 400  # frequencies at which it is fitted
_TRIED = 8192  # ticks on which both ways to read efforts are tried, at most
_ORDER = 16  # of the model that tests whether readings follow an effort at once
_DETERMINED = 1e-2  # of an effort, what those before it do not determine
_SIGNIFICANT = 30.0  # ratio of variances (F) that noise alone exceeds once in 10 million records


def as_band_limited(record: Record) -> Record:
    """Return a record whose efforts, held from tick to tick, act as a band-limited signal does.

    A signal u acts as held samples do after a filter with the response sinc(w h / 2)
    exp(-j w h / 2), up to its images above half the sampling rate, which modes hardly follow. Its
    inverse, the signal at the middle of each tick with more of its fast parts, is a filter of 48
    samples, fitted by least squares. The record loses 47 ticks.

    Args:
        record: complete, on even ticks, whose efforts are samples at the ticks of a signal without
            parts above half the sampling rate.

    Raises:
        BadInput: samples are missing, not at even times, or too few.
    """
    if not _is_even(record):
        words = f"needs {4 * _TAPS} or more samples at even times without gaps"
        raise BadInput(f"{record.source}: a signal that is not held {words}", key="hold")
    w = np.pi * _BAND * (np.arange(_LINES) + 0.5) / _LINES  # of a step of 1
    cosines = 2.0 * np.cos(np.outer(w, np.arange(_TAPS) + 0.5))
    half = np.linalg.lstsq(cosines, 1.0 / np.sinc(w / (2.0 * np.pi)), rcond=None)[0]
    taps = np.concatenate((half[::-1], half))
    effort = np.column_stack([np.convolve(u, taps, mode="valid") for u in record.effort.T])
    first = _TAPS - 1
    measured = record.measured[first : first + len(effort) + 1]
    return replace(record, effort=effort, measured=measured, held=False)


def acts_as_held(record: Record) -> bool:
    """Return whether a record shows efforts that are held from sample to sample.

    A reading does not depend on an effort that is held from its tick on. Where it does, as of a
    signal that is not held, or in a closed loop, modes are identified both ways on the beginning of
    the record: the true way needs fewer modes, or leaves whiter noise. Accelerations follow an
    effort at once, held or not.
    """
    if not _is_even(record) or record.columns(Quantity.ACCELERATION):
        return True
    ticks = min(record.ticks, _TRIED)
    part = replace(record, effort=record.effort[:ticks], measured=record.measured[: ticks + 1])
    if not _follows_at_once(part):
        return True
    try:
        held, other = (_rank(identify_modes(one)) for one in (part, as_band_limited(part)))
    except BadInput:  # which the whole record meets, too
        return True
    return held <= other


def _is_even(record: Record) -> bool:
    """Return whether a record is complete, on even ticks, and long enough for the filter."""
    return record.steps is None and record.is_complete and record.ticks >= 4 * _TAPS


def _follows_at_once(record: Record) -> bool:
    """Return whether readings depend on the effort of their tick, given those before (F-test).

    They may if the efforts before it determine it, as those of a slow signal do.
    """
    u, n = record.effort, record.ticks
    order = min(_ORDER, n // (4 * (u.shape[1] + len(record.outputs))))
    lags = range(1, order + 1)
    past = [x[order - k : n - k] for k in lags for x in (u, record.measured)]
    before = np.hstack((*past, np.ones((n - order, 1))))
    size = np.sqrt(np.einsum("ij,ij->j", before, before))
    basis = np.linalg.qr(before / np.where(size > 0.0, size, 1.0))[0]

    def left(values: Matrix) -> Matrix:
        return values - basis @ (basis.T @ values)

    now = left(u[order:])
    if (now.std(axis=0) < _DETERMINED * u.std(axis=0)).any():
        return True
    readings = left(record.measured[order:n])
    explained = readings - now @ np.linalg.lstsq(now, readings, rcond=None)[0]
    freedom = n - order - basis.shape[1] - u.shape[1]
    gain = (readings**2).sum(axis=0) / np.maximum((explained**2).sum(axis=0), 1e-300) - 1.0
    return bool((gain * freedom / u.shape[1] > _SIGNIFICANT).any())


def _rank(model: ModalModel) -> tuple[int, float]:
    """Return the number of modes, and how far from white noise the rest is."""
    return len(model.modes), max(one.statistic for one in model.whiteness)
