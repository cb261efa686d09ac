"""One mode of a closed loop, flown by the non-linear bench: plant, motors and law start on it."""

from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np

from flexslew_control.analysis.linear_plant import PlantPath
from flexslew_control.analysis.loop import Complex, ControlLoop
from flexslew_lab.analysis.analysis import Analysis
from flexslew_lab.trial.trial import Trial, bench_settings
from flexslew_plant.arrays import Matrix, Vector
from flexslew_plant.bench.bench import Bench, BenchSettings
from flexslew_plant.bench.schedule import ScheduleEntry
from flexslew_plant.errors import BadInput
from flexslew_plant.faults.actuators import ActuatorGain, CommandDelay
from flexslew_plant.measurement import EffortCommand
from flexslew_plant.testbeds import Model, with_changes
from flexslew_plant.testbeds.instruments.instrument import channels

_EFFORT = 2e-4  # of the limits, at the start
_MOTION = 1e-4  # of joints and modes, and of their rates, at the start [rad or m, and per second]
_FRICTION_RATIO = (
    1e-3  # of `coulomb_speed`: of tanh the third power is below a millionth of the first
)
_EXACT = {"noise": 0.0, "bias": 0.0, "quantisation": 0.0}


def require_same_bench(trial: Trial, analysis: Analysis) -> None:
    """Check that the loop can be flown as it was analysed.

    Raises:
        BadInput: the trial has another bench, or the plant changes with time, which the analysis
            takes as standing still.
    """
    bench_model, loop_model = trial.testbed.model(), analysis.point.rest.model
    if _signals(bench_model) != _signals(loop_model):
        raise BadInput("--prove: the analysis is of another bench; analyse the trial that is flown")
    if loop_model.time_varying:
        raise BadInput(
            "--prove: this plant changes with time, the margins are those of one moment; "
            "allowed: a testbed that does not turn by itself"
        )


def _signals(model: Model) -> tuple[object, ...]:
    """Return what a bench is driven and read by, and in how many coordinates it moves."""
    return model.joint_names, model.appendages.names, model.sizes


