"""Plans made in a process of their own, so that a client can cancel at any moment."""

import math
import signal
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from multiprocessing import get_context
from multiprocessing.connection import Connection
from multiprocessing.context import SpawnProcess
from typing import Any, NamedTuple

import numpy as np

from flexslew_control.law import ActiveLaw, PlantDescription, plant_description
from flexslew_control.plan import Plan
from flexslew_control.plans.known_motion import KnownMotion
from flexslew_plant.errors import BadInput, PlanFailed
from flexslew_plant.joint_quantities import require_units_of_joints
from flexslew_plant.keys.units import number_in
from flexslew_plant.own_code import NO_CODE, Trust
from flexslew_plant.refusal import Cause, Refusal
from flexslew_plant.testbeds import at_rest, default_testbed, starts_in_motion, with_changes
from flexslew_plant.yaml_data import load_yaml

MOST_TICKS = 1_000_000  # of a manoeuvre


class StartOfPlan(NamedTuple):
    """The bench at the start of a plan, as far as it is known beforehand."""

    rest: Mapping[str, float] | None = None  # references by joint; None: those of the testbed
    law: ActiveLaw | None = None  # of the controller that is active then; None: not known

    def same(self, other: "StartOfPlan") -> bool:
        """Return whether a plan for the other one is a plan for this one."""
        return (self.rest, self.law) == (other.rest, other.law)


class PlanRequest(NamedTuple):
    """What a planner needs to know."""

    values: Any  # the `plan` section as plain data
    bench: str  # settings of what stands on the bench, YAML; empty: the default testbed
    period: float  # one tick of the bench [s]
    effort_limit: tuple[float, ...]  # of the drives, one per actuator [N m or N]
    start: float = 0.0  # of the plan [s]
    beginning: StartOfPlan = StartOfPlan()
    trust: Trust = NO_CODE  # which classes of the user's own may be loaded


class MotionRequest(NamedTuple):
    """What the prediction of a plan from a known motion requires."""

    plan: Plan  # predicted from rest
    course: Plan  # preceded by the references from the tick of the motion on
    motion: KnownMotion
    of: PlanRequest  # that the plan is made for


class Iteration(NamedTuple):
    """One iteration of a planner that iterates."""

    number: int
    objective: float
    norm_terminal_error: float
    norm_input: float


class PlanProcess:
    """A process that waits for requests.

    Args:
        soon: a request will come, so the process makes its imports now.
    """

    def __init__(self, soon: bool = True) -> None:
        self._process: SpawnProcess | None = None
        if soon:
            self._start()

    def ask(self, request: PlanRequest | MotionRequest) -> None:
        """Begin to plan, or to predict."""
        if self._process is None:
            self._start()
        self._pipe.send(request)

    def updates(self, wait: float = 0.0) -> list[Iteration | Plan | Refusal]:
        """Return what has come out since the last call; a plan or a refusal is the last word.

        Args:
            wait: for the first of it, at most [wall s].
        """
        found: list[Iteration | Plan | Refusal] = []
        if self._process is None:
            return found
        try:
            while self._pipe.poll(0.0 if found else wait):
                found.append(self._pipe.recv())
        except (EOFError, OSError):
            code = self._process.exitcode
            words = f"the planning process ended by itself (exit code {code})"
            found.append(Refusal(words, cause=Cause.NO_MANOEUVRE))
            self._start()
        return found

    def cancel(self) -> None:
        """Stop planning, wherever it is; the next request can come at once."""
        self.close()
        self._start()

    def close(self) -> None:
        """End the process."""
        if self._process is not None:
            self._process.kill()
            self._process.join()
            self._pipe.close()
            self._process = None

    def _start(self) -> None:
        # spawned: a copy of this process would take its threads' locks with it
        context = get_context("spawn")
        self._pipe, end = context.Pipe()
        self._process = context.Process(target=_work, args=(end,), daemon=True)
        self._process.start()
        end.close()


