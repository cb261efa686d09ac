"""One plan at a time, made in a process next to the one that serves the request."""

from collections.abc import Callable
from typing import NamedTuple, TypeAlias

from flexslew_control.plan import Plan
from flexslew_control.plan_service.planning import (
    Iteration,
    MotionRequest,
    PlanProcess,
    PlanRequest,
)
from flexslew_control.plans.known_motion import PREDICTED, KnownMotion, at_rest
from flexslew_plant.refusal import Cause, Refusal

CANCELED = Refusal("canceled by the client", cause=Cause.CANCELED)
BUSY = Refusal("another plan is being made; cancel it, or wait", cause=Cause.NO_MANOEUVRE)
Outcome: TypeAlias = Plan | Refusal
# what a plan's prediction from the motion of the bench requires; the plan: nothing; None: not known
# yet. The plan is the one that is made, on the request that is given with it.
MotionSource: TypeAlias = Callable[[Plan, PlanRequest], MotionRequest | Plan | None]
Late: TypeAlias = Callable[[float], Refusal | None]  # why a plan from a start [s] on comes too late


class Client(NamedTuple):
    """A client that follows how its plan is made."""

    progress: Callable[[Iteration], None]  # takes every iteration
    canceled: Callable[[], bool]  # returns whether it has given up


class PlanJob:
    """Plans for one request, and reports the outcome by a call.

    Args:
        soon: a request will come, so the planning process makes its imports now.
        hurry: called when `poll` is due at once.
    """

    def __init__(self, soon: bool, hurry: Callable[[], None] = lambda: None) -> None:
        self._hurry, self._process = hurry, PlanProcess(soon)
        self._client: Client | None = None  # that is planned for; None: it follows nothing
        self._finished: Callable[[Outcome], None] | None = None  # takes the outcome
        self._make: Callable[[], PlanRequest | Refusal] | None = None
        self._late: Late = _never
        self._motion_source: MotionSource = _at_rest
        self._request: PlanRequest | None = None  # that is planned for
        self._made: Plan | None = None  # without a known motion yet, or being predicted
        self._in_prediction = False  # the process predicts that plan

    @property
    def busy(self) -> bool:
        """Whether a plan is under way."""
        return self._finished is not None

    def ask(
        self,
        make: Callable[[], PlanRequest | Refusal],
        finished: Callable[[Outcome], None],
        client: Client | None = None,
        late: Late | None = None,
        motion_source: MotionSource | None = None,
    ) -> None:
        """Begin to plan.

        Args:
            make: returns the request as the bench is now. Where it has changed while a plan was
                made, that plan is dropped and another one made: its law or its start is not there.
            finished: takes the outcome.
            client: that follows the iterations, and may cancel.
            late: returns why the bench cannot fly a plan from a start [s] on any more, or None.
                Planning ends as soon as it returns a refusal. None: it always can.
            motion_source: returns what the prediction from the motion of the bench requires. None:
                the
                bench rests.
        """
        self._make, self._finished, self._client = make, finished, client
        self._motion_source = motion_source or _at_rest
        self._late = late or _never
        self._plan(make())
        self._hurry()

    def poll(self) -> None:
        """Take what has come, and end planning that is canceled or too late."""
        for result in self._process.updates():
            self._take(result)
        if self._request is None:
            return
        cancel = self._client is not None and self._client.canceled()
        why = CANCELED if cancel else self._late(self._request.start)
        if why is not None:
            self.end(why)
        elif self._made is not None and not self._in_prediction:
            self._predict(self._made, self._request)

    def end(self, why: Refusal) -> None:
        """End planning, if any is under way, with this refusal."""
        if self._request is not None:
            self._process.cancel()
            self._finish(why)

    def close(self) -> None:
        """End the process that plans."""
        self._process.close()

    def _plan(self, request: PlanRequest | Refusal) -> None:
        why = request if isinstance(request, Refusal) else self._late(request.start)
        if why is not None or isinstance(request, Refusal):
            assert why is not None
            self._finish(why)
            return
        self._request = request
        self._process.ask(request)

    def _take(self, result: Iteration | Outcome) -> None:
        if isinstance(result, Iteration):
            if self._client is not None:
                self._client.progress(result)
            return
        if self._request is None or self._make is None:
            return
        request = self._make()
        if isinstance(request, PlanRequest) and not request.beginning.same(self._request.beginning):
            self._made, self._in_prediction = None, False
            self._plan(request)
        elif self._made is None and isinstance(result, Plan):
            self._made = result
            self._predict(result, self._request)
        else:
            self._finish(self._made if isinstance(result, Refusal) and self._made else result)

    def _predict(self, plan: Plan, request: PlanRequest) -> None:
        """Begin to predict a plan from the motion of the bench, or finish where that is nothing."""
        required = self._motion_source(plan, request)
        if isinstance(required, Plan):
            self._finish(required)
        elif required is not None:
            self._in_prediction = True
            self._process.ask(required)

    def _finish(self, outcome: Outcome) -> None:
        finished, self._finished, self._request = self._finished, None, None
        self._made, self._in_prediction = None, False
        if finished is not None:
            finished(outcome)


def _never(start: float) -> Refusal | None:
    return None


def _at_rest(plan: Plan, request: PlanRequest) -> Plan:
    return plan


def motion_request(
    plan: Plan, request: PlanRequest, motion: KnownMotion, before: Callable[[Plan, int], Plan]
) -> MotionRequest | Plan:
    """Return what the prediction of a plan from a motion requires; the plan: nothing.

    Args:
        plan: predicted from rest.
        request: that it is made for.
        motion: of the bench.
        before: returns a plan preceded by the references from an earlier tick on.
    """
    if PREDICTED not in plan.summary or request.beginning.law is None or at_rest(motion, plan):
        return plan
    return MotionRequest(plan, before(plan, motion.tick), motion, request)
