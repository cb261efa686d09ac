"""The swing of the appendages while a plan is made, which its prediction does not contain."""

from typing import Any

from flexslew_msgs.msg import AppendageState
from rclpy.node import Node

from flexslew_plant.graph import topics
from flexslew_plant.ros.offers import subscription


class SwingWatch:
    """Receives the displayed deflections from its construction until `end`.

    A bench that rests, or displays nothing, publishes none.

    Args:
        node: of the planner.
    """

    def __init__(self, node: Node) -> None:
        self._node, self._largest = node, 0.0
        self._subscription: Any = subscription(node, topics.APPENDAGE_STATES, self._take)

    def end(self) -> float:
        """Return the largest magnitude of a tip's deflection [m], and receive no more."""
        self._node.destroy_subscription(self._subscription)
        return self._largest

    def _take(self, state: AppendageState) -> None:
        self._largest = max(self._largest, *map(abs, state.tip_deflection), 0.0)
