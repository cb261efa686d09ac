"""A node that DDS never lets go, as it happens when others leave at the same moment."""

import ctypes
from typing import Any

from flexslew_plant import topics
from flexslew_plant.ros.graph import PlantWatch
from flexslew_plant.ros.loop import run_node
from flexslew_plant.ros.offers import subscription
from flexslew_plant.ros.parameters import new_node


class Stuck:
    def __init__(self, loop: Any) -> None:
        self.node: Any = new_node("stuck")
        loop.add(self.node)
        self._watch = PlantWatch(loop, subscription(self.node, topics.MEASUREMENT, print), True)
        self.node.destroy_node = ctypes.PyDLL(None).pause  # holds up all of Python

    def poll(self) -> float:
        self._watch.look()
        return 0.2

    def close(self) -> None:
        pass


def main() -> None:
    run_node(Stuck)
