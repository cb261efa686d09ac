"""Quanta of sensors and motors: a white noise where other noises cross them, else a flight.

An error of rounding is uniform and white, of variance q^2 / 12, where the value before it has a
noise of a standard deviation of half a quantum or more (B. Widrow and I. Kollar, Quantization
noise, 2008). With less noise it is a constant or a limit cycle, which a flight with the quantum
alone shows.
"""

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace

import numpy as np

from flexslew_control.analysis.signals import CHANNELS
from flexslew_lab.budget.closed_loop import ErrorInputs
from flexslew_lab.budget.contribution import Contribution
from flexslew_lab.budget.flown_sources import ErrorFreeFlight
from flexslew_lab.budget.sources import ObservedLoop, channel_signals
from flexslew_lab.trial.trial import Trial
from flexslew_plant.arrays import Vector
from flexslew_plant.hardware.sensors import Channel, Readings
from flexslew_plant.settings import plain
from flexslew_plant.testbeds import with_changes

DITHER = 0.5  # standard deviation of a noise that makes rounding white, of a quantum
_WHITE = "quantum^2 / 12, white, as the noise before it crosses quanta; by the linear loop"


@dataclass(frozen=True)
class Quantum:
    """Roundings of one kind.

    Args:
        name: of the source.
        inputs: errors of one standard deviation each.
        is_white: whether each value before it has a sufficient noise.
        bench: from an error-free bench to one with this alone.
    """

    name: str
    inputs: ErrorInputs
    is_white: bool
    bench: Callable[[Trial], Trial]


def white_quanta(at: ObservedLoop) -> Iterator[Contribution]:
    """Yield the quanta that are white noises."""
    for one in _quanta(at):
        if one.is_white:
            yield at.noise(one.name, "quantisation", _WHITE, one.inputs)


def flown_quanta(of: ErrorFreeFlight) -> Iterator[Contribution]:
    """Yield the other quanta."""
    for one in _quanta(of.at):
        if not one.is_white:
            yield of.with_source(one.name, "quantisation", one.bench(of.bench))


def _quanta(at: ObservedLoop) -> Iterator[Quantum]:
    for key, word in zip(Readings._fields, CHANNELS, strict=True):
        errors = getattr(at.trial.sensors, key)
        if quantum := errors.quantisation:
            inputs = at.loop.signal_inputs(channel_signals(at, key, word))
            white = errors.noise >= DITHER * quantum
            size = quantum / np.sqrt(12.0) * np.ones(inputs.columns.shape[1])
            yield Quantum(
                f"sensors.{key}.quantisation", inputs.times(size), white, _sensor(key, quantum)
            )
    single = at.loop.point.rest.model.appendages.errors
    if single is not None and single[2].any():
        tips = at.loop.signal_inputs(channel_signals(at, "tip_deflection", "tip"))
        white = bool((single[0] >= DITHER * single[2]).all())
        inputs = tips.times(single[2] / np.sqrt(12.0))
        yield Quantum("testbed.sensors.quantisation", inputs, white, _tips(at.trial))
    if quantum := at.trial.actuator.quantisation:
        size = quantum / np.sqrt(12.0) * np.ones(at.loop.loop.efforts)
        inputs = at.loop.command_inputs().times(size)
        white = bool((_demand_noise(at) >= DITHER * quantum).all())
        yield Quantum("actuator.quantisation", inputs, white, _motors(quantum))


def _demand_noise(at: ObservedLoop) -> Vector:
    """Return the standard deviation of demands by the noise of this tick's readings alone."""
    closed, efforts = at.loop.loop.closed, at.loop.loop.efforts
    variance = np.zeros(efforts)
    for key, word in zip(Readings._fields, CHANNELS, strict=True):
        noise = getattr(at.trial.sensors, key).noise
        for name in channel_signals(at, key, word):
            if name in closed.inputs:
                variance += (closed.d[:efforts, closed.inputs.index(name)] * noise) ** 2
    return np.sqrt(variance)


def _sensor(key: str, quantum: float) -> Callable[[Trial], Trial]:
    channel = Channel(quantisation=quantum)
    return lambda bench: replace(bench, sensors=replace(bench.sensors, **{key: channel}))


def _motors(quantum: float) -> Callable[[Trial], Trial]:
    return lambda bench: replace(bench, actuator=replace(bench.actuator, quantisation=quantum))


def _tips(trial: Trial) -> Callable[[Trial], Trial]:
    sensors = plain(trial.testbed).get("sensors") or {}
    quanta = {
        name: {"quantisation": keys["quantisation"]}
        for name, keys in sensors.items()
        if keys.get("quantisation")
    }
    return lambda bench: replace(
        bench, testbed=with_changes(bench.testbed, {"sensors": quanta}, "budget")
    )
