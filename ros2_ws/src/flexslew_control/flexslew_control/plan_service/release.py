"""Plans on their way to the controllers: published at once, or kept until a client decides."""

from collections.abc import Callable, Collection
from time import monotonic
from typing import Any, NamedTuple, Protocol

from flexslew_control.active_laws import ActiveLaws, other_law, with_law
from flexslew_control.law import plant_description
from flexslew_control.plan import Plan
from flexslew_control.plan_service.planning import StartOfPlan
from flexslew_control.plan_service.requests import AnnouncedTestbed, Clock, PlanRequests
from flexslew_control.plans.plan_file import plan_hash
from flexslew_control.plans.planned_course import PATIENCE, PlanHistory, PlanResponse
from flexslew_plant.errors import BadInput
from flexslew_plant.events import (
    NO_NAME,
    Event,
    Fact,
    PlanDrafted,
    PlanOutdated,
    PlanPublished,
    PlanRejected,
    UnexpectedMessage,
    event_of,
)
from flexslew_plant.graph import topics
from flexslew_plant.own_code import Trust
from flexslew_plant.refusal import Cause, Refusal
from flexslew_plant.testbeds.orientation.attitude import AttitudeJoints

ADOPT, REFUSE = "adopt", "refuse"
_Kind = type[PlanPublished] | type[PlanDrafted] | type[PlanRejected]


class Publisher(Protocol):
    """The way of plans to the controllers.

    Attributes:
        told: the plan that a new listener receives last; None: it receives none.
        attitude: the joints of the testbed that read one; None: none do.
    """

    told: Plan | None
    attitude: AttitudeJoints | None

    def message(self, plan: Plan, now: float, epoch: int) -> Any:
        """Return a plan as a flexslew_msgs/Plan.

        Args:
            plan: the plan.
            now: its stamp [s]: a reset drops it, but not that of 0 s.
            epoch: number of resets before.
        """

    def offer(self, plan: Plan, message: Any) -> None:
        """Publish a plan."""

    def clear(self) -> None:
        """Withdraw earlier messages from later listeners."""


class Responses(Protocol):
    """The answers of the controllers to plans."""

    @property
    def active_hash_set(self) -> Collection[str]:
        """The hashes of the plans that are followed."""

    @property
    def all_known(self) -> bool:
        """Whether the answers of all controllers are known."""

    def expect(self, digest: str) -> None:
        """Forget the answers to an earlier plan with this hash: it is published again."""

    def of(self, digest: str) -> PlanResponse:
        """Return what has come so far on a plan with this hash."""


class DraftDecision(NamedTuple):
    """What a client has decided on a draft."""

    plan: Plan
    adopted: bool
    digest: str  # hash of the plan


