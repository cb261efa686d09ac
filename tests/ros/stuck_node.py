"""A node that DDS never lets go, as it happens when others leave at the same moment."""

import ctypes
from typing import Any

from flexslew_plant.ros.node_process import run_node

from .guest import Guest


class Stuck(Guest):
    def __init__(self, loop: Any) -> None:
        super().__init__(loop, "stuck", print)
        self.node.destroy_node = ctypes.PyDLL(None).pause  # holds up all of Python


def main() -> None:
    run_node(Stuck)
