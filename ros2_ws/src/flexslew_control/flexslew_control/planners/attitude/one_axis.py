"""Planning for a spacecraft with many joints: it turns about one axis, and all of them fly it."""

from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np

from flexslew_control.law import PlantDescription
from flexslew_control.plan import Plan
from flexslew_control.planners.attitude.eigenaxis import (
    Eigenaxis,
    eigenaxis,
    of_all_joints,
    tracking_efforts,
)
from flexslew_control.planners.slew import Feedback
from flexslew_plant.arrays import Vector
from flexslew_plant.errors import BadInput
from flexslew_plant.known_joints import require_joints_of
from flexslew_plant.own_code import NO_CODE, Trust
from flexslew_plant.testbeds import design_testbed, initial_positions, with_model_file
from flexslew_plant.testbeds.contract import (
    HingeTurn,
    Retargetable,
    RigidTurn,
    ThreeAxes,
    Turning,
    Wheeled,
)
from flexslew_plant.testbeds.model import Model
from flexslew_plant.testbeds.orientation.attitude import AttitudeJoints

RELEVANT = "relevant"  # as `model: modes`: those that matter
_OFF_AXIS = 1e-9  # of an axis: rotation across it by rounding [-], [rad]


class OneAxis(NamedTuple):
    """A manoeuvre reduced to the joint that moves, and the way back."""

    settings: Any  # the `plan` section about that joint
    plant: PlantDescription  # with that joint alone
    feedback: Feedback | None
    joint: int
    names: tuple[str, ...]  # of all joints
    start: Vector  # of all joints, (joints,) [rad or m]
    rigid: RigidTurn
    left_out: str  # of the bench, in words; empty: nothing but other axes
    whole: Model  # of all joints, as the planner believes, in the time of the slew
    hinge_turns: tuple[HingeTurn, ...]  # of its appendages

    def embedded(self, plan: Plan) -> Plan:
        """Return the plan for all joints: the others at rest, and the efforts that hold them there.

        Joints that read the place of a point off the axis go with the platform, as do those that
        read the turn along an axis askew to it.

        The efforts are those of (44) to (46) in Sung and Joo, to which the plan's effort of the
        moving joint is added. While an appendage turns they are those of the whole model, which
        balance that turn, too.
        """
        k, count = self.joint, len(self.names)
        rest = np.tile(self.start, (len(plan.position), 1))
        position, velocity = rest, np.zeros_like(rest)
        position += np.outer(plan.position[:, 0] - self.start[k], self.rigid.carried)
        velocity += np.outer(plan.velocity[:, 0], self.rigid.carried)
        position[:, k], velocity[:, k] = plan.position[:, 0], plan.velocity[:, 0]
        rate = velocity[:, k]
        if getattr(self.settings, "feedforward", "") == "zero_order":
            acceleration, square = plan.effort[:, 0] / self.rigid.inertia, rate[:-1] ** 2
        else:
            acceleration = np.diff(rate) / plan.period
            square = (0.5 * (rate[:-1] + rate[1:])) ** 2
        effort = np.outer(acceleration, self.rigid.tangential)
        effort += np.outer(square, self.rigid.centrifugal)
        effort[:, k] += plan.effort[:, 0] - self.rigid.inertia * acceleration
        hinge_active = any(t.begin < plan.end and t.end > plan.start for t in self.hinge_turns)
        if hinge_active and plan.effort.any():
            others = np.arange(count) != k
            effort[:, others] = tracking_efforts(self.whole, position, velocity, plan.period)[
                :, others
            ]
        return of_all_joints(plan, self.names, (position, velocity, effort), self.left_out)


def has_single_axis(plant: PlantDescription) -> bool:
    """Return whether a bench is planned about one axis at a time."""
    testbed = plant.testbed
    if not isinstance(testbed, Turning):
        return False
    model = testbed.model()
    return model.before_modes != model.joints or bool(model.kernels.extra_positions)


def in_three_axes(plant: PlantDescription) -> bool:
    """Return whether the joints of a bench turn it in three axes."""
    testbed = plant.testbed
    return isinstance(testbed, ThreeAxes) and testbed.model().attitude is not None


def more_modes(settings: Any, plant: PlantDescription, count: int) -> bool:
    """Return whether the turn can be planned on more modes than with this many frequencies."""
    now, more = (
        reduced(replace(settings, model={"modes": k}), plant, None).plant.testbed.modes
        for k in (count, count + 1)
    )
    return bool(more > now)


