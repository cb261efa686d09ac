"""The slew that a planner receives: design model, start, goal, gains and ticks.

The bench supplies the keys that a `plan` section leaves out: the testbed (simplified for a
planner), the positions of its joints at the start, and the gains of the active controller.
"""

import importlib.metadata
import platform
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property, lru_cache
from typing import Annotated, Any, NamedTuple, TypeAlias

import numpy as np
from pydantic import Field

from flexslew_control.analysis.linear_plant import PlantPath, motors
from flexslew_control.analysis.lti import Lti
from flexslew_control.law import PlantDescription, per_joint
from flexslew_control.plan import Plan
from flexslew_plant.arrays import EMPTY, Matrix, Vector
from flexslew_plant.counted import count_text
from flexslew_plant.errors import BadInput, PlanFailed
from flexslew_plant.hardware.actuator import IDEAL, ActuatorSettings
from flexslew_plant.known_joints import require_joints_of
from flexslew_plant.settings import PerJoint, flat, plain, section
from flexslew_plant.testbeds import Model, Testbed, design_testbed, initial_positions
from flexslew_plant.testbeds.integration_error import steps_per_tick

_LATEST = 50  # ticks, of commands that a planner counts with
_MAX_DIFFERENCES = 6  # differences between model and bench that are listed one by one


@section
class Feedback:
    """The gains (17) of the feedback that flies the plan, which the planner takes into account."""

    kp: PerJoint = (460.0,)  # one per joint, or one for all [N m/rad or N/m]
    kd: PerJoint = (920.0,)  # one per joint, or one for all [N m s/rad or N s/m]


FeedbackKey: TypeAlias = Annotated[
    Feedback | None,
    Field(
        description="gains of the feedback that will fly the plan; null: those of the controller "
        "in charge, where it has such gains"
    ),
]


class ExcessTorque(PlanFailed):
    """The slew needs more than the drives have; a longer one may not."""


def require_effort(peak: Vector, limit: Vector, names: Sequence[str], words: str) -> None:
    """Check that no drive is asked for more than it has.

    Args:
        peak: largest efforts, shape (joints,) [N m or N].
        limit: of the drives, shape (joints,) [N m or N].
        names: of the joints.
        words: of the refusal, with places for effort, name and limit.

    Raises:
        ExcessTorque: one is.
    """
    for needed, name, allowed in zip(peak.tolist(), names, limit.tolist(), strict=True):
        if needed > allowed:
            raise ExcessTorque(words.format(needed, name, allowed))


@dataclass(frozen=True)
class Slew:
    """The slew that a planner receives.

    Args:
        testbed: the planner's model of the testbed.
        start, goal: positions at which the joints rest, shape (joints,) [rad or m].
        kp, kd: gains of the feedback that flies the plan, shape (joints,).
        period: one tick [s].
        effort_limit: limits of the drives, shape (joints,) [N m or N].
        beliefs: differences of the planner's model from the bench in one line; empty: none.
        actuator: the planner's model of the motors.
        delay: delay of the command of each motor, shape (joints,) [ticks]; empty: none.
        begin: time of the bench at the start of the slew, from which a plan counts [s].
    """

    testbed: Testbed
    start: Vector
    goal: Vector
    kp: Vector
    kd: Vector
    period: float
    effort_limit: Vector
    beliefs: str = ""
    actuator: ActuatorSettings = IDEAL
    delay: Vector = field(default_factory=lambda: EMPTY)
    begin: float = 0.0

    @cached_property
    def model(self) -> Model:
        """The equations of motion that the planner believes in, in the time of the slew."""
        return self.testbed.model().with_time_zero(self.begin)

    @cached_property
    def steps(self) -> int:
        """Steps of the integration in a tick that the planner's model needs, as the bench's does.

        Raises:
            BadInput: the period is too long for the model's fastest mode.
        """
        poles = self.model.integrated_poles(self.model.rest(self.named(self.start)))
        return steps_per_tick(poles, self.period)

    def motors(self, period: float) -> Lti:
        """Return the dynamics from commands to efforts of the motors, by ticks of a period [s]."""
        delay = self.delay * (self.period / period) if self.delay.size else None
        path = PlantPath(period, self.actuator, delay=delay)
        return motors(path, self.model.joint_names)

    @property
    def static(self) -> bool:
        """Whether every joint is at its goal already."""
        return bool((self.start == self.goal).all())

    @property
    def way(self) -> float:
        """The largest distance of a joint from its goal [rad or m]."""
        return float(np.abs(self.goal - self.start).max())

    def named(self, values: Vector) -> dict[str, float]:
        """Return one number per joint by the joint's name."""
        return dict(zip(self.model.joint_names, values.tolist(), strict=True))


