"""The statuses of recorders, for which a plant waits that is as fast as possible."""

from time import monotonic

from rclpy.node import Node

from flexslew_plant.bench.operation.session import Session
from flexslew_plant.bench.wire import recorder_status_from
from flexslew_plant.errors import BadInput
from flexslew_plant.graph import topics
from flexslew_plant.ros.loop import Loop
from flexslew_plant.ros.offers import subscription
from flexslew_plant.ros.outlets import DirectPublishers


class RecorderLink:
    """Passes the progress of recorders to the session, from a line or over DDS.

    Args:
        node: the plant.
        direct: outlets of the node, which have the line to the recorder.
        session: session that waits for the recorder.
        loop: loop that serves the node.
    """

    def __init__(self, node: Node, direct: DirectPublishers, session: Session, loop: Loop) -> None:
        self._direct, self._session, self._loop = direct, session, loop
        direct.on_status = self._receive
        subscription(node, topics.RECORDER_STATUS, self._receive, raw=True)

    def wait(self) -> bool:
        """Wait on the line for a moment if the next tick waits for a node; return whether it did.

        The executor would not return for a status that comes on the line.
        """
        session = self._session
        held = session.run.running and session.bench.answered and not session.tick_timer.paced
        return held and self._direct.wait_for_status()

    def _receive(self, data: bytes) -> None:
        try:
            status = recorder_status_from(data)
        except BadInput:
            return  # of no recorder of this bench
        if self._session.heartbeats.counts(status.recorder, status.instance, monotonic()):
            progress = self._session.node_progress
            progress.received(status.recorder, status.tick, status.epoch, recorder=True)
        self._loop.hurry()  # the bench may wait for just this