def reduced(
    settings: Any, plant: PlantDescription, feedback: Feedback | None, share: float = 1.0
) -> "OneAxis | Eigenaxis":
    """Return the manoeuvre about one axis: that of the joint that moves, or the eigenaxis.

    Args:
        settings: the `plan` section, its goal by joint.
        plant: what stands on the bench.
        feedback: gains of its joints; None: there are none.
        share: of the torque about the axis that the drives can give [-].

    Raises:
        BadInput: nothing moves, or what does cannot be turned about one axis.
    """
    testbed: Any = plant.testbed
    names = plant.joint_names
    require_joints_of(settings, names, "plan")
    first = initial_positions(testbed) | (getattr(settings, "initial", None) or {})
    goal = getattr(settings, "goal", None) or {}
    changed = [name for name in names if goal.get(name, first[name]) != first[name]]
    attitude = testbed.model().attitude
    is_rotation = [] if attitude is None else [attitude.axes[names.index(n)].any() for n in changed]
    is_attitude = isinstance(testbed, ThreeAxes) and bool(is_rotation) and all(is_rotation)
    if len(changed) == 1 and is_attitude:
        start = np.array([first[name] for name in names])
        is_attitude = not is_single_rotation(attitude, names.index(changed[0]), start)
    if len(changed) != 1 and not is_attitude:
        raise BadInput(
            f"plan: goal: {', '.join(changed) or 'nothing'} moves; a spacecraft is planned about "
            "one axis at a time: give one joint, or an attitude where joints turn it in three axes"
        )
    count, kept = split_modes(getattr(settings, "model", None), "plan: model", plant.trust)
    whole: Any = design_testbed(testbed, kept or None, "plan: model", plant.trust)
    if isinstance(whole, Wheeled):
        whole = whole.wheeled()
    if getattr(settings, "initial", None):
        whole = replace(whole, initial=first)
    _require_rotation(whole, names)
    if is_attitude:
        ends = tuple(np.array([at[name] for name in names]) for at in (first, first | goal))
        return eigenaxis(settings, plant, feedback, (ends[0], ends[1]), whole, count, share)
    of_joint = replace(plant, effort_limit=share * plant.effort_limit)
    return _joint_manoeuvre(settings, of_joint, feedback, changed[0], whole, count)


def is_single_rotation(attitude: AttitudeJoints, joint: int, start: Vector) -> bool:
    """Return whether a turn about the axis of one joint moves what this joint reads, and no other.

    Rotation vectors add up about one axis alone: one that the craft is turned about already, and
    along which no other joint reads.

    Args:
        attitude: how joints read the turn.
        joint: number of the one that moves.
        start: of all joints, shape (joints,) [rad].
    """
    axis = attitude.axes[joint]
    others = np.delete(attitude.axes, joint, axis=0)
    off_axis = np.append(others @ axis, np.cross(axis, attitude.rotation_vector_of(start)))
    return bool(np.abs(off_axis).max() <= _OFF_AXIS * np.linalg.norm(axis))


def split_modes(given: Any, place: str, trust: Trust = NO_CODE) -> tuple[Any, dict[str, Any]]:
    """Return how many frequencies a `model` section counts with, None: all; and its other keys.

    Args:
        given: the section; None: it is left out, and one frequency counts.
        place: names it in an error.
        trust: whether its file may be read.

    Raises:
        BadInput: the file that it names cannot be used, or the number is none.
    """
    if given is None:
        return 1, {}
    changes = dict(with_model_file(given, place, trust))
    count = changes.pop("modes", None)
    if not (count is None or count == RELEVANT or (type(count) is int and count >= 0)):
        raise BadInput("a number, or relevant", place, "modes", count)
    return count, changes


def _joint_manoeuvre(
    settings: Any,
    plant: PlantDescription,
    feedback: Feedback | None,
    joint: str,
    whole: Any,
    count: int | None,
) -> OneAxis:
    """Return the manoeuvre about the axis of one joint."""
    names = plant.joint_names
    first = initial_positions(plant.testbed) | (getattr(settings, "initial", None) or {})
    k = names.index(joint)
    pivoting = whole.turning(joint, count)
    changes: dict[str, Any] = {"goal": {joint: settings.goal[joint]}}
    taken = {"model": None, "initial": {joint: first[joint]}}
    changes |= {key: value for key, value in taken.items() if hasattr(settings, key)}
    if getattr(settings, "feedback", None) is not None:
        changes["feedback"] = _joint_gains(settings.feedback, k)
    return OneAxis(
        replace(settings, **changes),
        replace(
            plant,
            testbed=pivoting,
            effort_limit=plant.effort_limit[k : k + 1],
            delay=plant.delay[k : k + 1],
        ),
        None if feedback is None else _joint_gains(feedback, k),
        k,
        names,
        np.array([first[name] for name in names]),
        whole.rigid_turn(joint),
        _left_out(pivoting.model().modes, plant.testbed.model().modes, joint),
        whole.model().with_time_zero(settings.start),
        whole.hinge_turns() if isinstance(whole, Retargetable) else (),
    )


def _require_rotation(testbed: Any, names: tuple[str, ...]) -> None:
    """Refuse a design model of another kind without the motion of all joints in a turn."""
    joint_names = testbed.model().joint_names
    if not isinstance(testbed, Turning):
        raise BadInput(
            f"plan: model: kind: {testbed.kind} cannot be turned about one axis: leave it out, or "
            "give a file of an identification"
        )
    if joint_names != names:
        raise BadInput(
            f"plan: model: joints: {', '.join(joint_names)} is not allowed: a turn needs all "
            f"joints of the bench in their order, {', '.join(names)}"
        )


def _left_out(modes: int, of: int, joint: str) -> str:
    """Return in words what a turn about one axis leaves out of the bench."""
    return f"turns about {joint} alone, the other axes rigid, on {modes} of {of} modes"


def _joint_gains(feedback: Feedback, k: int) -> Feedback:
    """Return the gains of one joint."""
    kp, kd = ((g[k],) if len(g) > 1 else g for g in (feedback.kp, feedback.kd))
    return Feedback(kp=kp, kd=kd)
