"""One plan at a time, made beside the node that is asked for it."""

from collections.abc import Callable
from typing import TypeAlias

from flexslew_msgs import action
from rclpy.action.server import ServerGoalHandle

from flexslew_control.plan import Plan
from flexslew_control.planning import Iteration, Planning, PlanRequest
from flexslew_control.ros.plan_result import CANCELED
from flexslew_plant.refusal import Refusal
from flexslew_plant.ros.loop import Loop

Outcome: TypeAlias = Plan | Refusal


class PlanJob:
    """Whoever asks is told what comes of it, by a call.

    Args:
        loop: that serves the node.
        soon: a request will come, so the planning process makes its imports now.
    """

    def __init__(self, loop: Loop, soon: bool) -> None:
        self._loop, self._planning = loop, Planning(soon)
        self._goal: ServerGoalHandle | None = None  # that is planned for; None: no action's
        self._heard: Callable[[Outcome], None] | None = None  # takes what comes of the plan

    @property
    def busy(self) -> bool:
        """Whether a plan is under way."""
        return self._heard is not None

    def ask(
        self,
        request: PlanRequest | Refusal,
        heard: Callable[[Outcome], None],
        goal: ServerGoalHandle | None = None,
    ) -> None:
        """Begin to plan.

        Args:
            request: what is asked for; a refusal comes back as it is.
            heard: takes what comes of it.
            goal: that is told of every iteration, and may be canceled.
        """
        self._goal, self._heard = goal, heard
        if isinstance(request, Refusal):
            self._take(request)
        else:
            self._planning.ask(request)
        self._loop.hurry()

    def poll(self) -> None:
        """Take what has come, and cancel what its client does not want any more."""
        for news in self._planning.news():
            self._take(news)
        if self.busy and self._goal is not None and self._goal.is_cancel_requested:
            self._planning.cancel()
            self._take(CANCELED)

    def close(self) -> None:
        """End the process that plans."""
        self._planning.close()

    def _take(self, news: Iteration | Outcome) -> None:
        if isinstance(news, Iteration):
            if self._goal is not None:
                values = news._asdict()
                number = values.pop("number")
                self._goal.publish_feedback(action.PlanSlew.Feedback(iteration=number, **values))
            return
        heard, self._heard = self._heard, None
        if heard is not None:
            heard(news)