def mode_response(
    trial: Trial, analysis: Analysis, loop: ControlLoop, path: PlantPath, mode: Complex, ticks: int
) -> Matrix:
    """Return the readings of joints and appendages while the bench moves in one mode.

    They are half the difference of two flights that start on the real part of the mode, of either
    sign: even powers of the motion cancel, odd ones from the third on are below rounding.

    Args:
        trial: what flies, without its plan, its schedule and its sensors' errors.
        analysis: analysis of that trial: its rest, and a controller that has rested there.
        loop: the predicted loop with the faults of the path.
        path: gains and delays that faults `actuator_gain` and `command_delay` add.
        mode: an eigenvector of the closed loop, shape (states,).
        ticks: number of ticks.

    Returns:
        readings, shape (ticks, sensors); the first is of the start. Without instruments: no law
        that can be analysed uses them, and they read late, or now and then.
    """
    parts = _Parts.of(mode, loop, analysis, path)
    commands = (loop.closed.c @ mode)[: loop.efforts]
    request = abs(np.vstack((commands, parts.queue, parts.motors))) / trial.testbed.effort_limit
    rates = abs(parts.motion[len(parts.motion) // 2 :]).max() / _slow(trial)
    size = max(abs(parts.motion).max() / _MOTION, rates, request.max() / _EFFORT)
    first, second = (
        _sensor_record(trial, analysis, path, _Parts.of(sign * mode.real / size, loop, analysis,
        path),
                  ticks)
        for sign in (1.0, -1.0)
    )  # fmt: skip
    return 0.5 * (first - second)


def _slow(trial: Trial) -> float:
    """Return the largest rate of a start at which dry friction still has its slope at rest."""
    dry = trial.actuator.coulomb_friction
    return _FRICTION_RATIO * trial.actuator.coulomb_speed if dry else np.inf


class _Parts(NamedTuple):
    """The parts of a state of the closed loop, in the order of sampled_plant and loop_of."""

    # commands on their way to motors, the last one first, zero where they no longer matter,
    # shape (k, efforts)
    queue: Any
    motors: Any  # torques of motors that lag, shape (efforts,)
    motion: Any  # displacements along v, and v, shape (2 n,)
    applied: Any  # effort of the last tick, shape (efforts,)
    law: Any  # what the controller remembers

    @classmethod
    def of(cls, state: Any, loop: ControlLoop, analysis: Analysis, path: PlantPath) -> "_Parts":
        """Return them."""
        m, n = loop.efforts, analysis.point.rest.model.coordinates
        kept = path.queue_lengths(m)
        sizes = [*kept, m * (path.actuator.lag > 0.0), 2 * n, m]
        *late, motors, motion, applied, law = np.split(state, np.cumsum(sizes))
        queue = np.zeros((kept.max(initial=0), m), dtype=state.dtype)
        for k, commands in enumerate(late):
            queue[: len(commands), k] = commands
        return cls(queue, motors if len(motors) else np.zeros(m), motion, applied, law)


def _sensor_record(
    trial: Trial, analysis: Analysis, path: PlantPath, start: _Parts, ticks: int
) -> Matrix:
    """Return what the sensors read from a start on, shape (ticks, sensors)."""
    rest, running = analysis.point.rest, analysis.running
    gain, delay = _faults(path, len(start.applied))
    bench = Bench(_settings(trial, analysis, gain, delay))
    bench.advance()
    for command in start.queue[::-1]:  # on their way when the bench is placed
        request = bench.question
        effort = rest.effort + command / gain
        bench.offer(EffortCommand(request.tick, request.epoch, request.controller, effort))
        bench.advance()
    n = rest.model.coordinates
    along = rest.model.position_rates(rest.q, rest.time)
    displacement = np.concatenate((along @ start.motion[:n], start.motion[n:]))
    bench.place(rest.state + displacement, rest.effort + start.applied, rest.effort + start.motors)
    controller, shift = running.perturb(start.law), running.ticks - bench.tick
    rows, linear = [], np.ones(len(rest.model.appendages.names), bool)
    for instrument in rest.model.appendages.instruments:
        linear[channels(instrument)] = False
    for _ in range(ticks):
        request = bench.question
        rows.append(
            np.concatenate(
                (request.joint_position, request.joint_velocity, request.tip_deflection[linear])
            )
        )
        answer = controller.observe(request._replace(tick=request.tick + shift, epoch=0))
        if answer is None:
            raise BadInput(f"{controller.name} gives no answer in flight: {controller.reason}")
        bench.offer(
            EffortCommand(request.tick, request.epoch, request.controller, answer.command.effort)
        )
        bench.advance()
        if bench.failure:
            raise BadInput(f"the flight that proves a margin was lost: {bench.failure}")
    return np.array(rows)


def _faults(path: PlantPath, efforts: int) -> tuple[Vector, Vector]:
    """Return gains [-] and delays [ticks] of a path."""
    return (
        np.ones(efforts) if path.gain is None else path.gain,
        np.zeros(efforts) if path.delay is None else path.delay,
    )


def _settings(trial: Trial, analysis: Analysis, gain: Vector, delay: Vector) -> BenchSettings:
    """Return a bench that rests where the loop was analysed, with faults."""
    rest = analysis.point.rest
    names = rest.model.joint_names
    faults: list[Any] = [
        ActuatorGain(joint=name, gain=float(g))
        for name, g in zip(names, gain, strict=True)
        if g != 1.0
    ]
    faults += [
        CommandDelay(joint=name, ticks=float(d))
        for name, d in zip(names, delay, strict=True)
        if d > 0.0
    ]
    plain = bench_settings(replace(trial, sensors=type(trial.sensors)()))
    sensors = getattr(trial.testbed, "sensors", {})  # on the appendages of a spacecraft
    exact = {name: _EXACT for name, sensor in sensors.items() if hasattr(sensor, "quantisation")}
    changes = {"initial": rest.joints, **({"sensors": exact} if exact else {})}
    return replace(
        plain,
        testbed=with_changes(trial.testbed, changes, "--prove"),
        duration=0.0,
        integration_steps=analysis.point.path.steps,
        active=analysis.controller,
        fallback=(),
        plausibility=None,
        allow_faults=True,
        schedule=tuple(ScheduleEntry(at=0.0, fault=fault) for fault in faults),
    )
