"""The testbed of a trial with its motors and sensors as C code: ticks, and equations of motion."""

from collections.abc import Callable
from contextlib import suppress
from dataclasses import fields, replace
from functools import partial
from typing import Any

import numpy as np

from flexslew_lab.export.c_code.evaluator import Evaluator
from flexslew_lab.export.c_code.numpy_functions import METHODS, REPLACEMENTS
from flexslew_lab.export.c_code.phases import Phases
from flexslew_lab.export.c_code.plant_tick import PlantTick
from flexslew_lab.export.c_code.printer import Function, Interface, Signal, sources
from flexslew_lab.export.c_code.program import Block, CLine, live_names
from flexslew_lab.export.c_code.statements import LANGUAGE
from flexslew_lab.export.c_code.tangent import tangent
from flexslew_lab.export.c_code.values import Array, Scalar, Unsupported
from flexslew_lab.export.c_module import (
    EFFORT,
    CModule,
    Continuous,
    State,
    c_name,
    measurement_signals,
    phases_of,
)
from flexslew_lab.export.plant_parameters import ModelNumbers, model_numbers
from flexslew_lab.trial.trial import Trial, bench_settings
from flexslew_plant.bench.retarget import with_schedule
from flexslew_plant.errors import BadInput
from flexslew_plant.hardware.sensors import Readings, exact_readings
from flexslew_plant.measurement import Measurement

_NOISES = {
    "noise", "across", "about", "rate_noise", "dropout", "angle_random_walk", "rate_random_walk",
    "bias_spread",
}  # keys of sensors that draw random numbers  # fmt: skip
_STRUCTS = ("effort", "measurement")
_INPUT, _OUTPUT = "const NAME_effort *input", "NAME_measurement *output"
_STATE = "plant_tick_x"  # the member of the memory


def noise_free(trial: Trial) -> Trial:
    """Return a trial with sensors that have no noise, but their biases, quanta, delays and gaps.

    A program without a generator of random numbers repeats itself.
    """
    testbed, sensors = trial.testbed, trial.sensors
    quiet = {one.name: _without_noise(getattr(sensors, one.name)) for one in fields(sensors)}
    if own := getattr(testbed, "sensors", {}):
        exact = {name: _without_noise(one) for name, one in own.items()}
        testbed = replace(testbed, sensors=exact)  # type: ignore[type-var]
    return replace(trial, testbed=testbed, sensors=replace(sensors, **quiet))


def _without_noise(sensor: Any) -> Any:
    names = _NOISES & {one.name for one in fields(sensor)}
    return replace(sensor, **dict.fromkeys(names, 0.0))


def plant_module(trial: Trial, single: bool = False, source: str = "") -> CModule:
    """Return the testbed of a trial, its motors and sensors, as C code.

    A step takes the efforts of a tick and gives the measurement at its end; that of tick 0 is the
    start of the outputs. Further functions are of the equations of motion, with the efforts of an
    input as they act on the testbed: without the limits and lags of motors and wheels.

    NAME_derivatives(memory, x, input, dx): the derivative of a state x.
    NAME_outputs(memory, x, input, output): what sensors without errors read at a state x.
    NAME_measure(memory, input, output): what the sensors read at the state of the memory.
    NAME_derivatives_along and NAME_outputs_along write the same, and its exact derivative along a
    direction x_d, input_d; they are left out where a function has no derivative.

    Args:
        trial: the trial.
        single: float in place of double.
        source: the trial's file, for messages.

    Raises:
        BadInput: it cannot be written out.
    """
    settings = bench_settings(noise_free(trial))
    tick = PlantTick(settings)
    model, start = tick.model, tick.readings(np.zeros(tick.model.joints), 0.0)
    joints = model.joints
    inputs = (
        Signal("time", "s", 1, (0.0,)),
        Signal("effort", f"{EFFORT}, demanded of the motors", joints, (0.0,) * joints),
        Signal("disturbance", f"{EFFORT}, beside the motors", joints, (0.0,) * joints),
    )
    measured = measurement_signals(joints, len(model.appendages.tip))
    values = dict(zip(Readings._fields, start, strict=True))
    outputs = tuple(
        one._replace(start=tuple(values[one.name].tolist())) if one.name in values else one
        for one in measured
        if one.name != "active"
    )
    time, effort, disturbance = _inputs(joints)

    numbers = model_numbers(settings.testbed, lambda one: with_schedule(one, settings.schedule))

    def make(numbers: ModelNumbers | None) -> tuple[Evaluator, Callable[[int], None]]:
        e, plant = Evaluator(LANGUAGE, REPLACEMENTS, METHODS), PlantTick(settings)
        e.keep(plant, "x")
        e.keep(plant, "motors")  # so the first tick is as all others
        e.keep(plant, "instruments")
        e.keep(plant, "seen")
        if numbers is not None:
            e.keep(plant.model, "packed", numbers.constants)

        def step(_: int) -> None:
            readings, applied = e.call(plant.step, [time, effort, disturbance])
            after = e.ops.binary("+", time, trial.period)
            _write(e, outputs, after, readings, applied)

        return e, step

    kind = trial.testbed.kind
    phases, parameters, derived = None, numbers.signals, list[Any]()
    if parameters:
        with suppress(BadInput):  # equations that choose by these numbers
            phases = phases_of(partial(make, numbers), kind, source, "testbed")
            derived = phases.function(numbers.write)
    if phases is None:
        phases, parameters = phases_of(partial(make, None), kind, source, "testbed"), ()
    name = c_name(f"{trial.name}_plant")
    about = f"testbed of the trial {trial.name}, written by flexslew: {kind}"
    structs = (_STRUCTS[0], inputs), (_STRUCTS[1], outputs)
    what = Interface(name, about, *structs, trial.period, single, parameters)
    functions = _functions(phases, outputs)
    text = sources(what, phases, functions, derived)
    continuous = _continuous(tick, {one.name: one for one in functions}, outputs)
    return CModule(
        name, text, inputs, outputs, parameters, trial.period, _STRUCTS, continuous, tunable=False
    )


