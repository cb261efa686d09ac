"""Plans as trajectory_msgs/JointTrajectory, and trajectories as requests to a planner."""

from typing import Any

import numpy as np
from rclpy.duration import Duration
from trajectory_msgs.msg import JointTrajectory, JointTrajectoryPoint

from flexslew_control.plan import Plan
from flexslew_plant.errors import BadInput
from flexslew_plant.ros.messages import seconds_of, stamp

METHOD = "joint_trajectory"  # of planners
MOST_POINTS = 5_000  # of a plan as a trajectory; of a longer one only every second tick, third, ...
_KEYS = {
    "position": "positions",
    "velocity": "velocities",
    "acceleration": "accelerations",
    "effort": "effort",
}


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


def trajectory_section(message: JointTrajectory, start: float) -> dict[str, Any]:
    """Return the `plan` section of the request that a trajectory makes.

    Args:
        message: the trajectory.
        start: earliest start, of a trajectory with a stamp of zero [s].

    Raises:
        BadInput: if no joint is named, or one twice, or a point has numbers for others.
    """
    names = list(message.joint_names)
    if not names or len({*names}) < len(names):
        raise BadInput("one joint or more, each once", METHOD, "joint_names", names)
    start_time = seconds_of(message.header.stamp)
    points = []
    for k, point in enumerate(message.points):
        values: dict[str, Any] = {"at": seconds_of(point.time_from_start)}
        for key, field in _KEYS.items():
            given = getattr(point, field).tolist()
            if given and len(given) != len(names):
                words = f"one number for each of joint_names, {', '.join(names)}"
                raise BadInput(words, METHOD, f"points.{k}.{field}", given)
            values[key] = dict(zip(names, given, strict=False))
        points.append(values)
    return {"method": METHOD, "start": start_time or start, "points": points}
