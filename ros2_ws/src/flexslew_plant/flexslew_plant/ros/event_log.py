"""Events of a node: on the topic for programs, in its log for people."""

from rclpy.node import Node

from flexslew_plant.events import AnswerMissing, Event, Level, is_reported
from flexslew_plant.graph import topics
from flexslew_plant.refusal import one_line
from flexslew_plant.ros.messages import event_message
from flexslew_plant.ros.offers import publisher
from flexslew_plant.ros.outlet import DirectPublisher
from flexslew_plant.ros.outlets import DirectPublishers


class EventLog:
    """Publishes events and logs them.

    Args:
        node: node that publishes the events.
        direct_publishers: outlets of the node, if the recorder has its own line to them.
    """

    def __init__(self, node: Node, direct_publishers: DirectPublishers | None = None) -> None:
        event_publisher = (
            direct_publishers.publisher(topics.EVENTS)
            if direct_publishers
            else DirectPublisher(publisher(node, topics.EVENTS))
        )
        self._publisher, self._logger = event_publisher, node.get_logger()

    def tell(self, event: Event) -> None:
        """Publish an event, and log it; of many missed ticks in a row the log has a few."""
        self._publisher.keep(event_message(event))
        if isinstance(event.what, AnswerMissing) and not is_reported(event.what.in_a_row):
            return
        words = one_line(f"t = {event.time:.2f} s: {event.message}")  # operators may write any
        # rclpy ties a severity to the line of the call
        if event.level == Level.INFO:
            self._logger.info(words)
        elif event.level == Level.WARNING:
            self._logger.warning(words)
        else:
            self._logger.error(words)
