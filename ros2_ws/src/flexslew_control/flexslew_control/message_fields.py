"""Answers and plans as the fields of their messages, and plans back, for nodes and logs alike."""

from typing import Any

import numpy as np

from flexslew_control.controllers.controller import Answer
from flexslew_control.controllers.host import ControllerHost
from flexslew_control.plan import Plan
from flexslew_control.plans.plan_file import plan_hash
from flexslew_plant.arrays import EMPTY, Matrix
from flexslew_plant.bench.wire import Stamp
from flexslew_plant.errors import BadInput
from flexslew_plant.message_codec import packer
from flexslew_plant.refusal import Refusal
from flexslew_plant.testbeds.orientation.attitude import AttitudeJoints
from flexslew_plant.yaml_data import load_yaml, yaml_text

_NO_GAINS: Matrix = np.zeros((0, 0))
YAML_FIELDS = ("request", "summary", "versions")  # YAML in the message


def answer_fields(answer: Answer) -> dict[str, Any]:
    """Return the fields of flexslew_msgs/ControllerState but for its header."""
    command, reference, estimate, terms = answer[:4]
    return {
        "tick": command.tick,
        "epoch": command.epoch,
        "controller": command.controller,
        "reference_position": reference.position,
        "reference_velocity": reference.velocity,
        "reference_orientation": answer.reference_orientation,
        "feedforward": reference.effort,
        "estimate_position": estimate.position,
        "estimate_velocity": estimate.velocity,
        "estimate_orientation": answer.estimate_orientation,
        "estimate_disturbance": estimate.disturbance,
        "covariance_diagonal": estimate.covariance.diagonal(),
        "innovation": estimate.innovation,
        "nis": estimate.nis,
        "effort": command.effort,
        "term_names": list(terms),
        "terms": np.concatenate([*terms.values()]) if terms else EMPTY,
    }


def state_bytes(answer: Answer, at: Stamp) -> bytes:
    """Return flexslew_msgs/ControllerState as it goes over DDS, with the stamp of the question."""
    fields = answer_fields(answer).values()
    return packer("flexslew_msgs/msg/ControllerState")(*at, "", *fields)  # of an empty frame


def plan_fields(plan: Plan, attitude: AttitudeJoints | None = None) -> dict[str, Any]:
    """Return the fields of flexslew_msgs/Plan but for its stamp.

    Args:
        plan: of the joints of a bench.
        attitude: those that read an attitude there; None: none do.
    """
    return {
        "method": plan.method,
        "hash": plan_hash(plan),
        "joint_names": list(plan.joint_names),
        "start": plan.start,
        "duration": plan.duration,
        "period": plan.period,
        "position": plan.position.ravel(),
        "velocity": plan.velocity.ravel(),
        "effort": plan.effort.ravel(),
        "state": plan.state.ravel(),
        **({"gains": plan.gains.ravel()} if plan.gains.size else {}),
        **(
            {} if attitude is None else {"orientation": attitude.orientation(plan.position).ravel()}
        ),
        **{name: yaml_text(getattr(plan, name)) for name in YAML_FIELDS},
    }


def status_fields(
    host: ControllerHost, law: str, reason: Refusal | None, settings: str
) -> dict[str, Any]:
    """Return the fields of flexslew_msgs/ControllerStatus but for its stamp and instance.

    Args:
        host: the controller.
        law: name of its law.
        reason: why it could not take charge now; None: it could.
        settings: of the law, and what was computed from them, YAML.
    """
    return {
        "controller": host.name,
        "law": law,
        "ready": reason is None,
        "reason": str(reason or ""),
        "last_tick": host.last_tick,
        "epoch": host.epoch,
        "plan_hash": host.plan_hash,
        "settings": settings,
        "plan_number": host.plan_count,
        "plan_epoch": host.plan_from[0],
        "plan_tick": host.plan_from[1],
    }


def received_plan(message: Any, source: str) -> tuple[Plan, bool]:
    """Return the plan in a message, and whether it was published in flight: a reset drops it.

    Args:
        message: flexslew_msgs/Plan, of ROS or decoded from a log.
        source: to name in an error.

    Raises:
        BadInput: see plan_of.
    """
    return plan_of(message, source), in_flight(message)


def in_flight(message: Any) -> bool:
    """Return whether a plan was published in flight; see received_plan."""
    return bool(message.stamp.sec or message.stamp.nanosec)


def plan_of(message: Any, source: str) -> Plan:
    """Return the plan in a message.

    Args:
        message: flexslew_msgs/Plan, of ROS or decoded from a log.
        source: topic or log to name in an error.

    Raises:
        BadInput: its arrays do not fit together, or its hash does not fit its content.
    """

    def rows(name: str, count: int) -> Matrix:
        values = np.array(getattr(message, name), dtype=np.float64)
        return values.reshape(count, -1) if values.size else np.zeros((count, 0))

    def text(name: str) -> dict[str, Any]:
        found = load_yaml(getattr(message, name), f"{source}: the plan is damaged: {name}") or {}
        if not isinstance(found, dict):
            raise ValueError(f"{name} holds no keys")
        return found

    try:
        joints = len(message.joint_names)
        if not joints:
            raise ValueError("it moves no joint")
        ticks = len(message.effort) // joints
        plan = Plan(
            method=message.method,
            joint_names=tuple(message.joint_names),
            start=float(message.start),
            period=float(message.period),
            position=rows("position", ticks + 1),
            velocity=rows("velocity", ticks + 1),
            effort=np.array(message.effort, dtype=np.float64).reshape(ticks, joints),
            state=rows("state", ticks + 1),
            duration=float(message.duration),
            gains=rows("gains", ticks + 1) if len(getattr(message, "gains", ())) else _NO_GAINS,
            **{name: text(name) for name in YAML_FIELDS},
        )
        if plan.position.shape[1] != joints or plan.velocity.shape[1] != joints:
            raise ValueError("its references are not one per joint")
        found = plan_hash(plan)
    except (ValueError, TypeError) as error:
        raise BadInput(f"the plan is damaged: {error}", source) from None
    if found != message.hash:
        raise BadInput("the plan is damaged: its hash does not fit its content", source)
    return plan
