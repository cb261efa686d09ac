"""The motion of the bench while a plan is made, as it is displayed."""

from collections.abc import Callable
from time import monotonic
from typing import Any

import numpy as np
from flexslew_msgs.msg import AppendageState
from rclpy.node import Node
from sensor_msgs.msg import JointState

from flexslew_control.plan import Plan
from flexslew_control.plan_service.job import motion_request
from flexslew_control.plan_service.planning import MotionRequest, PlanRequest
from flexslew_control.plans.known_motion import PREDICTED, KnownMotion, with_tip_motion
from flexslew_plant.graph import topics
from flexslew_plant.ros.messages import seconds_of
from flexslew_plant.ros.offers import subscription

_PATIENCE = 0.5  # for the first display [wall s]


class MotionWatch:
    """Receives the display of joints and appendages from its construction until `end`.

    A bench that pauses displays its state once more for a new subscription; one without a display
    publishes none.

    Args:
        node: of the planner.
        before: returns a plan preceded by the references from an earlier tick on.
    """

    def __init__(self, node: Node, before: Callable[[Plan, int], Plan]) -> None:
        self._node, self._before = node, before
        self._until = monotonic() + _PATIENCE
        self._max_deflection = 0.0  # largest tip deflection [m]
        self._joints: JointState | None = None
        self._appendages: AppendageState | None = None
        self._latest: tuple[JointState, AppendageState] | None = None  # the newest of one time
        self._subscriptions: list[Any] = [
            subscription(node, topics.JOINT_STATES, self._take_joints),
            subscription(node, topics.APPENDAGE_STATES, self._take_appendages),
        ]

    def end(self) -> None:
        """Receive no more."""
        for each in self._subscriptions:
            self._node.destroy_subscription(each)
        self._subscriptions.clear()

    def required(self, plan: Plan, request: PlanRequest) -> MotionRequest | Plan | None:
        """Return what the prediction of a plan from the motion requires; see PlanJob."""
        if PREDICTED not in plan.summary:
            return plan
        motion = self._motion(plan.period)
        if motion is None:
            return plan if monotonic() > self._until else None
        return motion_request(plan, request, motion, self._before)

    def included(self, plan: Plan) -> Plan:
        """Return a plan with a bound that includes the swing; see with_tip_motion."""
        return with_tip_motion(plan, self._max_deflection)

    def _motion(self, period: float) -> KnownMotion | None:
        """Return the newest state that was displayed; None: none was."""
        if self._latest is None:
            return None
        joints, appendages = self._latest
        values = zip(joints.name, joints.position, joints.velocity, strict=True)
        return KnownMotion(
            round(seconds_of(appendages.header.stamp) / period),
            {name: (position, velocity) for name, position, velocity in values},
            np.array(appendages.modal_position),
            np.array(appendages.modal_velocity),
            np.array([*appendages.tip_deflection, *appendages.tip_velocity]),
        )

    def _take_joints(self, state: JointState) -> None:
        self._joints = state
        self._pair()

    def _take_appendages(self, state: AppendageState) -> None:
        self._max_deflection = max(self._max_deflection, *map(abs, state.tip_deflection), 0.0)
        self._appendages = state
        self._pair()

    def _pair(self) -> None:
        joints, appendages = self._joints, self._appendages
        if joints is None or appendages is None:
            return
        if joints.header.stamp == appendages.header.stamp:
            self._latest = joints, appendages
