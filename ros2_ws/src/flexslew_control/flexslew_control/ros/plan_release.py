"""Plans on their way to the controllers over ROS: topics, and the service for decisions."""

from collections.abc import Sequence
from typing import Any

from flexslew_msgs import srv
from rclpy.node import Node

from flexslew_control.active_laws import ActiveLaws
from flexslew_control.law import ActiveLaw
from flexslew_control.plan_service.release import PlanRelease, decided
from flexslew_control.ros.bench_clock import BenchClock
from flexslew_control.ros.controller_answers import ControllerResponses
from flexslew_control.ros.plan_offers import PlanPublisher
from flexslew_plant.graph import topics
from flexslew_plant.own_code import Trust
from flexslew_plant.refusal import Refusal
from flexslew_plant.ros.alive import Alive
from flexslew_plant.ros.event_log import EventLog
from flexslew_plant.ros.loop import Loop
from flexslew_plant.ros.offers import service


class NodePlanRelease(PlanRelease):
    """Publishes plans on `plan`, latched; the newest draft waits for the service `decide_plan`.

    Args:
        node: of the planner.
        loop: that serves it.
        alive: signs of life of the controllers.
        trust: classes of the user's own that testbed and requests may name.
        law: of the controller that is active first, until its status comes; None: not known.
    """

    clock: BenchClock
    responses: ControllerResponses

    def __init__(
        self,
        node: Node,
        loop: Loop,
        alive: Alive,
        trust: Sequence[str],
        law: ActiveLaw | None = None,
    ) -> None:
        laws = ActiveLaws(law)
        clock = BenchClock(node, self.restart, lambda s: laws.take_state(s.active, s.tick, s.epoch))
        responses = ControllerResponses(node, loop, alive.heartbeats, self.on_rejection, laws)
        publisher, events = PlanPublisher(node), EventLog(node)
        super().__init__(clock, publisher, responses, events.tell, Trust.of(trust), laws)
        service(node, srv.Operate, topics.DECIDE_PLAN, self._on_decide)

    async def _on_decide(self, request: Any, reply: Any) -> Any:
        decision = self.decide(request.action, request.who)
        if isinstance(decision, Refusal):
            reply.message = str(decision)
            return reply
        response = None
        if decision.adopted:
            response = await self.responses.response_future(decision.digest)
        reply.ok = response is None or not (response.refused or response.inactive)
        reply.message, reply.tick = decided(decision, response), decision.plan.first_tick
        return reply