class PlanRelease:
    """Publishes plans; the newest draft waits for a decision.

    Args:
        clock: time that plans start in.
        publisher: way to the controllers.
        responses: answers of the controllers.
        tell: takes events.
        trust: classes of the user's own that testbed and requests may name.
        laws: the controllers, and which of them is active at a tick.

    Attributes:
        requests: completes those of clients.
    """

    def __init__(
        self,
        clock: Clock,
        publisher: Publisher,
        responses: Responses,
        tell: Callable[[Event], None],
        trust: Trust,
        laws: ActiveLaws,
    ) -> None:
        self._trust = trust
        self._draft: tuple[Plan, Any, int | None] | None = None  # the flight that it is of
        self._course: PlanHistory | None = None
        self._stray = False  # a stray message was reported
        self._initial: Plan | None = None  # to begin with, see begin
        self._begin_by = 0.0  # [wall s]
        self._warned: set[tuple[str, str]] = set()  # reported: hash, and for which law it is
        self.clock, self.laws, self.responses = clock, laws, responses
        self.requests = PlanRequests(clock, trust, self._beginning)
        self._publisher, self._tell = publisher, tell

    def notify(self, testbed: Any) -> bool:
        """Return whether a flexslew_msgs/Testbed is what stands on the bench: a new run begins.

        Controllers that are still there keep the plan of tick 0.
        """
        first = self._course.first if self._course is not None else None
        try:
            plant = plant_description(testbed.settings, f"/{topics.TESTBED}", self._trust)
            self._course = PlanHistory(plant)
            self.laws.begin(plant.schedule, plant.period)
        except BadInput as error:
            if not self._stray:
                self._stray = True
                self._send_event(UnexpectedMessage(topics.TESTBED, "planner", str(error)), 0)
            return False
        of = testbed.period, tuple(testbed.effort_limit), tuple(testbed.joint_names)
        self.requests.testbed = AnnouncedTestbed(testbed.settings, *of)
        self._publisher.attitude = plant.testbed.model().attitude
        self._draft = None
        self._publisher.clear()
        if first is not None and first.joint_names == plant.joint_names:
            self._course.add(first, 0.0)
            self._publish_initial(first)
        return True

    @property
    def flight(self) -> int | None:
        """The epoch that is flown, of which a request is that comes now; None: it is at tick 0."""
        return self._current_course.flight(self.clock.now()) if self._course is not None else None

    def has_later_plan(self, plan: Plan, time: float) -> bool:
        """Return whether another plan is flown in place of one at a simulated time [s]."""
        return self._course is not None and self._current_course.has_later_plan(plan, time)

    def before(self, plan: Plan, tick: int) -> Plan:
        """Return a plan preceded by the references of the bench from an earlier tick on."""
        return self._current_course.before(plan, tick)

    def checked(self, outcome: Plan | Refusal, flight: int | None) -> Plan | Refusal:
        """Return what came of a request, or why the bench cannot fly the plan from now on.

        Args:
            outcome: of the request.
            flight: in which it came, see flight.
        """
        if isinstance(outcome, Refusal):
            return outcome
        return self.objection(outcome, flight) or self.with_statement(outcome)

    def with_statement(self, plan: Plan) -> Plan:
        """Return a new plan with a statement of the law that it is made for."""
        first = plan.first_tick
        return with_law(plan, self.laws.at(first), self.laws.switches(first, first + plan.ticks))

    def late(self, flight: int | None, start: float) -> Refusal | None:
        """Return why a plan from a start [s] on comes too late, or None.

        Args:
            flight: in which it was requested, see flight.
            start: of the plan [s].
        """
        if self._course is None:
            return None
        return self._current_course.late(start, self.clock.now(), self.clock.last_tick, flight)

    def objection(self, plan: Plan, flight: int | None) -> Refusal | None:
        """Return why a plan is not one that the bench can fly from now on, or None."""
        if self._course is None:
            return None
        now, active = self.clock.now(), self.responses.active_hash_set
        return self._current_course.objection(plan, now, self.clock.last_tick, flight, active)

    def publish(self, plan: Plan, who: str) -> Any:
        """Let the controllers follow a plan; return it as a message."""
        now = self.clock.now()
        message = self._message(plan, now)
        if self._course is not None:
            self._current_course.add(plan, now)
        self.responses.expect(message.hash)
        self._publisher.offer(plan, message)
        self._publish_event(PlanPublished, plan, message, who)
        return message

    def begin_with(self, plan: Plan) -> None:
        """Publish the plan that the node was started with, which is that of tick 0.

        A planner that is started in flight publishes it again where it is followed, else after a
        reset: it would come too late.
        """
        self._initial, self._begin_by = plan, monotonic() + PATIENCE
        self.begin()

    def begin(self) -> None:
        """Publish that plan once the state of the bench and, in flight, its followers are known.

        Call it repeatedly: DDS may report the testbed before either of these.
        """
        plan, now = self._initial, self.clock.now()
        if plan is None or not self.clock.has_state:
            return
        in_flight = now > 0.0 and plan.start <= now and self._course is not None
        active = plan_hash(plan) in self.responses.active_hash_set
        if in_flight and not (active or self.responses.all_known or monotonic() > self._begin_by):
            return
        self._initial = None
        if not in_flight:
            self.publish(plan, "")
            return
        self._current_course.add(plan, 0.0)
        if active:
            self._publish_initial(plan)
        else:
            words = f"the bench is at {now:.2f} s already: it is flown after a reset"
            self.refuse(plan.method, Refusal(words, cause=Cause.PAST))

    def check_laws(self) -> None:
        """Report once each plan to come that was made for another law than the current one."""
        for plan, _ in self._current_course.plans if self._course is not None else ():
            why = self._other_law(plan) if plan.start >= self.clock.now() else ""
            key = plan_hash(plan), why
            if why and key not in self._warned:
                self._warned.add(key)
                self._send_event(PlanOutdated(key[0], plan.method, why), self._tick)

    def _other_law(self, plan: Plan) -> str:
        """Return by how much the law at a plan's start is not that of the plan; empty: it is."""
        return other_law(plan, self.laws.at(plan.first_tick))

    def refuse(self, method: str, why: Refusal) -> None:
        """Publish on `events` why a request without an answer of its own is refused."""
        what = PlanRejected(method=method, controller="planner", reason=str(why))
        self._send_event(what, self._tick)

    def keep(self, plan: Plan, who: str) -> Any:
        """Keep a draft in the place of the last one; return it as a message."""
        message = self._message(plan, self.clock.now())
        self._draft = plan, message, self.flight
        self._publish_event(PlanDrafted, plan, message, who)
        return message

    @property
    def _tick(self) -> int:
        """The tick of the bench; 0: not known."""
        period = self.requests.testbed.period
        return round(self.clock.now() / period) if period else 0

    @property
    def _current_course(self) -> PlanHistory:
        """The course in the epoch that the bench is in."""
        assert self._course is not None
        self._course.begin_epoch(self.clock.epoch)
        return self._course

    def _beginning(self, start: float) -> StartOfPlan:
        """Return what is known of the bench at a simulated time [s]."""
        if self._course is None:
            return StartOfPlan()
        at = self.laws.at(round(start / self.requests.testbed.period))
        rest = self._current_course.rest_at(start, self.clock.now())
        return StartOfPlan(rest or None, at and at.law)

    def restart(self) -> None:
        """Publish the plan of tick 0 again: newcomers of the last flight have the newest."""
        first = self._current_course.plan if self._course is not None else None
        if first is None:
            self._publisher.clear()
        elif first is not self._publisher.told:
            self._publish_initial(first)

    def _publish_initial(self, plan: Plan) -> None:
        """Publish a plan as that of tick 0."""
        self._publisher.offer(plan, self._message(plan, 0.0))

    def _message(self, plan: Plan, now: float) -> Any:
        """Return a plan as a message of the current epoch with a stamp [s]."""
        return self._publisher.message(plan, now, self.clock.epoch)

    def on_rejection(self, digest: str) -> None:
        """Fly on with the plan before the newest one if all controllers have refused that.

        New listeners then receive the plans that are flown, and not the refused one.
        """
        plan = self._current_course.plan if self._course is not None else None
        if plan is None or plan_hash(plan) != digest:
            return
        response = self.responses.of(digest)
        if response.refused and not (response.taken or response.inactive):
            self._current_course.remove(plan)
            self._publisher.clear()
            for active_plan, of_flight in self._current_course.plans:
                now = self.clock.now() if of_flight else 0.0
                self._publisher.offer(active_plan, self._message(active_plan, now))

    def _publish_event(self, kind: _Kind, plan: Plan, message: Any, who: str) -> None:
        what = kind(message.hash, plan.method, plan.duration, who or NO_NAME)
        self._send_event(what, round(self.clock.now() / plan.period))

    def _send_event(self, what: Fact, tick: int) -> None:
        now, epoch = self.clock.now(), self.clock.epoch
        self._tell(event_of(what, tick, now, epoch, "planner"))

    def decide(self, action: str, who: str) -> DraftDecision | Refusal:
        """Publish the draft, or drop it; return why neither is possible.

        Args:
            action: "adopt" or "refuse"; with a hash behind it, the draft must have it.
            who: name of the client that decides.
        """
        word, _, digest = action.partition(" ")
        rejection = self._check_decision(word, digest)
        if rejection is not None:
            return rejection
        assert self._draft is not None
        (plan, message, _), self._draft = self._draft, None
        if word == ADOPT:
            self.publish(plan, who)
        else:
            self._publish_event(PlanRejected, plan, message, who)
        return DraftDecision(plan, word == ADOPT, message.hash)

    def _check_decision(self, word: str, digest: str) -> Refusal | None:
        """Return why a decision is not possible, or None."""
        if word not in (ADOPT, REFUSE):
            return Refusal(f"{ADOPT}, {REFUSE}", "action", word)
        if self._draft is None:
            words = "there is no draft to decide on; make one with draft_plan"
            return Refusal(words, cause=Cause.NO_PLAN)
        plan, message, flight = self._draft
        if digest not in ("", message.hash):
            words = f"the draft is {message.hash[:12]} now, not {digest[:12]}"
            return Refusal(words, cause=Cause.UNKNOWN)
        if word != ADOPT:
            return None
        other = self._other_law(plan)
        mismatch = Refusal(f"{other}; make it again", cause=Cause.PLAN_MISMATCH) if other else None
        return self.objection(plan, flight) or mismatch


def decided(decision: DraftDecision, response: PlanResponse | None) -> str:
    """Return one line on a decision, with the controllers' answers to a plan that is adopted."""
    plan = decision.plan
    if response is None:
        return f"{plan.method} from {plan.start:g} s on is dropped"
    return (
        f"{plan.method}: flown from {plan.start:g} s on, tick {plan.first_tick}; {response.message}"
    )
