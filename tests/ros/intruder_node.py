"""A liar on `effort_command`: wrong sender, stale ticks, wrong sizes, no numbers; no messages."""

from array import array
from typing import Any

from flexslew_msgs import msg

from flexslew_plant.graph import topics
from flexslew_plant.ros.node_process import run_node
from flexslew_plant.ros.offers import publisher

from .guest import Guest


class Intruder(Guest):
    def __init__(self, loop: Any) -> None:
        super().__init__(loop, "intruder", self._lie)
        self._lies = publisher(self.node, topics.EFFORT_COMMAND)
        self._noisy: list[Any] = []

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
        if not self._noisy:  # before the flight it would be taken for another plant
            noisy = (topics.MEASUREMENT, topics.ALIVE, topics.CONTROLLER_STATUS)
            self._noisy = [self._lies, *(publisher(self.node, topic) for topic in noisy)]
        for topic in self._noisy:
            topic.publish(b"\x00\x01\x00\x00" + b"\xff" * 40)


def main() -> None:
    run_node(Intruder)
