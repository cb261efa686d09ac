"""Trajectories of others as points of a plan: JointTrajectory messages and files that hold one."""

from collections.abc import Iterable, Mapping, Sequence
from typing import Any, TypeAlias

from flexslew_plant.errors import BadInput
from flexslew_plant.named_file import data_of_file
from flexslew_plant.own_code import Trust

# of a plan's points, and of trajectory_msgs/JointTrajectoryPoint
QUANTITIES = {
    "position": "positions",
    "velocity": "velocities",
    "acceleration": "accelerations",
    "effort": "effort",
}
_TIME = "time_from_start"
_Row: TypeAlias = tuple[float, Mapping[str, Sequence[float]]]


def points_of(joint_names: Sequence[str], rows: Iterable[_Row], key: str) -> list[dict[str, Any]]:
    """Return the points of a JointTrajectory as a plan has them.

    Args:
        joint_names: of the message.
        rows: time after the start [s] and numbers by field of the message.
        key: of the trajectory, for an error.

    Raises:
        BadInput: no joint is named, or one twice, or a point has numbers for others.
    """
    names = list(joint_names)
    if not names or len({*names}) < len(names):
        raise BadInput("one joint or more, each once", key, "joint_names", names)
    points = []
    for k, (at, numbers) in enumerate(rows):
        values: dict[str, Any] = {"at": at}
        for quantity, field in QUANTITIES.items():
            given = list(numbers.get(field) or ())
            if given and len(given) != len(names):
                words = f"one number for each of joint_names, {', '.join(names)}"
                raise BadInput(words, key, f"points.{k}.{field}", given)
            values[quantity] = dict(zip(names, given, strict=False))
        points.append(values)
    return points


def points_of_file(path: str, source: str, trust: Trust) -> list[dict[str, Any]]:
    """Return the points of a trajectory in a YAML or JSON file.

    It holds a trajectory_msgs/JointTrajectory as `ros2 topic echo` prints it, or a list of points
    as joint_trajectory has them.

    Args:
        path: of the file.
        source: place of its name, for an error.
        trust: whether files may be read.

    Raises:
        Untrusted: if a log names the file.
        BadInput: the file cannot be read, or holds no trajectory.
    """
    place = f"{source}: trajectory: {path}"
    given = data_of_file(path, f"{source}: trajectory", trust)
    if isinstance(given, list):
        return given
    if not isinstance(given, dict) or not isinstance(given.get("points"), list):
        words = "holds no trajectory: joint_names and points, or a list of points"
        raise BadInput(words, place)
    if "joint_names" not in given:
        points: list[dict[str, Any]] = given["points"]
        return points
    names = given["joint_names"]
    if not isinstance(names, list) or not all(isinstance(name, str) for name in names):
        raise BadInput("a list of names", place, "joint_names", names)
    return points_of(
        names, [_row(k, point, place) for k, point in enumerate(given["points"])], place
    )


def _row(k: int, point: Any, place: str) -> tuple[float, dict[str, Any]]:
    """Return time and numbers of a point of a message in YAML."""
    known = (*QUANTITIES.values(), _TIME)
    if not isinstance(point, dict) or not {*point} <= {*known}:
        raise BadInput(f"allowed keys: {', '.join(known)}", place, f"points.{k}", point)
    for field in QUANTITIES.values():
        if not isinstance(point.get(field) or [], list):
            raise BadInput("a list of numbers", place, f"points.{k}.{field}", point[field])
    at = point.get(_TIME)
    if isinstance(at, dict) and {*at} <= {"sec", "nanosec"}:
        at = at.get("sec", 0) + 1e-9 * at.get("nanosec", 0)
    if not isinstance(at, int | float):
        words = "seconds, or {sec: ..., nanosec: ...}"
        raise BadInput(words, place, f"points.{k}.{_TIME}", at)
    return float(at), point
