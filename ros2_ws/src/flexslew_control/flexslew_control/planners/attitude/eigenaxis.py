"""A slew about the eigenaxis: one turn about an axis that stays in the body and in space.

From one attitude to another a body can turn about a single axis (Euler). Along it the angle is
planned as that of a joint, and every tick's efforts are those that make the whole model follow:
they hold the other axes and carry the gyroscopic torque w x J w (Wie, Weiss and Arapostathis 1989).
"""

from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from flexslew_control.law import PlantDescription
from flexslew_control.linear.free_platform import rate_outputs
from flexslew_control.plan import Plan
from flexslew_control.planners.attitude.attitude_goal import SAME
from flexslew_control.planners.slew import Feedback
from flexslew_plant.arrays import Matrix, Vector
from flexslew_plant.counted import count_text
from flexslew_plant.errors import BadInput, PlanFailed
from flexslew_plant.testbeds.contract import RigidTurn, ThreeAxes
from flexslew_plant.testbeds.model import Model
from flexslew_plant.testbeds.orientation.attitude import product, quaternion, rotation_vector

ROTATION = "turn"  # name of the joint about the eigenaxis
_EXACT = 1e-12  # of the joints' rates at a tick [rad/s or m/s]
_RETURN_TICKS = 10.0  # ticks in which a drift goes back
_ITERATIONS = 4  # of the efforts of a tick


@dataclass(frozen=True)
class Eigenaxis:
    """A manoeuvre reduced to the turn about its eigenaxis, and the way back.

    Args:
        settings: the `plan` section about that turn.
        plant: with one joint, `turn`.
        feedback: of that joint; None: there is none.
        bench: what stands on the bench.
        whole: the model of all joints that the planner believes in.
        first: where all joints start, shape (joints,) [rad or m].
        last: where they go, shape (joints,) [rad or m].
        axis: the eigenaxis in body axes, shape (3,).
        angle: about it [rad].
        carried: what the joints' places go along with a turn, shape (3, joints) [m/rad].
        left_out: of the bench, in words.
    """

    settings: Any
    plant: PlantDescription
    feedback: Feedback | None
    bench: PlantDescription
    whole: Model
    first: Vector
    last: Vector
    axis: Vector
    angle: float
    carried: Matrix
    left_out: str

    def embedded(self, plan: Plan) -> Plan:
        """Return the plan for all joints of a plan of the turn."""
        names = self.bench.joint_names
        position, velocity = self._path(plan.position[:, 0], plan.velocity[:, 0])
        effort = np.zeros((len(plan.effort), len(names)))
        if plan.effort.any():
            effort = tracking_efforts(self.whole, position, velocity, plan.period)
        by_joint = {
            "goal": dict(zip(names, self.last.tolist(), strict=True)),
            "initial": dict(zip(names, self.first.tolist(), strict=True)),
        }
        requested = {key: value for key, value in by_joint.items() if key in plan.request}
        whole = of_all_joints(plan, names, (position, velocity, effort), self.left_out)
        return replace(
            whole,
            state=np.zeros((len(position), 0)),
            request={**plan.request, **requested},
            summary={**whole.summary, "eigenaxis": self.axis.tolist(), "angle": self.angle},
        )

    def _path(self, angle: Vector, rate: Vector) -> tuple[Matrix, Matrix]:
        """Return positions and rates of all joints, (ticks + 1, joints)."""
        attitude = self.whole.attitude
        assert attitude is not None
        start = quaternion(attitude.rotation_vector_of(self.first))
        rotation = rotation_vector(product(start, quaternion(np.outer(angle, self.axis))))
        rotation = continuous(rotation)
        position = self.first + (rotation - rotation[0]) @ self.carried
        turns = attitude.axes.any(axis=1)
        position[:, turns] = (rotation @ attitude.axes.T)[:, turns]
        return position, np.outer(rate, attitude.axes @ self.axis + self.axis @ self.carried)


def of_all_joints(
    plan: Plan, names: tuple[str, ...], motion: tuple[Matrix, Matrix, Matrix], left_out: str
) -> Plan:
    """Return a plan about one axis as one of all joints.

    Args:
        plan: about the axis.
        names: of all joints.
        motion: positions and rates, shape (ticks + 1, joints), and efforts, shape (ticks, joints).
        left_out: what the planner's model lacks of the bench, in words.
    """
    position, velocity, effort = motion
    peak = abs(effort).max(axis=0, initial=0.0).tolist()
    believes = ", ".join(filter(None, (plan.summary.get("believes", ""), left_out)))
    return replace(
        plan,
        joint_names=names,
        position=position,
        velocity=velocity,
        effort=effort,
        summary={**plan.summary, "peak_effort": peak, "believes": believes},
    )


