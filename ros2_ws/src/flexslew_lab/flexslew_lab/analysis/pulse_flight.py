"""The linear response of the non-linear bench to a pulse, from two flights."""

from dataclasses import replace
from typing import Any

import numpy as np

from flexslew_control.analysis.numeric_state import copied
from flexslew_lab.analysis.analysis import Analysis
from flexslew_lab.trial.trial import Trial, bench_settings
from flexslew_plant.arrays import Matrix, Vector
from flexslew_plant.bench.bench import Bench, BenchSettings
from flexslew_plant.bench.measurement import EffortCommand
from flexslew_plant.bench.schedule import ScheduleEntry
from flexslew_plant.errors import BadInput
from flexslew_plant.faults.actuators import ActuatorGain, CommandDelay
from flexslew_plant.testbeds import varied

_SHARE = 2e-4  # of the effort limits, during the pulse


def require_flyable(analysis: Analysis) -> None:
    """Check that the loop can be flown as it was analysed.

    Raises:
        BadInput: the plant changes with time, which the analysis takes as standing still.
    """
    if analysis.point.rest.model.time_varying:
        raise BadInput(
            "--prove: this plant changes with time, the margins are those of one moment; "
            "allowed: a testbed that does not turn by itself"
        )


def pulse_response(
    trial: Trial, analysis: Analysis, ticks: int, gain: Vector, delay: Vector
) -> Matrix:
    """Return what the joints' sensors and the tips read, as the linear response to a pulse.

    Half the difference of two flights after a small push of one tick, of either sign, in which
    every even power of the motion cancels and odd ones from the third on are below rounding.

    Args:
        trial: what flies, without its plan, its schedule and its sensors' errors.
        analysis: of that trial: where it rests, and a controller that has rested there.
        ticks: how many after the pulse.
        gain: on each motor, a fault `actuator_gain`, shape (efforts,).
        delay: before each motor, a fault `command_delay`, shape (efforts,) [ticks].

    Returns:
        readings, shape (ticks, sensors).
    """
    first, second = (_readings(trial, analysis, ticks, gain, delay, sign) for sign in (1.0, -1.0))
    return 0.5 * (first - second)


def _readings(
    trial: Trial, analysis: Analysis, ticks: int, gain: Vector, delay: Vector, sign: float
) -> Matrix:
    bench = Bench(_settings(trial, analysis, gain, delay, sign))
    controller, shift = copied(analysis.running.rested), analysis.running.ticks
    rows = []
    for _ in range(ticks + 1):
        asked = bench.question
        answer = controller.observe(asked._replace(tick=asked.tick + shift, epoch=0))
        if answer is None:
            raise BadInput(f"{controller.name} gives no answer in flight: {controller.reason}")
        bench.offer(EffortCommand(asked.tick, asked.epoch, asked.controller, answer.command.effort))
        bench.advance()
        seen = bench.question
        rows.append(np.concatenate((seen.joint_position, seen.joint_velocity, seen.tip_deflection)))
        if bench.failure:
            raise BadInput(f"the flight that proves a margin was lost: {bench.failure}")
    return np.array(rows[1:])


def _settings(
    trial: Trial, analysis: Analysis, gain: Vector, delay: Vector, sign: float
) -> BenchSettings:
    """Return a bench that rests where the loop was analysed, with faults and a pulse."""
    rest, period = analysis.point.rest, trial.period
    names = rest.model.joint_names
    position = rest.model.joint_state(rest.state)[0]
    joints = dict(zip(names, position.tolist(), strict=True))
    testbed = varied(trial.testbed, {"initial": joints}, "--prove")
    push = dict(
        zip(names, (sign * _SHARE * np.asarray(testbed.effort_limit)).tolist(), strict=True)
    )
    pulse = ScheduleEntry(at=0.0, until=period, disturbance=push)
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
    return replace(
        plain,
        testbed=testbed,
        duration=0.0,
        active=analysis.controller,
        fallback=(),
        plausibility=None,
        allow_faults=True,
        schedule=(pulse, *(ScheduleEntry(at=0.0, fault=fault) for fault in faults)),
    )
