"""The planner, whose actions DDS never lets go: others leave at the same moment."""

import ctypes

from rclpy.action import ActionServer

from flexslew_control.ros.planner_node import Planner
from flexslew_plant.ros.node_process import run_node

ActionServer.destroy = lambda self: ctypes.PyDLL(None).pause()  # holds up all of Python


class HeldPlanner(Planner):
    """Says in a line when it serves: the graph names an action before it was built."""

    def poll(self) -> float:
        """Say it each time, and go on."""
        print("serves", flush=True)
        return super().poll()


if __name__ == "__main__":
    run_node(HeldPlanner)
