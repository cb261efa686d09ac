"""Plans for a bench in the same process: drafts, decisions, and what the controllers follow."""

from collections.abc import Callable, Sequence
from functools import partial
from typing import Any

import numpy as np

from flexslew_control.active_laws import ActiveLaws, describe_plan_law
from flexslew_control.controllers.host import ControllerHost
from flexslew_control.message_fields import in_flight, plan_fields
from flexslew_control.plan import Plan
from flexslew_control.plan_service.job import BUSY, Client, PlanJob, motion_request
from flexslew_control.plan_service.planning import Iteration, MotionRequest, PlanRequest
from flexslew_control.plan_service.release import PlanRelease, decided
from flexslew_control.plans.known_motion import KnownMotion
from flexslew_control.plans.planned_course import PlanResponse
from flexslew_lab.console.link import DRAFTED, Iterate, PlanCallback, RequestResult, plan_outcome
from flexslew_lab.log.recording.bag_observer import BagObserver
from flexslew_plant.bench.operation.run_state import RUNNING
from flexslew_plant.bench.operation.session import Session
from flexslew_plant.events import Event
from flexslew_plant.own_code import Trust
from flexslew_plant.refusal import Refusal, Reply
from flexslew_plant.testbeds.orientation.attitude import AttitudeJoints


class LocalPlans:
    """Plans of a bench: the clock, the way to the controllers and their answers of PlanRelease.

    Args:
        session: of the bench.
        hosts: the controllers.
        observer: writes the log.
        tell: takes events.
        testbed: flexslew_msgs/Testbed of the bench.
        trust: classes of the user's own that requests may name.

    Attributes:
        release: keeps the draft and the plans that are flown.
        told: the newest plan that was published; None: there is none.
        attitude: the joints of the testbed that read one; None: none do.
    """

    has_state, all_known = True, True  # of the bench and of all controllers

    def __init__(
        self,
        session: Session,
        hosts: Sequence[ControllerHost],
        observer: BagObserver,
        tell: Callable[[Event], None],
        testbed: Any,
        trust: Trust,
    ) -> None:
        self._session, self._bench, self._hosts = session, session.bench, hosts
        self._observer, self._tell = observer, tell
        self.told: Plan | None = None
        self.attitude: AttitudeJoints | None = None
        self._refused: dict[tuple[str, str], str] = {}  # why, by controller and hash of the plan
        self._canceled = False
        self._job = PlanJob(soon=False)
        self.release = PlanRelease(self, self, self, tell, trust, ActiveLaws())
        self.release.notify(testbed)

    @property
    def epoch(self) -> int:
        """Number of resets."""
        return self._bench.epoch

    @property
    def last_tick(self) -> int:
        """Tick at which the run ends; zero: only when it is stopped."""
        return self._bench.last_tick or 0

    @property
    def running(self) -> bool:
        """Whether ticks pass."""
        return self._session.run.state == RUNNING

    def now(self) -> float:
        """Return the simulated time [s]."""
        return self._bench.time

    def later(self, wait: float) -> float:
        """Return how much simulated time passes in a wall time at least as at real time [s]."""
        return wait * max(1.0, self._session.tick_timer.rate_factor)

    def message(self, plan: Plan, now: float, epoch: int) -> Any:
        """Return a plan as a flexslew_msgs/Plan with a stamp [s] and the number of resets."""
        fields = plan_fields(plan, self.attitude)
        return self._observer.message("/plan", now, **fields, epoch=epoch)

    def offer(self, plan: Plan, message: Any) -> None:
        """Let the controllers follow a plan."""
        self.told = plan
        self._observer.plan(message)
        for host in self._hosts:
            if (reason := host.adopt(plan, in_flight(message), message.epoch)) is not None:
                self._refused[host.name, message.hash] = str(reason)
                self._tell(host.plan_refused(message.hash, reason))

    def clear(self) -> None:
        """Forget the newest plan."""
        self.told = None

    @property
    def active_hash_set(self) -> set[str]:
        """The hashes of the plans that are followed."""
        return {host.plan_hash for host in self._hosts} - {""}

    def expect(self, digest: str) -> None:
        """Forget the answers to an earlier plan with this hash."""
        self._refused = {key: why for key, why in self._refused.items() if key[1] != digest}

    def of(self, digest: str) -> PlanResponse:
        """Return which controllers follow a plan with this hash, and which refuse it."""
        taken = tuple(sorted(host.name for host in self._hosts if host.plan_hash == digest))
        refused = {name: why for (name, key), why in self._refused.items() if key == digest}
        return PlanResponse(taken, {n: w for n, w in refused.items() if n not in taken}, ())

    def draft(
        self, request: str, who: str, progress: Callable[[Iterate], None], then: PlanCallback
    ) -> None:
        """Make a plan that no controller follows yet; see console.link.BenchLink.draft."""
        if self._job.busy:
            then(RequestResult(False, str(BUSY)), None)
            return
        flight = self.release.flight
        self._canceled = False

        def iterate(iteration: Iteration) -> None:
            progress(Iterate(*iteration))

        self._job.ask(
            partial(self.release.requests.request, request),
            partial(self._drafted, flight, who, then),
            Client(iterate, lambda: self._canceled),
            partial(self.release.late, flight),
            None if flight is None else self._motion,
        )

    def cancel(self) -> None:
        """Give up the plan that is being made."""
        self._canceled = True

    def decide(self, action: str, who: str) -> Reply:
        """Adopt or drop the draft; see PlanRelease.decide."""
        decision = self.release.decide(action, who)
        if isinstance(decision, Refusal):
            return Reply(refused=decision)
        response = self.of(decision.digest) if decision.adopted else None
        words, tick = decided(decision, response), decision.plan.first_tick
        if response is None or not response.refused:
            return Reply(words, tick=tick)
        self.release.on_rejection(decision.digest)
        return Reply(tick=tick, refused=Refusal(words))

    def poll(self) -> None:
        """Take what the planning process has done, and report plans for another law."""
        bench = self._bench
        self.release.laws.take_state(bench.drive.active, bench.tick, bench.epoch)
        self.release.check_laws()
        self._job.poll()

    def close(self) -> None:
        """End the process that plans."""
        self._job.close()

    def _drafted(
        self, flight: int | None, who: str, then: PlanCallback, outcome: Plan | Refusal
    ) -> None:
        plan = self.release.checked(outcome, flight)
        if isinstance(plan, Refusal):
            then(RequestResult(False, str(plan)), None)
            return
        details = describe_plan_law(plan), plan.summary.get("warning")
        message = self.release.keep(plan, who)
        then(RequestResult(True, plan_outcome(plan, DRAFTED, *details)), message)

    def _motion(self, plan: Plan, request: PlanRequest) -> MotionRequest | Plan:
        """Return what the prediction of a plan from the motion of the bench requires."""
        truth, model = self._bench.truth(), self._bench.model
        state = np.concatenate((truth.position, truth.velocity))
        (modes, rates), joints = model.modal_state(state), model.joint_state(state)
        pairs = zip(*(values.tolist() for values in joints), strict=True)
        tips = np.array([*truth.tip_deflection, *self._bench.appendages.tip.dot(rates)])
        moving = dict(zip(model.joint_names, pairs, strict=True))
        motion = KnownMotion(truth.tick, moving, modes, rates, tips)
        return motion_request(plan, request, motion, self.release.before)