def _inputs(joints: int) -> tuple[Scalar, Array, Array]:
    """Return the members of the struct of the inputs: time, efforts and disturbances."""
    effort, disturbance = (
        Array(f"input->{name}", (joints,), (1,)) for name in ("effort", "disturbance")
    )
    return Scalar("input->time", atom=True), effort, disturbance


def _write(
    e: Evaluator, outputs: tuple[Signal, ...], time: Scalar, readings: Readings, applied: Any
) -> None:
    """Write the members of the struct of the outputs, of which the time is the first."""
    e.ops.block.append(CLine(f"output->time = {time.text};", "output->time", time.text))
    found = dict(zip(Measurement._fields[4:], (*readings, applied), strict=True))
    for one in outputs[1:]:
        e.ops.write(Array(f"output->{one.name}", (one.size,), (1,)), found[one.name])


def _functions(phases: Phases, outputs: tuple[Signal, ...]) -> list[Function]:
    """Return the functions of the equations of motion; see plant_module."""
    plant = next(one for one in phases.evaluator.objects.values() if isinstance(one, PlantTick))
    model, states = plant.model, plant.x.size
    time, effort, disturbance = _inputs(model.joints)
    x = Array("x", (states,), (1,))

    def derivatives(e: Evaluator) -> None:
        total = e.ops.binary("+", effort, disturbance)
        slope = e.call(model.derivative, [x, e.ops.materialised(total), time])
        e.ops.write(Array("dx", (states,), (1,)), slope)

    def read(e: Evaluator) -> None:
        total = e.ops.materialised(e.ops.binary("+", effort, disturbance))
        _write(e, outputs, time, e.call(exact_readings, [model, x, total, time]), effort)

    def measure(e: Evaluator) -> None:
        total = e.ops.materialised(e.ops.binary("+", effort, disturbance))
        _write(e, outputs, time, e.call(plant.readings, [total, time]), effort)

    written = tuple(f"output->{one.name}" for one in outputs)
    about = f"of the state x = [q, v], {states} numbers, with the efforts held"
    slopes, readings = phases.function(derivatives), phases.function(read)
    varied, along = ("const REAL *x", _INPUT), ("const REAL *x_d", f"{_INPUT}_d")
    functions = [
        Function("derivatives", f"Write the derivative {about}.", (*varied, "REAL *dx"), slopes,
                 ("dx",)),
        Function("outputs", "Write what sensors without errors read at a state x.",
                 (*varied, _OUTPUT), readings, written),
        Function("measure", "Write what the sensors read at the state of the memory.",
                 (_INPUT, _OUTPUT), phases.function(measure), written),
    ]  # fmt: skip
    try:
        return [
            *functions,
            Function("derivatives_along", "Write dx, and its derivative along x_d and input_d.",
                     (*varied, *along, "REAL *dx", "REAL *dx_d"),
                     tangent(slopes, {"x", "input", "dx"}), ("dx", "dx_d")),
            Function("outputs_along", "Write output, and its derivative along x_d and input_d.",
                     (*varied, *along, _OUTPUT, f"{_OUTPUT}_d"),
                     tangent(readings, {"x", "input", "output"}), (*written, "output_d")),
        ]  # fmt: skip
    except Unsupported:  # without directional derivatives it is of use, too
        return functions


def _continuous(
    tick: PlantTick, functions: dict[str, Function], outputs: tuple[Signal, ...]
) -> Continuous | None:
    """Return the states; None: something else than the equations of motion acts on them."""
    model = tick.model
    next_jump = model.kernels.functions.get("next_jump")
    jumps = next_jump is not None and np.isfinite(next_jump(model.packed, -tick.period))
    if model.outside is not None or jumps:
        return None
    q, v = model.state_columns
    rates = {"rad": "rad/s", "m": "m/s", "rad/s": "rad/s^2", "m/s": "m/s^2"}
    named = [("q", one) for one in q] + [("v", one) for one in v]
    return Continuous(
        _STATE,
        tuple(
            State(f"{part}.{one.name}", one.unit, rates.get(one.unit, "1/s"), float(start))
            for (part, one), start in zip(named, tick.x, strict=True)
        ),
        "derivatives_along" in functions,
        {one.name: _reads(functions["outputs"].block, one.name) for one in outputs},
    )


def _reads(block: Block, output: str) -> frozenset[str]:
    """Return on which of the inputs and "x" an output depends."""
    names = live_names([block], {f"output->{output}"})
    known = {"x": "x", **{f"input->{one}": one for one in ("time", "effort", "disturbance")}}
    return frozenset(known[name] for name in names & known.keys())
