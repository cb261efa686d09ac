"""A controller that is queried over DDS alone, as one of another machine or user."""

import os
from functools import partial

from flexslew_control.controllers import DEFAULT
from flexslew_control.ros.controller_node import ControllerNode
from flexslew_plant.direct.names import SETTING
from flexslew_plant.ros.node_process import run_node


def main() -> None:
    os.environ[SETTING] = "dds"
    run_node(partial(ControllerNode, DEFAULT))
