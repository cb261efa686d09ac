"""The first step of every process that joins the graph: limit its reach, then rclpy.init."""

import os
import sys
from pathlib import Path
from typing import Any

import rclpy
from rclpy.impl.implementation_singleton import rclpy_implementation

from flexslew_plant.errors import BadInput
from flexslew_plant.network import SETTING, on_network, prepare, report_network
from flexslew_plant.ros.loop import SUPERVISOR

MIDDLEWARES = ("rmw_fastrtps_cpp", "rmw_fastrtps_dynamic_cpp")  # those that read the profiles


_WITHOUT_LOG = ("--ros-args", "--disable-external-lib-logs")


def start_ros(**how: Any) -> None:
    """Initialise ROS so that only the intended hosts can reach it.

    A process without a writable log folder has no log file of ROS.

    Args:
        how: arguments of rclpy.init.

    Raises:
        BadInput: see network.prepare; if the middleware does not stay on the loopback; or if the
            command line is not one of ROS.
    """
    prepare(os.environ)
    middleware = rclpy.get_rmw_implementation_identifier()
    if not on_network(os.environ) and middleware not in MIDDLEWARES:
        raise BadInput(
            f"RMW_IMPLEMENTATION: {middleware} does not stay on this machine; set it to "
            f"{MIDDLEWARES[0]}, or {SETTING}=1 for the network"
        )
    if SUPERVISOR not in os.environ:  # else the process that started this one has printed it
        report_network()
    if not _can_write_log():
        how["args"] = [*(sys.argv if how.get("args") is None else how["args"]), *_WITHOUT_LOG]
    try:
        rclpy.init(**how)
    except rclpy_implementation.RCLError as error:
        hint = "; a value that is YAML stands in quotes of its own: -p plan:=\"'{goal: ...}'\""
        given = any(":={" in argument for argument in how.get("args") or sys.argv)
        raise BadInput(f"{error}{hint * given}") from None


def _can_write_log() -> bool:
    """Return whether ROS can write its log: ROS_LOG_DIR, else `log` in ROS_HOME or ~/.ros."""
    home = os.environ.get("ROS_HOME") or os.path.join(os.environ.get("HOME", ""), ".ros")
    folder = Path(os.environ.get("ROS_LOG_DIR") or os.path.join(home, "log")).expanduser()
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError:
        return False
    return os.access(folder, os.W_OK | os.X_OK)
