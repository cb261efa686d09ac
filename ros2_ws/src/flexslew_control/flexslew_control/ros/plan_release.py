"""Plans on their way to the controllers: published at once, or kept until somebody decides."""

import json
from collections.abc import Sequence
from contextlib import suppress
from math import ceil
from time import monotonic
from typing import Any, NamedTuple

from flexslew_msgs import msg, srv
from rclpy.node import Node
from rclpy.task import Future

from flexslew_control.law import ActiveLaw, described
from flexslew_control.message_fields import plan_fields
from flexslew_control.plan import Plan
from flexslew_control.plan_file import plan_hash
from flexslew_control.planned_course import PATIENCE, PlanAnswers, PlannedCourse
from flexslew_control.planning import PlanRequest, plan_request
from flexslew_control.ros.bench_clock import BenchClock
from flexslew_control.ros.trajectories import trajectory_message
from flexslew_plant import topics
from flexslew_plant.errors import BadInput
from flexslew_plant.events import (
    UNNAMED,
    PlanDrafted,
    PlanPublished,
    PlanRefused,
    StrayMessage,
    event_of,
    fact_of,
)
from flexslew_plant.own_code import Trust
from flexslew_plant.refusal import NO_TESTBED, Cause, Refusal
from flexslew_plant.ros.alive import Alive
from flexslew_plant.ros.event_log import EventLog
from flexslew_plant.ros.loop import Loop
from flexslew_plant.ros.messages import message_of, stamp
from flexslew_plant.ros.offers import publisher, service, subscription
from flexslew_plant.ros.parameters import serve_changes
from flexslew_plant.testbeds import read_testbed
from flexslew_plant.testbeds.attitude import AttitudeJoints
from flexslew_plant.yaml_data import load_yaml

START_MARGIN = 1.0  # until a plan that is asked for now can begin [wall s]
ADOPT, REFUSE = "adopt", "refuse"
MODEL = "model"  # the parameter of the node that may be set at run time
Gains = tuple[tuple[float, ...], tuple[float, ...]]  # kp and kd, of the one in charge
_Kind = type[PlanPublished] | type[PlanDrafted] | type[PlanRefused]


class _Pending(NamedTuple):
    """A plan whose answers somebody waits for."""

    digest: str
    deadline: float  # [wall s]
    future: Future


