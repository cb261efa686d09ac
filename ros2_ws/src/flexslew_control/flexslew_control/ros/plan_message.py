"""A Plan as a message and back, for the nodes."""

import numpy as np
from flexslew_msgs import msg

from flexslew_control.plan import Plan
from flexslew_control.plan_file import plan_hash
from flexslew_plant.arrays import Matrix
from flexslew_plant.ros.node import doubles, stamp
from flexslew_plant.settings import load_yaml, yaml_text


def plan_message(plan: Plan, at: float) -> msg.Plan:
    """Return the plan as a message that is published at the simulated time `at` [s]."""
    return msg.Plan(
        stamp=stamp(at),
        method=plan.method,
        hash=plan_hash(plan),
        joint_names=list(plan.joint_names),
        start=plan.start,
        duration=plan.duration,
        period=plan.period,
        position=doubles(plan.position),
        velocity=doubles(plan.velocity),
        effort=doubles(plan.effort),
        state=doubles(plan.state),
        request=yaml_text(plan.request),
        summary=yaml_text(plan.summary),
        versions=yaml_text(plan.versions),
    )


def plan_of(message: msg.Plan) -> Plan:
    """Return the message as a plan."""
    joints = len(message.joint_names)
    ticks = len(message.effort) // joints

    def rows(values: object, count: int) -> Matrix:
        return np.frombuffer(values).reshape(count, -1)  # type: ignore[call-overload, no-any-return]

    return Plan(
        method=message.method,
        joint_names=tuple(message.joint_names),
        start=message.start,
        period=message.period,
        position=rows(message.position, ticks + 1),
        velocity=rows(message.velocity, ticks + 1),
        effort=np.frombuffer(message.effort).reshape(ticks, joints),
        state=rows(message.state, ticks + 1) if message.state else np.zeros((ticks + 1, 0)),
        duration=message.duration,
        request=load_yaml(message.request, "plan") or {},
        summary=load_yaml(message.summary, "plan") or {},
        versions=load_yaml(message.versions, "plan") or {},
    )
