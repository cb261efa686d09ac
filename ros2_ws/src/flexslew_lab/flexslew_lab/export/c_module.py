"""The controller of a trial as C code, made from its own steps."""

import re
from collections.abc import Callable
from typing import Any, NamedTuple, TypeAlias

import numpy as np

from flexslew_control.controllers.controller import Controller
from flexslew_control.controllers.user_law import UserLaw
from flexslew_control.plan import Plan
from flexslew_lab.export.c_code.controller_tick import ControllerTick
from flexslew_lab.export.c_code.evaluator import Evaluator
from flexslew_lab.export.c_code.numpy_functions import METHODS, REPLACEMENTS
from flexslew_lab.export.c_code.phases import Phases
from flexslew_lab.export.c_code.printer import Interface, Signal, sources
from flexslew_lab.export.c_code.statements import LANGUAGE
from flexslew_lab.export.c_code.values import Array, Scalar, Tick, Unsupported
from flexslew_lab.export.gains import gains_of
from flexslew_lab.trial.trial import Trial, law_of
from flexslew_plant.errors import BadInput
from flexslew_plant.measurement import Measurement

Make: TypeAlias = Callable[[], tuple[Evaluator, Callable[[int], None]]]
EFFORT = "N m or N"


class State(NamedTuple):
    """A continuous state of a plant."""

    name: str
    unit: str
    rate_unit: str  # of its derivative
    start: float


class Continuous(NamedTuple):
    """The equations of motion of a plant in its module; see plant_module for their functions."""

    member: str  # of the memory, an array of the states
    states: tuple[State, ...]
    directional: bool  # whether it has their derivatives along a direction
    depends: dict[str, frozenset[str]]  # on which of inputs and "x" each output depends


class CModule(NamedTuple):
    """A C module: a memory, and the functions NAME_init and NAME_step."""

    name: str  # prefix of every C name, such as m1_controller
    sources: dict[str, str]  # text by file name: NAME.c and NAME.h
    inputs: tuple[Signal, ...]  # members of NAME_measurement, or NAME_effort of a plant
    outputs: tuple[Signal, ...]  # those of the other struct
    parameters: tuple[Signal, ...]  # members of NAME_parameters
    period: float  # one tick [s]
    structs: tuple[str, str] = ("measurement", "command")  # of the inputs and the outputs
    continuous: Continuous | None = None  # None: it has ticks alone
    tunable: bool = True  # whether the parameters may change at any tick, or before the first


def module_of(
    trial: Trial,
    controller: Controller,
    plan: Plan | None,
    single: bool = False,
    source: str = "",
) -> CModule:
    """Return a controller, as built, that follows a plan, as C code.

    Args:
        trial: of the controller.
        controller: of that trial.
        plan: that it follows, or None.
        single: float in place of double.
        source: the trial's file, for messages.

    Raises:
        BadInput: if it refuses the plan, or cannot be written out.
    """
    if plan is not None and (refused := controller.adopt(plan)):
        raise BadInput(refused.why, source, f"controllers.{controller.name}")
    law, _ = law_of(controller.name, trial.controllers[controller.name] or {})
    key = f"controllers.{controller.name}"
    if isinstance(controller.law, UserLaw):
        words = f"{law} cannot be written out: it is Python of your own; fly it as a process"
        raise BadInput(words, source, key)
    model = trial.testbed.model()
    joints, tips = len(controller.joint_names), len(model.appendages.tip)
    inputs, outputs = measurement_signals(joints, tips), (Signal("effort", EFFORT, joints, ()),)

    warmed = controller.warmed(len(model.appendages.names))  # what it keeps from then on is there
    gains = gains_of(warmed)
    parameters = tuple(one.signal for one in gains)

    def make() -> tuple[Evaluator, Callable[[int], None]]:
        e, tick = Evaluator(LANGUAGE, REPLACEMENTS, METHODS), ControllerTick(warmed)
        for gain in gains:
            e.read_parameter(gain.owner, gain.signal.name, gain.shape)

        def step(phase: int) -> None:
            sizes = joints, joints, tips, tips, joints
            given: list[Any] = [
                Array(f"input->{name}", (size,), (1,))
                for name, size in zip(Measurement._fields[4:], sizes, strict=True)
            ]
            k: Any = Tick(0, phase)
            time: Any = Scalar("input->time", atom=True)
            seen = Measurement(k, 0, time, controller.name, *given)
            effort = e.call(tick.step, [seen, Scalar("(input->active[0] > 0.5)", "b")])
            e.ops.write(Array("output->effort", (joints,), (1,)), effort)

        return e, step

    phases = phases_of(make, law, source, key)
    name = c_name(f"{trial.name}_{controller.name}")
    about = f"{controller.name} of the trial {trial.name}, written by flexslew: {law}"
    structs = ("measurement", inputs), ("command", outputs)
    what = Interface(name, about, *structs, trial.period, single, parameters)
    return CModule(name, sources(what, phases), inputs, outputs, parameters, trial.period)


def phases_of(make: Make, what: str, source: str, key: str) -> Phases:
    """Return the phases of a step.

    Raises:
        BadInput: it has what cannot be written out.
    """
    evaluators = list[Evaluator]()

    def make_and_keep() -> tuple[Evaluator, Callable[[int], None]]:
        made = make()
        evaluators.append(made[0])
        return made

    try:
        return Phases(make_and_keep)
    except Unsupported as error:
        place = next(reversed(evaluators[-1].place), "step")
        words = f"{what} cannot be written out: {place} has {error}; fly it as a process"
        raise BadInput(words, source, key) from None


def c_name(words: str) -> str:
    """Return a name that C allows."""
    name = re.sub(r"\W", "_", words)
    return name if name[0].isalpha() else f"flexslew_{name}"


def measurement_signals(joints: int, tips: int) -> tuple[Signal, ...]:
    """Return the members of a measurement, in the order of measurement.Measurement."""

    def zeros(size: int) -> tuple[float, ...]:
        return tuple(np.zeros(size))

    signals = (
        Signal("time", "s", 1, (0.0,)),
        Signal("active", "1: it commands; 0: another controller does", 1, (1.0,)),
        Signal("joint_position", "rad or m", joints, zeros(joints)),
        Signal("joint_velocity", "rad/s or m/s", joints, zeros(joints)),
        Signal("tip_deflection", "m, or of an instrument's channel", tips, zeros(tips)),
        Signal("root_curvature", "1/m", tips, zeros(tips)),
        Signal("applied_effort", "N m or N, of the last tick", joints, zeros(joints)),
    )
    return tuple(signal for signal in signals if signal.size)


__all__ = ["CModule", "Continuous", "Signal", "State", "module_of"]
