"""The record of an experiment while it is flown, and the responses computed from it so far."""

from dataclasses import replace
from typing import NamedTuple

import numpy as np

from flexslew_control.plan import Plan
from flexslew_lab.console.view import BenchView
from flexslew_lab.identification.records.measurements import FIELDS, Channels, ticks_record
from flexslew_lab.identification.records.record import Record
from flexslew_lab.identification.responses.frequency_response import (
    FrequencyResponse,
    frequency_response,
    period_count,
)
from flexslew_plant.errors import BadInput

LEAST = 3  # periods: the first holds the transient, two separate noise from response


class Progress(NamedTuple):
    """How far an experiment is."""

    periods: int  # of every one of its parts that are whole
    words: str  # for people


def progress(plan: Plan, time: float) -> Progress:
    """Return how far an experiment is at a simulated time [s]."""
    if time <= plan.start:
        return Progress(0, f"begins at {plan.start:.2f} s")
    done = min((time - plan.start) / plan.summary["duration"], 1.0)
    words = f"{done:.0%} of {plan.summary['duration']:g} s shaken"
    try:
        periods = period_count(plan, int((time - plan.start) / plan.period))
    except BadInput as error:
        return Progress(0, f"{words}; {error}")
    if periods >= LEAST:
        return Progress(
            periods, f"{words}; {periods} of {plan.summary['periods']} periods received"
        )
    parts = plan.summary["experiments"]
    last = plan.summary["taper"]
    last += ((parts - 1) * plan.summary["periods"] + LEAST) * plan.summary["period"]
    return Progress(periods, f"{words}; responses show from {plan.start + last:.0f} s on")


def record_so_far(view: BenchView, plan: Plan) -> Record:
    """Return the measurements from the start of an experiment until now, at most to its end.

    Args:
        view: view of the bench, with a link that receives the sensors.
        plan: plan of the experiment.

    Raises:
        BadInput: if there are no measurements yet, or ticks are missing.
    """
    joints, track = view.joints, view.measured
    if joints is None or not track.time.size or track.time[-1] <= plan.start:
        raise BadInput(f"the experiment begins at {plan.start:.2f} s: nothing is measured yet")
    end = plan.start + plan.summary["duration"]
    first = int(np.searchsorted(track.time, plan.start - 0.5 * joints.period))
    last = int(np.searchsorted(track.time, end + 0.5 * joints.period))
    time = track.time[first:last]
    whole = abs(time[0] - plan.start) < 0.5 * joints.period
    if not whole or (np.abs(np.diff(time) - joints.period) > 0.5 * joints.period).any():
        raise BadInput(
            "this page has not received every tick of the experiment: "
            "./flexslew identify reads them from the run's log"
        )
    values = {name: track.column(name)[first:last].copy() for name in FIELDS}
    sensors = view.testbed.model().appendages if view.testbed is not None else None
    channels = Channels(
        joints.names, joints.units, joints.appendages, np.array(joints.limit), sensors
    )
    return ticks_record(values, channels, joints.period, "the experiment")


def response_so_far(record: Record, plan: Plan, periods: int) -> FrequencyResponse:
    """Return the frequency responses from the first periods of an experiment.

    Args:
        record: record from the start of the experiment.
        plan: plan of the experiment.
        periods: periods of each of its parts, at least LEAST.
    """
    return frequency_response([record], [replace(plan, start=0.0)], periods)