def eigenaxis(
    settings: Any,
    plant: PlantDescription,
    feedback: Feedback | None,
    ends: tuple[Vector, Vector],
    whole: ThreeAxes,
    modes: int | None,
    share: float = 1.0,
) -> Eigenaxis:
    """Return the manoeuvre about the eigenaxis, the shorter way round.

    Args:
        settings: the `plan` section.
        plant: what stands on the bench.
        feedback: of its joints; None: there is none.
        ends: where all joints start and go, shape (joints,) each [rad or m].
        whole: what the planner believes of the bench.
        modes: how many frequencies the planner counts with; None: all.
        share: of the torque about the axis that the drives can give [-].

    Raises:
        BadInput: the goal is the attitude at the start.
    """
    first, last = ends
    bench: Any = plant.testbed
    model: Model = bench.model()
    assert model.attitude is not None
    rotation = model.attitude.rotation_vector_of(model.joint_error(first, last))
    angle = float(np.linalg.norm(rotation))
    if angle <= SAME:
        raise BadInput(
            "another attitude: whole turns away the craft is where it starts", "plan", "goal"
        )
    axis = rotation / angle
    limit = share * axis_torque(whole.rigid_turn_about(axis), plant.effort_limit, angle)
    reduced: Any = whole.turning_about(axis, limit, modes)
    changes: dict[str, Any] = {"goal": {ROTATION: angle}}
    changes |= {key: None for key in ("model", "initial") if hasattr(settings, key)}
    seen = model.attitude.axes @ axis
    if getattr(settings, "feedback", None) is not None:
        changes["feedback"] = _axis_gains(settings.feedback, seen)
    return Eigenaxis(
        replace(settings, **changes),
        replace(
            plant,
            testbed=reduced,
            effort_limit=np.array([limit]),
            delay=plant.delay.max(keepdims=True, initial=0.0),
        ),
        None if feedback is None else _axis_gains(feedback, seen),
        plant,
        reduced_to(whole, model).with_time_zero(settings.start),
        first,
        last,
        axis,
        angle,
        joint_coupling(whole),
        f"turns about the eigenaxis {np.round(axis, 3).tolist()} by {angle:.4g} rad, the shorter "
        f"way, on {reduced.modes} of {count_text(model.modes, 'mode')}",
    )


def joint_coupling(whole: ThreeAxes) -> Matrix:
    """Return how far a turn about each body axis carries the joints, shape (3, joints) [m/rad].

    Zero for those that read the attitude.
    """
    testbed: Any = whole
    attitude = testbed.model().attitude
    coupling = np.array([whole.rigid_turn_about(axis).carried for axis in np.eye(3)])
    return np.where(attitude.axes.any(axis=1), 0.0, coupling)


def reduced_to(whole: ThreeAxes, bench: Model) -> Model:
    """Return the model of all joints that a planner believes in."""
    testbed: Any = whole
    model: Model = testbed.model()
    return model if model.joint_names == bench.joint_names else bench


def axis_torque(rotation: RigidTurn, limit: Vector, angle: float) -> float:
    """Return the torque about an axis that no drive needs its limit for [N m].

    From rest to rest by an angle A with |alpha| <= a the rate squared stays below a A, so drive j
    needs at most a (|tangential_j| + A |centrifugal_j|).

    Args:
        rotation: what all drives do for it.
        limit: of the drives, shape (joints,) [N m or N].
        angle: of the turn [rad].
    """
    needed = np.abs(rotation.tangential) + angle * np.abs(rotation.centrifugal)
    needed = np.where(needed > 1e-12 * needed.max(), needed, 1e-300)
    return float(rotation.inertia * (limit / needed).min())


def _axis_gains(feedback: Feedback, seen: Vector) -> Feedback:
    """Return the gains about the axis: what each joint sees of a turn, and gives for it."""
    kp, kd = (
        float((np.array(g) * np.ones(seen.size)) @ seen**2) for g in (feedback.kp, feedback.kd)
    )
    return Feedback(kp=(kp,), kd=(kd,))


def continuous(rotation: Matrix) -> Matrix:
    """Return rotation vectors without jumps of a whole turn, shape (k, 3) [rad]."""
    angle = np.linalg.norm(rotation, axis=1)
    path = rotation.copy()
    for k in range(1, len(path)):
        if angle[k] > 0.0:
            axis = rotation[k] / angle[k]
            turns = np.round((axis @ path[k - 1] - angle[k]) / (2.0 * np.pi))
            path[k] = (angle[k] + 2.0 * np.pi * turns) * axis if turns else rotation[k]
    return path


def tracking_efforts(model: Model, position: Matrix, velocity: Matrix, period: float) -> Matrix:
    """Return the efforts, held over every tick, with which the joints follow a path.

    Each tick's are found by Newton's method on the model itself, so gyroscopic torques, modes and
    moving wheels are all in them. At its end the joints have their rates, and what the hold let
    them drift from their positions, of second order in the period, goes back in a few ticks.

    Args:
        model: at rest at the start.
        position: of the joints at the ticks, shape (ticks + 1, joints) [rad or m].
        velocity: shape (ticks + 1, joints) [rad/s or m/s].
        period: one tick [s].

    Returns:
        shape (ticks, joints) [N m or N].

    Raises:
        PlanFailed: they grow without bound: modes that a tick is long for answer every correction
            with a larger one.
    """
    rest = model.rest(dict(zip(model.joint_names, position[0].tolist(), strict=True)))
    x = np.concatenate((rest, np.zeros(model.coordinates)))
    read = rate_outputs(model, rest)
    inverse = np.linalg.pinv(
        period * read @ np.linalg.solve(model.mass_matrix(rest), model.input_matrix(rest))
    )
    u, efforts = np.zeros(model.efforts), np.empty((len(velocity) - 1, model.efforts))
    for k in range(len(efforts)):
        drift = model.joint_error(model.joint_state(x)[0], position[k])
        rate, after = velocity[k + 1] + drift / (_RETURN_TICKS * period), x
        for _ in range(_ITERATIONS):
            after = model.advance(x, u, period, t=k * period)
            off = rate - model.joint_state(after)[1]
            if np.abs(off).max() <= _EXACT:
                break
            u = u + inverse @ off
        if not np.isfinite(after).all():
            raise PlanFailed(
                f"no efforts held over a period of {period:g} s follow the turn: modes are too "
                "fast for it; use a shorter period"
            )
        efforts[k], x = u, after
    return efforts
