"""Plans on their way to the controllers: published at once, or kept until somebody decides."""

from typing import Any

from flexslew_msgs import msg, srv
from rclpy.node import Node

from flexslew_control.message_fields import plan_fields
from flexslew_control.plan import Plan
from flexslew_control.ros.bench_clock import BenchClock
from flexslew_plant import topics
from flexslew_plant.events import (
    UNNAMED,
    PlanDrafted,
    PlanPublished,
    PlanRefused,
    event_of,
)
from flexslew_plant.refusal import Cause, Refusal
from flexslew_plant.ros.event_log import EventLog
from flexslew_plant.ros.messages import message_of, stamp
from flexslew_plant.ros.offers import publisher

ADOPT, REFUSE = "adopt", "refuse"
_Kind = type[PlanPublished] | type[PlanDrafted] | type[PlanRefused]


class PlanRelease:
    """Publishes plans on `plan`, latched; the newest draft waits for the service `decide_plan`.

    Args:
        node: of the planner.
    """

    def __init__(self, node: Node) -> None:
        self._draft: tuple[Plan, msg.Plan] | None = None
        self._clock = BenchClock(node)
        self._plan = publisher(node, topics.PLAN)
        self._events = EventLog(node)
        node.create_service(srv.Operate, topics.DECIDE_PLAN, self._on_decide)

    def publish(self, plan: Plan, who: str) -> msg.Plan:
        """Let the controllers follow a plan; return it as a message."""
        message = self._message(plan)
        self._plan.publish(message)
        self._tell(PlanPublished, plan, message, who)
        return message

    def keep(self, plan: Plan, who: str) -> msg.Plan:
        """Keep a draft in the place of the last one; return it as a message."""
        message = self._message(plan)
        self._draft = plan, message
        self._tell(PlanDrafted, plan, message, who)
        return message

    def _message(self, plan: Plan) -> msg.Plan:
        return message_of(msg.Plan, {"stamp": stamp(self._clock.now()), **plan_fields(plan)})

    def _tell(self, kind: _Kind, plan: Plan, message: msg.Plan, who: str) -> None:
        now, epoch = self._clock.now(), self._clock.epoch
        what = kind(message.hash, plan.method, plan.duration, who or UNNAMED)
        tick = round(now / plan.period)
        self._events.tell(event_of(what, tick, now, epoch, "planner"))

    def _on_decide(self, request: Any, reply: Any) -> Any:
        word, _, digest = request.action.partition(" ")
        refused = self._objection(word, digest)
        if refused is not None or self._draft is None:
            reply.message = str(refused or "")
            return reply
        plan, message = self._draft
        self._draft, reply.ok = None, True
        reply.tick = round(plan.start / plan.period)
        if word == ADOPT:
            self.publish(plan, request.who)
            reply.message = f"{plan.method}: flown from {plan.start:g} s on, tick {reply.tick}"
        else:
            self._tell(PlanRefused, plan, message, request.who)
            reply.message = f"{plan.method} from {plan.start:g} s on is dropped"
        return reply

    def _objection(self, word: str, digest: str) -> Refusal | None:
        """Return why a decision cannot be taken, or None."""
        if word not in (ADOPT, REFUSE):
            return Refusal(f"{ADOPT}, {REFUSE}", "action", word)
        if self._draft is None:
            words = "there is no draft to decide on; make one with draft_plan"
            return Refusal(words, cause=Cause.NO_PLAN)
        plan, message = self._draft
        if digest not in ("", message.hash):
            words = f"the draft is {message.hash[:12]} now, not {digest[:12]}"
            return Refusal(words, cause=Cause.UNKNOWN)
        now = self._clock.now()
        if word == ADOPT and plan.start <= now and now > 0.0:
            return Refusal(
                f"the draft starts at {plan.start:g} s, the bench is at {now:.2f} s; "
                "make one that starts later",
                cause=Cause.PAST,
            )
        return None
