"""Coroutines of a node that are resumed when what they wait for is there, and not before.

The executor of rclpy resumes a coroutine that waits at every turn of its loop. With one a node
takes a whole processor, in a paced run at real-time priority: two such plants on two processors
leave nothing to their recorders and controllers.
"""

from collections.abc import Callable, Coroutine, Generator
from typing import Any

from rclpy.action import ActionServer
from rclpy.action.server import ServerGoalHandle
from rclpy.task import Future


class PendingResult(Future):  # type: ignore[misc]
    """A result that coroutines of `start` may await; see Loop.future."""

    def __await__(self) -> Generator[Any, None, Any]:
        if not self.done():
            yield self
        return self.result()


def start(
    coroutine: Coroutine[Any, None, Any], finish: Callable[[Any], None] = lambda result: None
) -> None:
    """Run a coroutine up to its next wait for a PendingResult, which goes on with it.

    Args:
        coroutine: awaits nothing else.
        finish: takes what it returns.
    """
    try:
        awaited = coroutine.send(None)
    except StopIteration as end:
        finish(end.value)
    else:
        awaited.add_done_callback(lambda _: start(coroutine, finish))


class CoroutineActionServer(ActionServer):  # type: ignore[misc]
    """An action server whose execution is a coroutine of `start`."""

    def notify_execute(
        self, goal_handle: ServerGoalHandle, execute_callback: Callable[..., Any] | None
    ) -> None:
        """Execute a goal that was accepted, as rclpy calls this."""
        execute = execute_callback or self._execute_callback
        start(self._execute_goal(execute, goal_handle))
