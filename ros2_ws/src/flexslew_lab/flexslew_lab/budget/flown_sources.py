"""Error sources that are not linear: differences of two flights of the non-linear bench."""

from collections.abc import Iterator
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np

from flexslew_control.plan import Plan
from flexslew_lab.budget.contribution import Contribution, drawn_parts, sum_parts
from flexslew_lab.budget.error_free import ErrorFlight, error_free, simulate
from flexslew_lab.budget.sources import ObservedLoop
from flexslew_lab.guarantee.model.parameters import Uncertain, Vary, uncertain_parameters
from flexslew_lab.guarantee.model.situation import Situation, situation_at
from flexslew_lab.trial.trial import Trial
from flexslew_plant.arrays import Matrix, Vector
from flexslew_plant.bench.schedule import ScheduleEntry
from flexslew_plant.faults.actuators import ActuatorGain, CommandDelay
from flexslew_plant.testbeds import with_changes
from flexslew_plant.testbeds.instruments import Gyro

DIFFERENCE = "flight with it less the flight without error sources"


class ErrorFreeFlight(NamedTuple):
    """The flight without error sources, and how to fly others.

    Args:
        at: the trial, its loop and its windows.
        source: file of the trial, for an error.
        plan: that is flown.
        flight: without error sources.
    """

    at: ObservedLoop
    source: str
    plan: Plan | None
    flight: ErrorFlight

    def difference(self, other: Trial) -> Matrix:
        """Return what a bench adds to the errors of the flight, shape (ticks, outputs)."""
        flight = simulate(self.at.trial, other, self.source, self.plan, self.at.loop)
        return np.asarray(flight.error - self.flight.error)

    def with_source(self, name: str, kind: str, other: Trial) -> Contribution:
        """Return the part of what a bench adds to the errors of the flight."""
        return self.at.error(name, kind, DIFFERENCE, self.difference(other))

    @property
    def bench(self) -> Trial:
        """The bench that flew."""
        return error_free(self.at.trial)


def reference_flight(at: ObservedLoop, source: str, plan: Plan | None) -> ErrorFreeFlight:
    """Return the flight of a trial without error sources: what is left is that of the slew.

    Raises:
        BadInput: see simulate.
    """
    flight = simulate(at.trial, error_free(at.trial), source, plan, at.loop)
    return ErrorFreeFlight(at, source, plan, flight)


def slew_source(of: ErrorFreeFlight) -> Contribution:
    """Return the error that the slew leaves: residual vibration and settling of the laws."""
    return of.at.error("slew", "slew", "flight without error sources", of.flight.error)


def friction_source(of: ErrorFreeFlight) -> Iterator[Contribution]:
    """Yield the dry friction of the motors."""
    dry: Any = of.at.trial.actuator.coulomb_friction
    if any(dry.values()) if isinstance(dry, dict) else dry:
        motors = replace(of.bench.actuator, coulomb_friction=dry)
        rough = replace(of.bench, actuator=motors)
        yield of.with_source("actuator.coulomb_friction", "friction", rough)


def fault_sources(of: ErrorFreeFlight) -> Iterator[Contribution]:
    """Yield each fault of the schedule; that of a command's delay is among them."""
    trial, quiet = of.at.trial, of.bench.schedule
    for number, entry in enumerate(trial.schedule):
        if entry.fault is None:
            continue
        order = (e for e in trial.schedule if e is entry or e in quiet)
        kind = "delay" if isinstance(entry.fault, CommandDelay) else "fault"
        name = f"schedule.{number}.fault.{entry.fault.kind}"
        yield of.with_source(name, kind, replace(of.bench, schedule=tuple(order)))


def gyro_bias_sources(of: ErrorFreeFlight) -> Iterator[Contribution]:
    """Yield biases of gyros: a fixed one, and one that each member draws, axis by axis."""

    def biased(name: str, bias: Vector) -> Trial:
        sensors = {"sensors": {name: {"bias": bias.tolist()}}}
        return replace(of.bench, testbed=with_changes(of.bench.testbed, sensors, "budget"))

    for one in of.at.loop.point.rest.model.appendages.instruments:
        if not isinstance(one, Gyro):
            continue
        s, place = one.settings, f"testbed.sensors.{one.name}"
        if any(s.bias):
            yield of.with_source(f"{place}.bias", "bias", biased(one.name, np.array(s.bias)))
        if s.bias_spread:
            benches = [biased(one.name, row) for row in s.bias_spread * np.eye(3)]
            each = [drawn_parts(of.at.metrics(of.difference(bench))) for bench in benches]
            spread = {name: sum_parts([parts[name] for parts in each]) for name in each[0]}
            words = f"drawn once per member; {DIFFERENCE}, axis by axis"
            yield Contribution(f"{place}.bias_spread", "bias", words, spread)


def model_sources(of: ErrorFreeFlight, vary: Vary) -> Iterator[Contribution]:
    """Yield errors of the plant's model: each parameter uniform in its range, drawn per member.

    The error is taken as linear in the parameter, with the slope between flights at both ends; a
    uniform parameter has the standard deviation (high - low) / sqrt(12).

    Args:
        of: flight without error sources.
        vary: ranges by name, see uncertain_parameters.

    Raises:
        BadInput: if a name or a range is not understood, or a flight fails.
    """
    base = situation_at(of.bench, of.at.loop.point)
    for one in uncertain_parameters(base, vary):
        low, high = (of.difference(_with(base, one, end)) for end in (one.low, one.high))
        parts = drawn_parts(of.at.metrics((high - low) / np.sqrt(12.0)))
        words = f"uniform in {one.low:.4g} to {one.high:.4g}, slope between flights at the ends"
        yield Contribution(f"model.{one.name}", "model", words, parts)


def _with(base: Situation, one: Uncertain, value: float) -> Trial:
    """Return the trial of a plant with a value of an uncertain parameter."""
    there, names = base.changed({one.name: value}), base.rest.model.joint_names
    faults: list[Any] = []
    if one.name.startswith("gain"):
        assert there.path.gain is not None
        before = np.ones(len(names)) if base.path.gain is None else base.path.gain
        faults = [
            ActuatorGain(joint=name, gain=float(g))
            for name, g in zip(names, there.path.gain / before, strict=True)
        ]
    elif one.name == "delay" and value > 0.0:
        faults = [CommandDelay(ticks=value / base.trial.period)]
    entries = tuple(ScheduleEntry(at=0.0, fault=fault) for fault in faults)
    return replace(
        base.trial,
        testbed=there.testbed,
        actuator=replace(base.trial.actuator, lag=there.path.actuator.lag),
        schedule=(*base.trial.schedule, *entries),
        allow_faults=True,
    )
