"""What the nodes of the tests share that fly along in a run: they end with its plant."""

from collections.abc import Callable
from typing import Any

from flexslew_plant.bench.operation.presence import Heartbeats
from flexslew_plant.graph import topics
from flexslew_plant.ros.graph import PlantWatch
from flexslew_plant.ros.offers import subscription
from flexslew_plant.ros.parameters import new_node


class Guest:
    def __init__(self, loop: Any, name: str, hear: Callable[[Any], None]) -> None:
        self.node: Any = new_node(name)
        loop.add(self.node)
        subscription(self.node, topics.MEASUREMENT, hear)
        # which the plant alone publishes: a guest gives no ear to signs of life, and may speak on
        # `measurement` itself
        testbed = subscription(self.node, topics.TESTBED, lambda _: None)
        self._watch = PlantWatch(loop, self.node, testbed, Heartbeats(), True)

    def poll(self) -> float:
        self._watch.look()
        return 0.2

    def close(self) -> None:
        pass
