"""The parameters of the plant that may change at run time."""

from time import monotonic
from typing import Any

from rclpy.node import Node

from flexslew_plant.bench.operation.session import Session
from flexslew_plant.errors import BadInput
from flexslew_plant.ros.loop import Loop
from flexslew_plant.ros.parameters import handle_changes
from flexslew_plant.ros.plant.display import Display
from flexslew_plant.ros.plant.settings import PlantSettings
from flexslew_plant.settings import validated

DYNAMIC_PARAMETERS = ("rate_factor", "display_rate")


class PlantParameters:
    """Applies changes of the plant's parameters.

    Args:
        node: node with the parameters.
        session: session with the changeable pace.
        display: display with the changeable rate.
        loop: loop that serves the node.
    """

    def __init__(self, node: Node, session: Session, display: Display, loop: Loop) -> None:
        self._session, self._display, self._loop = session, display, loop
        self._name = node.get_name()
        handle_changes(node, self._change)

    def _change(self, changes: dict[str, Any]) -> str:
        """Apply parameters in flight; return why that is not possible, or an empty text."""
        try:
            validated(PlantSettings, changes, f"node {self._name}")
        except BadInput as error:
            return str(error)
        rate = changes.get("rate_factor", self._session.tick_timer.rate_factor)
        if rate != self._session.tick_timer.rate_factor:
            reply = self._session.set_rate(rate, monotonic(), "a ROS parameter")
            if not reply.ok:
                return reply.message
        if "display_rate" in changes:
            self._display.set_rate(changes["display_rate"])
        self._loop.hurry()
        return ""
