"""What disturbs the bench or breaks on it: of the schedule, then of operators, by number."""

from collections.abc import Callable, Sequence
from math import inf
from typing import Any, TypeAlias

import numpy as np

from flexslew_plant.arrays import Vector, read_only
from flexslew_plant.bench.records import ActiveFault
from flexslew_plant.bench.schedule import Schedule, ScheduleEntry
from flexslew_plant.events import DisturbanceChanged, Fact, FaultChanged
from flexslew_plant.faults import Names, Timed, check_fault
from flexslew_plant.faults.injection import Faults
from flexslew_plant.hardware.disturbances import (
    TimedDisturbance,
    check_disturbance,
    disturbance_effort,
)
from flexslew_plant.settings import plain
from flexslew_plant.testbeds.model import Model
from flexslew_plant.yaml_data import yaml_text

Injection: TypeAlias = TimedDisturbance | Timed
Report: TypeAlias = Callable[[Fact], None]  # notes what happened


def injection_of(entry: ScheduleEntry, names: Names, period: float, place: str) -> Injection:
    """Return the disturbance or the fault of an entry, with its ticks.

    Args:
        entry: not a switch.
        names: of the testbed.
        period: of a tick [s].
        place: where it stands, for errors.

    Raises:
        BadInput: see check_disturbance, check_fault.
    """
    start = round(entry.at / period)
    end = inf if entry.until is None else max(round(entry.until / period), start + 1)
    if entry.fault is not None:
        check_fault(entry.fault, names, f"{place}.fault")
        return Timed(entry.fault, start, end)
    shapes = entry.disturbance or {}
    check_disturbance(shapes, names.joints, f"{place}.disturbance")
    return TimedDisturbance(shapes, start, end)


def names_of(model: Model, limit: Vector) -> Names:
    """Return what faults and disturbances can be about.

    Args:
        model: what stands on the bench.
        limit: of the effort of each joint, shape (joints,) [N m or N].
    """
    limits = tuple(limit.tolist())
    return Names(model.joint_names, model.appendages.names, limits, model.one_way)


def injections_of(
    schedule: Schedule, names: Names, period: float, source: str = ""
) -> list[Injection]:
    """Return the disturbances and the faults of a schedule, with their ticks.

    Args:
        schedule: of a trial.
        names: of the testbed.
        period: of a tick [s].
        source: of the trial, for errors.

    Raises:
        BadInput: see injection_of.
    """
    place = f"{source}: schedule" if source else "schedule"
    return [
        injection_of(entry, names, period, f"{place}.{i}")
        for i, entry in enumerate(schedule)
        if entry.switch is None and entry.retarget is None
    ]


class Injections:
    """The disturbances and faults of one epoch.

    Args:
        names: names of the testbed's parts.
        period: duration of a tick [s].
        seed: seed of the trial.
        epoch: number of resets so far.
        known: disturbances and faults of the schedule.
        report: takes the events when they begin and end.

    Attributes:
        disturbances: all of this epoch, those that are over included.
    """

    def __init__(
        self,
        names: Names,
        period: float,
        seed: int,
        epoch: int,
        known: Sequence[Injection],
        report: Report,
    ) -> None:
        self._names, self._period, self._report = names, period, report
        self._all = list(known)
        self.disturbances = [one for one in known if isinstance(one, TimedDisturbance)]
        self._finished: set[int] = set()  # by an operator
        self._zero: Vector = read_only(np.zeros(len(names.joints)))
        self.faults = Faults(
            names, seed, epoch, tuple(one for one in known if isinstance(one, Timed))
        )

    def add(self, injection: Injection) -> tuple[str, int]:
        """Take one more; return what it is in a word, and its number."""
        self._all.append(injection)
        number = len(self._all) - 1
        if isinstance(injection, Timed):
            self.faults.add(injection)
            return injection.fault.kind, number
        self.disturbances.append(injection)
        return "disturbance", number

    def end(self, number: int, tick: int) -> None:
        """Let one of the active ones end at this tick, or never begin."""
        injection = self._all[number]
        if isinstance(injection, Timed):
            self.faults.end(injection, tick)
        else:
            k = next(k for k, d in enumerate(self.disturbances) if d is injection)
            if tick <= injection.start:
                del self.disturbances[k]
            else:
                self.disturbances[k] = self._all[number] = injection._replace(end=tick)
        self._finished.add(number)

    def active(self, tick: int) -> list[ActiveFault]:
        """Return what disturbs or breaks at this tick, or will."""
        return [
            ActiveFault(number, _words(e), int(e.start), int(e.end) if e.end < inf else None)
            for number, e in enumerate(self._all)
            if e.end > tick and number not in self._finished
        ]

    def begin(self, tick: int, demand: Vector, effort: Vector) -> None:
        """Start and end the faults of this tick, and record events of it; see Faults.begin."""
        for timed, on in self.faults.begin(tick, demand, effort):
            end = int(timed.end) if timed.end < inf else None
            self._report(FaultChanged(on, plain(timed.fault), timed.start, end))

    def disturbance(self, tick: int) -> Vector:
        """Return the disturbance effort over this tick, and record events of its start and end."""
        total = self._zero
        for timed in self.disturbances:
            if timed.start <= tick < timed.end:
                total = total + disturbance_effort(timed, tick, self._names.joints, self._period)
            if tick in (timed.start, timed.end):
                self._report(DisturbanceChanged(_plain_shapes(timed), tick == timed.start))
        return read_only(total)


def _plain_shapes(timed: TimedDisturbance) -> dict[str, Any]:
    return {
        name: shape if isinstance(shape, float) else plain(shape)
        for name, shape in timed.shapes.items()
    }


def _words(injection: Injection) -> str:
    """Return a fault or a disturbance as one line of YAML."""
    if isinstance(injection, Timed):
        return yaml_text(plain(injection.fault), flow=True).strip()
    return yaml_text({"disturbance": _plain_shapes(injection)}, flow=True).strip()
