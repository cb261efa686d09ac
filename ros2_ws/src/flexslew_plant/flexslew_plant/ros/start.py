"""The first step of every process that joins the graph: who may reach it, then rclpy.init."""

import os
from typing import Any

import rclpy

from flexslew_plant.errors import BadInput
from flexslew_plant.network import SETTING, on_network, prepare, tell
from flexslew_plant.ros.loop import SUPERVISOR

MIDDLEWARES = ("rmw_fastrtps_cpp", "rmw_fastrtps_dynamic_cpp")  # those that read the profiles


def start_ros(**how: Any) -> None:
    """Initialise ROS where only those may reach it who are meant to.

    Args:
        how: for rclpy.init.

    Raises:
        BadInput: see network.prepare; the middleware is none that stays on the loopback; or the
            command line cannot be read.
    """
    prepare(os.environ)
    middleware = rclpy.get_rmw_implementation_identifier()
    if not on_network(os.environ) and middleware not in MIDDLEWARES:
        raise BadInput(
            f"RMW_IMPLEMENTATION: {middleware} does not stay on this machine; set it to "
            f"{MIDDLEWARES[0]}, or {SETTING}=1 for the network"
        )
    if SUPERVISOR not in os.environ:  # the process that started this one has told it
        tell()
    try:
        rclpy.init(**how)
    except RuntimeError as error:
        raise BadInput(
            f"--ros-args: {error}; a parameter that is YAML itself is a text: NAME:=\"'{{...}}'\""
        ) from None
