"""Plans as trajectory_msgs/JointTrajectory, and trajectories as requests to a planner."""

from collections.abc import Mapping
from typing import Any

import numpy as np
from rclpy.duration import Duration
from trajectory_msgs.msg import JointTrajectory, JointTrajectoryPoint

from flexslew_control.plan import Plan
from flexslew_control.planners.input_shaping.section import InputShaping
from flexslew_control.planners.trajectory_file import QUANTITIES, points_of
from flexslew_plant.ros.messages import seconds_of, stamp

METHOD = "joint_trajectory"  # of planners
MOST_POINTS = 5_000  # of a plan as a trajectory; of a longer one only every second tick, third, ...


def trajectory_message(plan: Plan) -> JointTrajectory:
    """Return a plan as a trajectory: its references, and its feedforward as efforts.

    The header's stamp is its start; the effort of a point holds over the tick that begins there,
    and is zero at the last one.
    """
    message = JointTrajectory(joint_names=list(plan.joint_names))
    message.header.stamp = stamp(plan.start)
    efforts = np.vstack((plan.effort, np.zeros(plan.effort.shape[1])))
    every = -(-plan.ticks // MOST_POINTS) or 1
    rows = sorted({*range(0, plan.ticks, every), plan.ticks})
    message.points = [
        JointTrajectoryPoint(
            positions=plan.position[k].tolist(),
            velocities=plan.velocity[k].tolist(),
            effort=efforts[k].tolist(),
            time_from_start=Duration(nanoseconds=round(1e9 * plan.period * k)).to_msg(),
        )
        for k in rows
    ]
    return message


def trajectory_section(
    message: JointTrajectory, start: float, shaping: Mapping[str, Any] | None = None
) -> dict[str, Any]:
    """Return the `plan` section of the request that a trajectory makes.

    Args:
        message: the trajectory.
        start: earliest start, of a trajectory with a stamp of zero [s].
        shaping: keys of input_shaping with which it is shaped; None or empty: it is not.

    Raises:
        BadInput: if no joint is named, or one twice, or a point has numbers for others.
    """
    start_time = seconds_of(message.header.stamp)
    rows = [
        (
            seconds_of(point.time_from_start),
            {field: getattr(point, field).tolist() for field in QUANTITIES.values()},
        )
        for point in message.points
    ]
    points = points_of(message.joint_names, rows, METHOD)
    begin = {"start": start_time or start}
    if shaping:
        return {**shaping, **begin, "method": InputShaping.method, "trajectory": points}
    return {**begin, "method": METHOD, "points": points}
