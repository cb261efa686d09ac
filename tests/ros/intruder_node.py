"""A liar on `effort_command`: wrong sender, stale ticks, wrong sizes, no numbers."""

from array import array
from typing import Any

from flexslew_msgs import msg

from flexslew_plant import topics
from flexslew_plant.ros.graph import PlantWatch
from flexslew_plant.ros.loop import run_node
from flexslew_plant.ros.offers import publisher, subscription
from flexslew_plant.ros.parameters import new_node


class Intruder:
    def __init__(self, loop: Any) -> None:
        self.node = new_node("intruder")
        loop.add(self.node)
        self._lies = publisher(self.node, topics.EFFORT_COMMAND)
        heard = subscription(self.node, topics.MEASUREMENT, self._lie)
        self._watch = PlantWatch(loop, heard, True)

    def _lie(self, question: Any) -> None:
        if question.tick % 20:
            return
        common = {"stamp": question.header.stamp, "epoch": question.epoch}
        asked = {"controller": question.controller, **common}
        effort = array("d", [1e3, 1e3])
        for lie in (
            msg.EffortCommand(tick=question.tick, controller="x", effort=effort, **common),
            msg.EffortCommand(tick=question.tick + 7, effort=effort, **asked),
            msg.EffortCommand(tick=question.tick, effort=effort[:1], **asked),
            msg.EffortCommand(tick=question.tick, effort=array("d", [float("nan")] * 2), **asked),
        ):
            self._lies.publish(lie)

    def poll(self) -> float:
        self._watch.look()
        return 0.2

    def close(self) -> None:
        pass


def main() -> None:
    run_node(Intruder)
