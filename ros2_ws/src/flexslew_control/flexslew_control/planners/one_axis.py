"""Planning for a spacecraft with many joints: it turns about one, and all of them fly the plan."""

from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np

from flexslew_control.law import PlantDescription
from flexslew_control.plan import Plan
from flexslew_control.planners.slew import Feedback
from flexslew_plant.arrays import Vector
from flexslew_plant.errors import BadInput
from flexslew_plant.testbeds import believed, initial_positions, with_model_file
from flexslew_plant.testbeds.contract import RigidTurn, Turning

RELEVANT = "relevant"  # as `model: modes`: those that matter


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

    def embedded(self, plan: Plan) -> Plan:
        """Return the plan for all joints: what stays at rest, and the efforts that hold it there.

        The efforts are those of (44) to (46) in Sung and Joo; the joint that moves has what the
        plan gives it besides.
        """
        k, count = self.joint, len(self.names)
        rest = np.tile(self.start, (len(plan.position), 1))
        position, velocity = rest, np.zeros_like(rest)
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
        peak = abs(effort).max(axis=0, initial=0.0)
        believes = ", ".join(filter(None, (plan.summary.get("believes", ""), self.left_out)))
        own = {"peak_effort": [float(x) for x in peak], "believes": believes}
        summary = {**plan.summary, **own}
        assert effort.shape[1] == count
        return replace(
            plan,
            joint_names=self.names,
            position=position,
            velocity=velocity,
            effort=effort,
            summary=summary,
        )


def turns(plant: PlantDescription) -> bool:
    """Return whether a bench is planned about one axis at a time."""
    testbed = plant.testbed
    if not isinstance(testbed, Turning):
        return False
    model = testbed.model()
    return model.before_modes != model.joints or bool(model.kernels.extra_positions)


def more_modes(settings: Any, plant: PlantDescription, count: int) -> bool:
    """Return whether the turn can be planned on more modes than with this many frequencies."""
    testbed: Any = plant.testbed
    joint = next(iter(settings.goal))
    now, ahead = (testbed.turning(joint, k).modes for k in (count, count + 1))
    return bool(ahead > now)


def one_axis(settings: Any, plant: PlantDescription, feedback: Feedback | None) -> OneAxis:
    """Return the manoeuvre about the one joint that moves.

    Raises:
        BadInput: none or more than one joint moves, or it does not turn the platform.
    """
    testbed = plant.testbed
    model = testbed.model()
    names = plant.joint_names
    first = initial_positions(testbed) | (getattr(settings, "initial", None) or {})
    goal = getattr(settings, "goal", None) or {}
    unknown = sorted(set(goal) - set(names))
    if unknown:
        raise BadInput(
            f"plan: goal: {unknown[0]} is not a joint of the testbed; allowed: {', '.join(names)}"
        )
    moving = [name for name in names if goal.get(name, first[name]) != first[name]]
    if len(moving) != 1:
        raise BadInput(
            f"plan: goal: {', '.join(moving) or 'nothing'} moves; a spacecraft is planned about "
            "one axis at a time: give one joint"
        )
    k = names.index(moving[0])
    given = getattr(settings, "model", None)
    changes = None if given is None else with_model_file(given, "plan: model")
    count = (changes or {}).get("modes", 1 if changes is None else None)
    if count is not None and (not isinstance(count, int) or count < 0):
        raise BadInput(f"plan: model: modes: {count!r} is not allowed: a number, or relevant")
    kept = {key: value for key, value in (changes or {}).items() if key != "modes"}
    whole: Any = believed(testbed, kept or None, "plan: model", plant.trust)
    _require_turning(whole, names)
    reduced = whole.turning(moving[0], count)
    about: dict[str, Any] = {"goal": {moving[0]: goal[moving[0]]}}
    taken = {"model": None, "initial": {moving[0]: first[moving[0]]}}
    about |= {key: value for key, value in taken.items() if hasattr(settings, key)}
    if getattr(settings, "feedback", None) is not None:
        about["feedback"] = _own(settings.feedback, k)
    return OneAxis(
        replace(settings, **about),
        PlantDescription(reduced, plant.period, plant.effort_limit[k : k + 1], plant.trust),
        None if feedback is None else _own(feedback, k),
        k,
        names,
        np.array([first[name] for name in names]),
        whole.rigid_turn(moving[0]),
        _left_out(reduced.model().modes, model.modes, moving[0]),
    )


def _require_turning(testbed: Any, names: tuple[str, ...]) -> None:
    """Refuse a believed model of another kind that cannot say what all joints do in a turn."""
    there = testbed.model().joint_names
    if not isinstance(testbed, Turning):
        raise BadInput(
            f"plan: model: kind: {testbed.kind} cannot be turned about one axis: leave it out, or "
            "give a file of an identification"
        )
    if there != names:
        raise BadInput(
            f"plan: model: joints: {', '.join(there)} is not allowed: a turn needs all joints of "
            f"the bench in their order, {', '.join(names)}"
        )


def _left_out(modes: int, of: int, joint: str) -> str:
    """Return in words what a turn about one axis leaves out of the bench."""
    return f"turns about {joint} alone, the other axes rigid, on {modes} of {of} modes"


def _own(feedback: Feedback, k: int) -> Feedback:
    """Return the gains of one joint."""
    kp, kd = ((g[k],) if len(g) > 1 else g for g in (feedback.kp, feedback.kd))
    return Feedback(kp=kp, kd=kd)