def plan_request(
    section: str | dict[str, Any],
    bench: str,
    period: float,
    effort_limit: Sequence[float],
    beginning: Callable[[float], StartOfPlan] = lambda start: StartOfPlan(),
    trust: Trust = NO_CODE,
) -> PlanRequest | Refusal:
    """Return a client's request, or why its numbers or its YAML cannot be used.

    Args:
        section: the `plan` section, YAML or plain data.
        bench: settings of what stands on the bench, YAML; empty: the default testbed.
        period: one tick of the bench [s].
        effort_limit: one per actuator [N m or N].
        beginning: returns the bench at a start [s]; a request without initial positions begins
            at its references.
        trust: the user's own classes that may be loaded.
    """
    if not (math.isfinite(period) and period > 0.0):
        return Refusal("a positive number of seconds", "period", period)
    limit = tuple(effort_limit)
    if not limit or not all(math.isfinite(value) and value > 0.0 for value in limit):
        return Refusal("one positive number per joint", "effort_limit", [*limit])
    try:
        values = load_yaml(section, "request") if isinstance(section, str) else section
        start = values.get("start", 0.0) if isinstance(values, dict) else 0.0
        begin = number_in(start, ("s",), "start")
        return PlanRequest(values, bench, period, limit, begin, beginning(begin), trust)
    except BadInput as error:
        return error.refusal


def _work(pipe: Connection) -> None:
    """Answer requests until the other process closes the pipe."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C is for the parent process
    from flexslew_control.planners import make_plan
    from flexslew_control.planners.residual.from_motion import predicted_from

    def progress(update: Any) -> None:
        pipe.send(Iteration(*(getattr(update, name) for name in Iteration._fields)))

    try:
        while True:
            request: PlanRequest | MotionRequest = pipe.recv()
            try:
                if isinstance(request, MotionRequest):
                    plan, course, motion, of = request
                    law = of.beginning.law
                    found = law and predicted_from(motion, plan, course, _plant(of), law)
                    pipe.send(found or plan)
                    continue
                settings, plant, gains = read_request(request)
                pipe.send(make_plan(settings, plant, gains, progress, request.beginning.law))
            except BadInput as error:
                pipe.send(Refusal(str(error)))  # its value may be one that no pipe can carry
            except PlanFailed as error:
                pipe.send(Refusal(str(error), cause=Cause.NO_MANOEUVRE))
            except (ArithmeticError, ValueError, MemoryError) as error:
                words = f"{type(error).__name__}: {error}"
                pipe.send(Refusal(words, cause=Cause.NO_MANOEUVRE))
    except (EOFError, OSError):
        return


def read_request(request: PlanRequest) -> tuple[Any, PlantDescription, Any]:
    """Return the section, bench and gains that a request is planned with.

    Raises:
        BadInput: if a key or value of the section, or the bench, is not allowed.
    """
    from flexslew_control.planners import PLANNERS, PlanSettings, require_section
    from flexslew_control.planners.law_gains import law_gains
    from flexslew_plant.settings import validated

    plant = _plant(request)
    settings = validated(PlanSettings, request.values, "plan", request.trust)
    require_units_of_joints(PlanSettings, request.values, plant.testbed, "plan")
    _require_ticks(settings, request.period)
    if getattr(settings, "method", None) in PLANNERS:
        require_section(settings, plant, "request")
    rest, law = request.beginning
    gains = law_gains(law, plant, "the active controller")
    if rest:
        settings, plant = _from_reference(settings, plant, {**rest})
    return settings, plant, gains


def _from_reference(
    settings: Any, plant: PlantDescription, initial: dict[str, float]
) -> tuple[Any, PlantDescription]:
    """Return section and bench for a plan that begins where the reference is then.

    A section without a key for it, as a user's own may be, begins where the bench does.
    """
    if starts_in_motion(plant.testbed):  # those rates were at tick 0
        section: Any = at_rest(plant.testbed)
        section = replace(section, initial=type(plant.testbed.initial)(**initial))
        plant = replace(plant, testbed=section)
    if not hasattr(settings, "initial"):
        testbed = with_changes(plant.testbed, {"initial": initial}, "plan", plant.trust)
        return settings, replace(plant, testbed=testbed)
    given = settings.initial is not None
    return (settings if given else replace(settings, initial=initial)), plant


def _require_ticks(settings: Any, period: float) -> None:
    """Check that a manoeuvre is short enough to wait for, and for a message.

    Raises:
        BadInput: if it is too long.
    """
    max_duration = MOST_TICKS * period
    duration = getattr(settings, "duration", None) or 0.0
    if duration > max_duration:
        raise BadInput(Refusal(f"at most {max_duration:g} s", "duration", duration, "plan"))


def _plant(request: PlanRequest) -> PlantDescription:
    limit = np.array(request.effort_limit, dtype=np.float64)
    if not request.bench:
        return PlantDescription(default_testbed(), request.period, limit, request.trust)
    plant = plant_description(request.bench, "/testbed", request.trust)
    return replace(plant, period=request.period, effort_limit=limit)