class KnownMotors(NamedTuple):
    """What planners count with of a bench's motors."""

    actuator: ActuatorSettings  # its lag alone
    gain: None
    delay: Vector  # of each motor, (actuators,) [ticks]


def known_motors(plant: PlantDescription) -> KnownMotors:
    """Return the lag and the delay of a bench's motors; a very long delay is not counted with."""
    count = plant.effort_limit.size
    known = plant.delay.size == count and plant.delay.max() <= _LATEST
    delay = plant.delay if known else np.zeros(count)
    return KnownMotors(ActuatorSettings(lag=plant.actuator.lag), None, delay)


def slew_of(
    settings: Any,
    plant: PlantDescription,
    feedback: Feedback | None = None,
    late_motors: bool = False,
) -> Slew:
    """Return the slew of a `plan` section.

    Args:
        settings: any `plan` section; of model, initial, goal and feedback it need not have all.
        plant: the bench.
        feedback: gains of the active controller; None: it has no such gains.
        late_motors: whether the planner includes the lag and the delay of the bench's motors;
            others assume motors that give the command at once.

    Raises:
        BadInput: if the testbed does not have a joint or a key.
    """
    testbed = design_testbed(
        plant.testbed, getattr(settings, "model", None), "plan: model", plant.trust
    )
    names = testbed.model().joint_names
    if names != plant.joint_names:
        raise BadInput(
            f"all joints of the bench, {', '.join(plant.joint_names)}, in this order",
            "plan",
            "model.joints",
            list(names),
        )
    require_joints_of(settings, names, "plan")
    first = initial_positions(testbed) | (getattr(settings, "initial", None) or {})
    last = first | _goal(settings, testbed, names)
    gains = getattr(settings, "feedback", None) or feedback or Feedback()
    slew = Slew(
        testbed,
        np.array([first[name] for name in names]),
        np.array([last[name] for name in names]),
        per_joint("plan: feedback: kp", gains.kp, names),
        per_joint("plan: feedback: kd", gains.kd, names),
        plant.period,
        plant.effort_limit,
        begin=settings.start,
    )
    if late_motors:
        known = known_motors(plant)
        slew = replace(slew, actuator=known.actuator, delay=known.delay)
    return replace(slew, beliefs=_model_differences(slew, plant, feedback))


def _goal(settings: Any, testbed: Testbed, names: tuple[str, ...]) -> dict[str, float]:
    """Return where joints shall go, those that move by name.

    Raises:
        BadInput: the section has no goal, and the testbed no typical one of these joints.
    """
    if settings.goal is not None:
        return dict(settings.goal)
    if getattr(settings, "is_made", False):  # its plan is made already, with its goal
        return {}
    goal = testbed.typical_goal
    if not set(goal) <= set(names):
        joint_list = ", ".join(names)
        raise BadInput(f"plan: goal: missing; give one to some of the joints {joint_list}")
    return goal


