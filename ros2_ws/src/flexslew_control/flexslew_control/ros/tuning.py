"""Changes of a controller's settings while it works: the service `<name>/tune`."""

from typing import Any

from flexslew_msgs import srv
from rclpy.node import Node

from flexslew_control.controllers.host import ControllerHost
from flexslew_plant import topics
from flexslew_plant.errors import BadInput
from flexslew_plant.ros.messages import seconds_of
from flexslew_plant.settings import load_yaml


class Tuning:
    """Passes wishes on to the host.

    Args:
        node: that offers the service.
        host: whose controller it is.
    """

    def __init__(self, node: Node, host: ControllerHost) -> None:
        self._host = host
        node.create_service(srv.Tune, topics.TUNE, self._on_tune)

    def _on_tune(self, request: Any, reply: Any) -> Any:
        controller = self._host.controller
        try:
            changes = load_yaml(request.settings, "settings") or {}
        except BadInput as error:
            reply.message = str(error)
            return reply
        if not isinstance(changes, dict):
            reply.message = "settings: give YAML keys, for example {kp: [500.0, 500.0]}"
            return reply
        tick = round(seconds_of(request.at) / controller.period) if controller else 0
        reply.ok, reply.message, reply.tick = self._host.tune(changes, tick, request.who)
        return reply
