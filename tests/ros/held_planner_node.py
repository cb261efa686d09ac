"""The planner, whose actions DDS never lets go: others leave at the same moment."""

import ctypes

from rclpy.action import ActionServer

from flexslew_control.ros.planner_node import main

ActionServer.destroy = lambda self: ctypes.PyDLL(None).pause()  # holds up all of Python

if __name__ == "__main__":
    main()