def _model_differences(slew: Slew, plant: PlantDescription, feedback: Feedback | None) -> str:
    """Return in one line what the planner assumes, unlike the bench."""
    here, bench = flat(plain(slew.testbed)), flat(plain(plant.testbed))
    here = {key: value for key, value in here.items() if not key.startswith("initial")}
    pairs = [(key, here[key], bench.get(key)) for key in here if here[key] != bench.get(key)]
    motors_here, bench_motors = plain(slew.actuator), plain(plant.actuator)
    changed = [key for key in motors_here if motors_here[key] != bench_motors[key]]
    pairs += [(f"actuator.{key}", motors_here[key], bench_motors[key]) for key in changed]
    if plant.delay.any() and not slew.delay.any():
        pairs.append(("command delay [ticks]", 0, plant.delay.tolist()))
    rest_position = initial_positions(plant.testbed)
    for name, at in slew.named(slew.start).items():
        if at != rest_position.get(name):
            pairs.append((f"initial.{name}", at, rest_position.get(name)))
    if feedback is not None:
        names = slew.model.joint_names
        for key, design, given in (("kp", slew.kp, feedback.kp), ("kd", slew.kd, feedback.kd)):
            actual = per_joint(key, given, names)
            if (design != actual).any():
                pairs.append((f"feedback.{key}", design.tolist(), actual.tolist()))
    differences = [
        f"{count_text(design, 'mode') if key == 'modes' else f'{key} {design}'} instead of {actual}"
        for key, design, actual in pairs[:_MAX_DIFFERENCES]
    ]
    more = len(pairs) - len(differences)
    words = ", ".join(differences + [f"{more} more"] * (more > 0))
    return " ".join(words.split())  # nested values are texts of several lines


def joint_ranges(
    given: Mapping[str, tuple[float, float]], slew: Slew, strict: bool = False
) -> Matrix:
    """Return lowest and highest positions, shape (2, joints); infinite where free [rad or m].

    Args:
        given: `joint_range` of a section, by joint.
        slew: the requested slew.
        strict: whether start and goal may not be at an end of their range.

    Raises:
        BadInput: start or goal are not inside a range.
    """
    found = np.tile([[-np.inf], [np.inf]], slew.goal.size)
    for name, (low, high) in given.items():
        j = slew.model.joint_names.index(name)
        first, last = sorted((float(slew.start[j]), float(slew.goal[j])))
        if not low <= first <= last <= high or (strict and (low == first or last == high)):
            raise BadInput(
                f"the joint goes from {slew.start[j]:g} to {slew.goal[j]:g}, which must lie inside",
                "plan",
                f"joint_range.{name}",
                [low, high],
            )
        found[:, j] = low, high
    return found


def tick_times(start: float, duration: float, period: float) -> Vector:
    """Return the ticks of a manoeuvre, counted from its start, shape (ticks + 1,) [s].

    Raises:
        BadInput: the start is not on a tick.
    """
    if abs(start / period - round(start / period)) > 1e-6:
        raise BadInput(f"not a multiple of {period!r} s", "plan", "start", start)
    return np.asarray(
        period * np.arange(int(np.ceil(duration / period - 1e-9)) + 1, dtype=np.float64)
    )


def plan_on_ticks(
    settings: Any,
    slew: Slew,
    reference: tuple[Matrix, Matrix],
    effort: Matrix,
    summary: dict[str, Any],
    state: Matrix | None = None,
) -> Plan:
    """Return the plan of a slew on its ticks.

    Args:
        settings: the `plan` section; its method and start are read.
        slew: the requested slew.
        reference: positions and velocities of the joints, shape (ticks + 1, joints) each.
        effort: feedforward, its mean over each tick, shape (ticks, joints) [N m or N].
        summary: of the plan, with its `duration`.
        state: nominal states, shape (ticks + 1, 2 n); None: the planner has none.
    """
    position, velocity = reference
    return Plan(
        method=settings.method,
        joint_names=slew.model.joint_names,
        start=settings.start,
        period=slew.period,
        position=position,
        velocity=velocity,
        effort=effort,
        state=np.zeros((len(position), 0)) if state is None else state,
        duration=summary["duration"],
        summary=summary,
    )


@lru_cache
def _versions() -> dict[str, str]:
    names = ("flexslew_control", "flexslew_plant", "numpy", "scipy", "numba")
    return {"python": platform.python_version()} | {name: _version(name) for name in names}


def _version(name: str) -> str:
    try:
        return importlib.metadata.version(name)
    except importlib.metadata.PackageNotFoundError:
        return "source"


def software_versions() -> dict[str, str]:
    """Return the versions of what makes a plan."""
    return dict(_versions())
