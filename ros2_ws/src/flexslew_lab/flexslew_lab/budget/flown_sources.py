"""Error sources that are not linear: differences of two flights of the non-linear bench."""

from collections.abc import Iterator
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np

from flexslew_control.plan import Plan
from flexslew_lab.budget.contribution import Contribution, drawn, fixed, summed
from flexslew_lab.budget.error_free import ErrorFlight, error_free, simulate, without_faults
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


def reference_flight(at: ObservedLoop, source: str, plan: Plan | None) -> ErrorFreeFlight:
    """Return the flight of a trial without error sources: what is left is that of the slew.

    Raises:
        BadInput: see simulate.
    """
    bench = without_faults(error_free(at.trial))
    return ErrorFreeFlight(at, source, plan, simulate(at.trial, bench, source, plan, at.loop))


def slew_source(of: ErrorFreeFlight) -> Contribution:
    """Return the error that the slew leaves: residual vibration and settling of the laws."""
    parts = fixed(of.at.metrics(of.flight.error))
    return Contribution("slew", "slew", "flight without error sources", parts)


def friction_source(of: ErrorFreeFlight) -> Iterator[Contribution]:
    """Yield the dry friction of the motors."""
    trial = of.at.trial
    dry: Any = trial.actuator.coulomb_friction
    if any(dry.values()) if isinstance(dry, dict) else dry:
        bench = without_faults(error_free(trial))
        rough = replace(bench, actuator=replace(bench.actuator, coulomb_friction=dry))
        parts = fixed(of.at.metrics(of.difference(rough)))
        yield Contribution("actuator.coulomb_friction", "friction", DIFFERENCE, parts)


def fault_sources(of: ErrorFreeFlight) -> Iterator[Contribution]:
    """Yield each fault of the schedule; that of a command's delay is among them."""
    trial = of.at.trial
    for number, entry in enumerate(trial.schedule):
        if entry.fault is None:
            continue
        bench = without_faults(error_free(trial))
        order = [e for e in error_free(trial).schedule if e.fault is None or e is entry]
        parts = fixed(of.at.metrics(of.difference(replace(bench, schedule=tuple(order)))))
        kind = "delay" if isinstance(entry.fault, CommandDelay) else "fault"
        name = f"schedule.{number}.fault.{entry.fault.kind}"
        yield Contribution(name, kind, DIFFERENCE, parts)


def gyro_bias_sources(of: ErrorFreeFlight) -> Iterator[Contribution]:
    """Yield biases of gyros: a fixed one, and one that each member draws, axis by axis."""
    bench = without_faults(error_free(of.at.trial))

    def errors(name: str, bias: Vector) -> dict[str, Matrix]:
        sensors = {"sensors": {name: {"bias": bias.tolist()}}}
        testbed = with_changes(bench.testbed, sensors, "budget")
        return of.at.metrics(of.difference(replace(bench, testbed=testbed)))

    for one in of.at.loop.point.rest.model.appendages.instruments:
        if not isinstance(one, Gyro):
            continue
        s, place = one.settings, f"testbed.sensors.{one.name}"
        if any(s.bias):
            parts = fixed(errors(one.name, np.array(s.bias)))
            yield Contribution(f"{place}.bias", "bias", DIFFERENCE, parts)
        if s.bias_spread:
            each = [drawn(errors(one.name, row)) for row in s.bias_spread * np.eye(3)]
            spread = {name: summed([parts[name] for parts in each]) for name in each[0]}
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
    point, trial = of.at.loop.point, without_faults(error_free(of.at.trial))
    base = situation_at(trial, point)
    for one in uncertain_parameters(base, vary):
        low, high = (of.difference(_with(base, one, end)) for end in (one.low, one.high))
        parts = drawn(of.at.metrics((high - low) / np.sqrt(12.0)))
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
