"""Changes of a controller's settings while it works: `<name>/tune`, and its ROS parameters."""

import sys
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor, wait
from typing import Any, TypeVar

from flexslew_msgs import srv
from rclpy.node import Node
from rclpy.parameter import Parameter

from flexslew_control.controllers import CONTROLLERS, CommonSettings, law_values, with_file
from flexslew_control.controllers.host import ControllerHost
from flexslew_plant.bench.due_ticks import requested_tick
from flexslew_plant.errors import BadInput
from flexslew_plant.graph import topics
from flexslew_plant.keys.settings_fields import describe_fields
from flexslew_plant.ros.messages import seconds_of
from flexslew_plant.ros.offers import service
from flexslew_plant.ros.parameters import declare, handle_changes, requested_text
from flexslew_plant.settings import flat, validated
from flexslew_plant.yaml_data import load_yaml

_SHARE = 2e-4  # for which one of two threads works before the other one may [wall s]
_Made = TypeVar("_Made")


class Tuning:
    """Passes requests on to the host, and keeps the parameters true.

    Args:
        node: node that offers the service.
        host: host of the controller.
        law: name of its law.
        answer_pending: answers a pending question; returns whether there was one.
        on_change: called after a change was granted, which may be due at a later tick.

    Raises:
        BadInput: if the settings are not those of the law.
    """

    def __init__(
        self,
        node: Node,
        host: ControllerHost,
        law: str,
        answer_pending: Callable[[], bool],
        on_change: Callable[[], None],
    ) -> None:
        self._node, self._host, self._answer_pending, self._law = node, host, answer_pending, law
        self._on_change = on_change
        self._is_setting = False  # what is set now has been granted already
        given = {k: v for k, v in host.values.items() if k in CommonSettings.__annotations__}
        common = validated(CommonSettings, given, f"node {host.name}")
        declare(node, common, describe_fields(common))
        if law in CONTROLLERS:
            law_settings = law_values(host.values)
            settings = validated(CONTROLLERS[law].settings, law_settings, f"node {host.name}")
            declare(node, settings, describe_fields(settings))
        service(node, srv.Tune, topics.TUNE, self._on_tune)
        handle_changes(node, self._set)

    def _set(self, changes: dict[str, Any]) -> str:
        """Take parameters; return why not, or an empty text."""
        if self._is_setting:
            return ""
        done = self._host.tune(changes, 0, "a ROS parameter", self._make_in_thread)
        if done.ok:
            self._on_change()
        return "" if done.ok else done.message

    def _on_tune(self, request: Any, reply: Any) -> Any:
        controller = self._host.controller
        try:
            text = requested_text(self._node, "settings", request.settings, request.values)
            changes = load_yaml(text, "settings") or {}
            if isinstance(changes, dict):
                changes = with_file(self._law, changes, "settings")
        except BadInput as error:
            reply.message = str(error)
            return reply
        if not isinstance(changes, dict):
            reply.message = "settings: give YAML keys, for example {kp: [500.0, 500.0]}"
            return reply
        here, period = (controller.last_tick, controller.period) if controller else (0, 1.0)
        tick = requested_tick(seconds_of(request.at), period, here)
        done = self._host.tune(changes, tick, request.who, self._make_in_thread)
        reply.ok, reply.message, reply.tick = done.ok, done.message, done.tick
        if reply.ok:
            self._keep(changes)
            self._on_change()
        return reply

    def _make_in_thread(self, make: Callable[[], _Made]) -> _Made:
        """Return what is made in a thread, while this one answers the questions of the bench."""
        interval = sys.getswitchinterval()
        sys.setswitchinterval(_SHARE)
        try:
            with ThreadPoolExecutor(1) as pool:
                made = pool.submit(make)
                while not made.done():
                    if not self._answer_pending():
                        wait([made], _SHARE)
            return made.result()
        finally:
            sys.setswitchinterval(interval)

    def _keep(self, changes: dict[str, Any]) -> None:
        """Set the parameters to the values that hold from now on."""
        self._is_setting = True
        try:
            for name, value in flat(changes).items():
                if self._node.has_parameter(name):
                    self._node.set_parameters([Parameter(name, value=value)])
        finally:
            self._is_setting = False
