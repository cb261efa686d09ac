"""What every node does once in its life, done once for all in the process they are forked from."""

import inspect

import numba.core.registry
from rcl_interfaces.msg import ParameterEvent
from rclpy.type_support import check_for_type_support

from flexslew_lab.log.messages.schemas import store
from flexslew_plant.graph.topics import TOPICS
from flexslew_plant.keys.settings_fields import describe_fields
from flexslew_plant.message_types import fields
from flexslew_plant.ros.plant.settings import PlantSettings


def before_fork() -> None:
    """Load what the first parameter, message, kernel and line of a log need; see fork_server."""
    describe_fields(PlantSettings())
    store()
    for topic in TOPICS.values():
        fields(topic.type)
    check_for_type_support(ParameterEvent)
    numba.core.registry.cpu_target.target_context.refresh()
    inspect.getmodule(inspect.currentframe())  # rclpy searches all modules for the caller of a log