class PlanRelease:
    """Publishes plans on `plan`, latched; the newest draft waits for the service `decide_plan`.

    Args:
        node: of the planner.
        loop: that serves it.
        alive: signs of life of the controllers.
        gains: of the controller in charge, if it has such gains.
        trust: classes of the user's own that testbed and requests may name.
        law: of the controller in charge, if it is known.
    """

    def __init__(
        self,
        node: Node,
        loop: Loop,
        alive: Alive,
        gains: Gains,
        trust: Sequence[str],
        law: ActiveLaw | None = None,
    ) -> None:
        self._node, self._trust, self._law = node, Trust.of(trust), law
        self._loop, self._alive, self._gains = loop, alive, gains
        self._believed: dict[str, Any] | None = None  # a testbed's section; None: as each request
        self._draft: tuple[Plan, msg.Plan, int | None] | None = None  # the flight that it is of
        self._course: PlannedCourse | None = None
        self._told: Plan | None = None  # what those hear last who come now
        self._testbed = msg.Testbed()
        self._attitude: AttitudeJoints | None = None  # of the testbed
        self._stray = False  # a strange message was told of
        self._answers, self._pending = PlanAnswers(), list[_Pending]()
        self._clock = BenchClock(node, self._begin_again)
        self._offers = {n: publisher(node, n) for n in (topics.PLAN, topics.PLANNED_TRAJECTORY)}
        self._events = EventLog(node)
        subscription(node, topics.CONTROLLER_STATUS, self._answers.status)
        subscription(node, topics.EVENTS, self._on_event)
        service(node, srv.Operate, topics.DECIDE_PLAN, self._on_decide)

    def announce(self, testbed: msg.Testbed) -> bool:
        """Return whether this is what stands on the bench: a new run begins.

        Controllers that are still there keep the plan of tick 0.
        """
        first = self._course.first if self._course is not None else None
        try:
            plant = described(testbed.settings, f"/{topics.TESTBED}", self._trust)
            self._course = PlannedCourse(plant)
        except BadInput as error:
            if not self._stray:
                self._stray = True
                now, epoch = self._clock.now(), self._clock.epoch
                fact = StrayMessage(topics.TESTBED, "planner", str(error))
                self._events.tell(event_of(fact, 0, now, epoch, "planner"))
            return False
        self._testbed, self._attitude = testbed, plant.testbed.model().attitude
        self._draft = None
        self._forget()
        if first is not None and first.joint_names == plant.joint_names:
            self._course.add(first, 0.0)
            self._offer(first, self._message(first, 0.0))
        return True

    def serve_model(self, node: Node, text: str) -> None:
        """Believe what the node was given at its start; from now on its parameter may be set.

        Raises:
            BadInput: this cannot be believed.
        """
        if why := self.believe(text):
            raise BadInput(why)
        serve_changes(node, lambda changes: self.believe(str(changes.get(MODEL, ""))))

    def believe(self, text: str) -> str:
        """Let requests that name no model believe what was identified; return why not, or "".

        Args:
            text: of an identified.yaml; empty: believe the bench again.
        """
        if self._clock.running:
            return "the bench is running: pause it, then set the model that plans believe"
        if not text:
            self._believed = None
            return ""
        try:
            values = load_yaml(text, "model")
            section = values.get("model") if isinstance(values, dict) else None
            if not isinstance(section, dict):
                return "model: give the text of an identified.yaml that holds a model"
            names = read_testbed(section, "model", self._trust).model().joint_names
        except BadInput as error:
            return str(error)
        here = tuple(self._testbed.joint_names)
        if here and names != here:
            return f"model: is of {', '.join(names)}; on the bench are {', '.join(here)}"
        self._believed = section
        return ""

    def request(
        self, section: str | dict[str, Any], period: float = 0.0, limit: Sequence[float] = ()
    ) -> PlanRequest | Refusal:
        """Return what a client asks for, in YAML or plain data.

        Period and limits need not be said, once a testbed is known.
        """
        here = self._testbed
        if not here.settings and not (period and limit):
            return NO_TESTBED
        found = plan_request(
            section, here.settings, period or here.period, limit or here.effort_limit, self._gains,
            self._rest_at, self._trust,
        )  # fmt: skip
        if isinstance(found, Refusal):
            return found
        values = found.values
        if self._believed is not None and isinstance(values, dict) and not values.get("model"):
            values = values | {"model": self._believed}
        return found._replace(law=self._law, values=values)

    def own_request(self, text: str) -> PlanRequest | Refusal:
        """Return what the node's own parameters ask for; they may name any method."""
        request = self.request(text)
        if isinstance(request, Refusal) or not isinstance(request.values, dict):
            return request
        method = str(request.values.get("method", ""))
        trust = Trust(self._trust.names | {method}, self._trust.everything)
        return request._replace(trust=trust)

    @property
    def joint_names(self) -> tuple[str, ...]:
        """The joints of the testbed; none before it is known."""
        return tuple(self._testbed.joint_names)

    @property
    def clock(self) -> BenchClock:
        """The time that plans start in."""
        return self._clock

    def _rest_at(self, start: float) -> dict[str, float]:
        """Return where the joints' references are at a simulated time [s]; {}: as at tick 0."""
        return self._here.rest_at(start, self._clock.now()) if self._course is not None else {}

    @property
    def flight(self) -> int | None:
        """The epoch that is flown, of which a request is that comes now; None: it is at tick 0."""
        return self._here.flight(self._clock.now()) if self._course is not None else None

    def checked(self, outcome: Plan | Refusal, flight: int | None) -> Plan | Refusal:
        """Return what came of a request, or why the bench cannot fly the plan from now on.

        Args:
            outcome: of the request.
            flight: in which it came, see flight.
        """
        return (
            (self.objection(outcome, flight) or outcome) if isinstance(outcome, Plan) else outcome
        )

    def objection(self, plan: Plan, flight: int | None) -> Refusal | None:
        """Return why a plan is not one that the bench can fly from now on, or None."""
        if self._course is None:
            return None
        now, followed = self._clock.now(), self._answers.followed
        return self._here.objection(plan, now, self._clock.last_tick, flight, followed)

    def publish(self, plan: Plan, who: str) -> msg.Plan:
        """Let the controllers follow a plan; return it as a message."""
        now = self._clock.now()
        message = self._message(plan, now)
        if self._course is not None:
            self._here.add(plan, now)
        self._answers.expect(message.hash)
        self._offer(plan, message)
        self._tell(PlanPublished, plan, message, who)
        return message

    def begin_with(self, plan: Plan) -> None:
        """Publish the plan that the node was started with, which is that of tick 0.

        A planner that is started in flight tells it again where it is followed, else after a reset:
        it would come too late.
        """
        now = self._clock.now()
        if now <= 0.0 or plan.start > now or self._course is None:
            self.publish(plan, "")
            return
        self._here.add(plan, 0.0)
        message = self._message(plan, 0.0)
        if message.hash in self._answers.followed:
            self._offer(plan, message)
        else:
            words = f"the bench is at {now:.2f} s already: it is flown after a reset"
            self.refuse(plan.method, Refusal(words, cause=Cause.PAST))

    def _begin_again(self) -> None:
        """Tell the plan of tick 0 again: a newcomer of the flight that is over heard the latest."""
        first = self._here.plan if self._course is not None else None
        if first is None:
            self._forget()
        elif first is not self._told:
            self._offer(first, self._message(first, 0.0))

    def _offer(self, plan: Plan, message: msg.Plan) -> None:
        self._told = plan
        self._offers[topics.PLAN].publish(message)
        self._offers[topics.PLANNED_TRAJECTORY].publish(trajectory_message(plan))

    def _forget(self) -> None:
        """Let nobody who comes now hear what was published before."""
        if self._told is None:
            return
        self._told = None
        for name, offer in self._offers.items():
            self._node.destroy_publisher(offer)
            self._offers[name] = publisher(self._node, name)

    def refuse(self, method: str, why: Refusal) -> None:
        """Say on `events` why nothing comes of a request that has no answer of its own."""
        now, epoch = self._clock.now(), self._clock.epoch
        what = PlanRefused(method=method, controller="planner", reason=str(why))
        tick = round(now / self._testbed.period) if self._testbed.period else 0
        self._events.tell(event_of(what, tick, now, epoch, "planner"))

    def soonest(self) -> float:
        """Return from which tick on a plan can begin that is asked for now [s].

        Where the bench is may be heard before what stands there: nothing can be planned then.
        """
        now, period = self._clock.now(), float(self._testbed.period)
        if now <= 0.0 or period <= 0.0:
            return 0.0
        return period * ceil((now + self._clock.later(START_MARGIN)) / period)

    def keep(self, plan: Plan, who: str) -> msg.Plan:
        """Keep a draft in the place of the last one; return it as a message."""
        message = self._message(plan, self._clock.now())
        self._draft = plan, message, self.flight
        self._tell(PlanDrafted, plan, message, who)
        return message

    def answered(self, digest: str) -> Future:
        """Return a future of what the controllers say of the plan with this hash."""
        future = self._loop.future()
        self._pending.append(_Pending(digest, monotonic() + PATIENCE, future))
        self._loop.hurry()
        return future

    def poll(self, now: float) -> bool:
        """Tell those who wait for the controllers' answers; return whether somebody still does."""
        for pending in list(self._pending):
            found = self._answers.of(pending.digest, self._gone(now))
            answered = not found.silent and self._met
            if answered or now >= pending.deadline:
                self._pending.remove(pending)
                pending.future.set_result(found)
        return bool(self._pending)

    @property
    def _met(self) -> bool:
        """Whether all controllers on the graph were heard: DDS may name them long before."""
        there: int = self._node.count_publishers(topics.CONTROLLER_STATUS)
        return there <= len(self._answers.known)

    @property
    def _here(self) -> PlannedCourse:
        """The course in the epoch that the bench is in."""
        assert self._course is not None
        self._course.begin_epoch(self._clock.epoch)
        return self._course

    def _on_event(self, event: msg.Event) -> None:
        what = None
        with suppress(BadInput, ValueError):  # of somebody who writes events in another way
            what = fact_of(event.kind, json.loads(event.data))
        if isinstance(what, PlanRefused) and what.controller is not None:
            self._answers.refusal(what.controller, what.hash, what.reason or "")
            self._withdraw_if_refused(what.hash)

    def _withdraw_if_refused(self, digest: str) -> None:
        """Fly on with the plan before the newest one if all controllers have refused that."""
        plan = self._here.plan if self._course is not None else None
        if plan is None or plan_hash(plan) != digest:
            return
        answered = self._answers.of(digest, self._gone(monotonic()))
        if answered.refused and not (answered.taken or answered.silent):
            self._here.withdraw(plan)

    def _gone(self, now: float) -> list[str]:
        """Return which controllers have fallen silent."""
        return [n for n in self._answers.known if self._alive.presence.silent(n, now)]

    def _message(self, plan: Plan, now: float) -> msg.Plan:
        """Return a plan as a message; from its stamp on a reset drops it, but not that of 0 s."""
        return message_of(msg.Plan, {"stamp": stamp(now), **plan_fields(plan, self._attitude)})

    def _tell(self, kind: _Kind, plan: Plan, message: msg.Plan, who: str) -> None:
        now, epoch = self._clock.now(), self._clock.epoch
        what = kind(message.hash, plan.method, plan.duration, who or UNNAMED)
        tick = round(now / plan.period)
        self._events.tell(event_of(what, tick, now, epoch, "planner"))

    async def _on_decide(self, request: Any, reply: Any) -> Any:
        word, _, digest = request.action.partition(" ")
        refused = self._refused(word, digest)
        if refused is not None or self._draft is None:
            reply.message = str(refused or "")
            return reply
        plan, message, _ = self._draft
        self._draft, reply.ok = None, True
        reply.tick = plan.first_tick
        if word == ADOPT:
            self.publish(plan, request.who)
            answered = await self.answered(message.hash)
            reply.ok = not (answered.refused or answered.silent)
            reply.message = (
                f"{plan.method}: flown from {plan.start:g} s on, tick {reply.tick}; "
                f"{answered.message}"
            )
        else:
            self._tell(PlanRefused, plan, message, request.who)
            reply.message = f"{plan.method} from {plan.start:g} s on is dropped"
        return reply

    def _refused(self, word: str, digest: str) -> Refusal | None:
        """Return why a decision cannot be taken, or None."""
        if word not in (ADOPT, REFUSE):
            return Refusal(f"{ADOPT}, {REFUSE}", "action", word)
        if self._draft is None:
            words = "there is no draft to decide on; make one with draft_plan"
            return Refusal(words, cause=Cause.NO_PLAN)
        plan, message, flight = self._draft
        if digest not in ("", message.hash):
            words = f"the draft is {message.hash[:12]} now, not {digest[:12]}"
            return Refusal(words, cause=Cause.UNKNOWN)
        return self.objection(plan, flight) if word == ADOPT else None
