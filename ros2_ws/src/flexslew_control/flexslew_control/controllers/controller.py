"""A controller: estimator, law and plan behind the one question of the bench."""

from collections import deque
from collections.abc import Callable
from contextlib import suppress
from copy import deepcopy
from dataclasses import fields, is_dataclass
from math import hypot, isfinite
from typing import NamedTuple

import numpy as np

from flexslew_control.estimators.monitor import Monitor, Monitored, channel_name
from flexslew_control.law import (
    Estimate,
    Estimator,
    Law,
    LawFailed,
    Reference,
    read_only_estimate,
)
from flexslew_control.plan import Plan
from flexslew_control.plans.course import PlanSequence, jump
from flexslew_plant.arrays import EMPTY, Number, Vector, read_only, read_only_view
from flexslew_plant.events import EstimateInconsistent, EstimateStarted, Event, Fact, event_of
from flexslew_plant.measurement import EffortCommand, Measurement
from flexslew_plant.refusal import Cause, Refusal
from flexslew_plant.testbeds.orientation.attitude import AttitudeJoints, conjugate, product

NOT_FINITE = Refusal("its estimate is not finite", cause=Cause.NOT_FINITE)
_NONE = -2  # tick of a measurement that has not come: not even the one before tick 0


class Answer(NamedTuple):
    """The command and what led to it; see flexslew_msgs/ControllerState."""

    command: EffortCommand
    reference: Reference
    estimate: Estimate
    terms: dict[str, Vector]
    reference_orientation: Vector = EMPTY  # quaternion x y z w, (4,); empty: no attitude
    estimate_orientation: Vector = EMPTY  # the same of the estimate


def bare_answer(command: EffortCommand) -> Answer:
    """Return a command as an answer that does not show what led to it."""
    estimate = Estimate(EMPTY, EMPTY, EMPTY, np.zeros((0, 0)), EMPTY)
    return Answer(command, Reference(EMPTY, EMPTY, EMPTY, EMPTY), estimate, {})


def handover_effort(offset: Number, passed: int, ticks: int) -> Number:
    """Return what a controller adds after a handover: the offset, which goes to zero in `ticks`.

    Args:
        offset: the effort that was applied less its own, at the handover [N m or N].
        passed: ticks since then.
        ticks: of the whole handover.
    """
    return (1.0 - passed / ticks) * offset


class Activation(NamedTuple):
    """How a controller becomes the active one."""

    handover_time: float = 1.0  # in which the previous controller's effort is blended out [s]
    requires_plan: bool = False  # without a plan it is not ready


WITHOUT_PLAN = Activation()


class Controller:
    """Keeps its estimator warm on every measurement, answers those that name it.

    Args:
        name: its name on the bench.
        estimator: fed with every measurement.
        law: called only while the controller is active.
        joint_names: joints in the order of the efforts.
        period: one tick [s].
        activation: its handover, and whether it needs a plan.
        monitor: tests of the innovations; None: they are not tested.
        attitude: the joints that read an attitude; None: none do. Estimator and law then receive
            positions about the reference, so that errors are rotations.
    """

    def __init__(
        self,
        name: str,
        estimator: Estimator,
        law: Law,
        joint_names: tuple[str, ...],
        period: float,
        activation: Activation = WITHOUT_PLAN,
        monitor: Monitor | None = None,
        attitude: AttitudeJoints | None = None,
    ) -> None:
        self._attitude = attitude
        self.name, self.joint_names, self.period = name, joint_names, period
        self._estimator, self._law = estimator, law
        # receives the plan's reference, where the estimator uses it
        self._expect: Callable[[Reference], None] | None = getattr(estimator, "expect", None)
        # receives the references to come, where the law uses them
        self._preview: Callable[[Callable[[int], Reference], int], None] | None = getattr(
            law, "foresee", None
        )
        # returns why the law cannot fly this plan, where it needs more of it than a reference
        self._plan_check: Callable[[Plan | None], str] | None = getattr(law, "objection", None)
        self._handover_ticks = max(1, round(activation.handover_time / period))
        self._requires_plan = activation.requires_plan
        self._plan_sequence = PlanSequence()
        self._key = (-1, _NONE)  # epoch and tick of the last measurement
        self._answer_tick = -1  # last tick it answered
        self._was_active = False  # it was active in this epoch
        self._is_new = True  # it has seen no measurement yet
        self._join_tick = 0  # first tick it saw of a flight in progress; 0: of none
        self._was_reset = False  # the next tick does not follow from the last one
        self._answer: Answer | None = None
        self._offset: Vector = np.zeros(len(joint_names))  # previous minus own effort
        self._handover_tick = 0
        self._rest_reference = self.rest_at(np.zeros(len(joint_names)))
        self._previous_estimator: Estimator | None = None  # source of the state to be taken over
        self._failure: Refusal | None = None  # why the law or its estimator gave up
        self.error: LawFailed | None = None  # the last such failure, in any epoch
        self._not_finite = False  # the estimate is not finite
        self._monitor = monitor
        self._estimate_fault: Refusal | None = (
            None  # why the estimate is not to be trusted, until the next epoch
        )
        self.events: deque[Event] = deque()  # to be published

    @property
    def handover_ticks(self) -> int:
        """Ticks over which the effort of the previous controller is blended out."""
        return self._handover_ticks

    @property
    def estimator(self) -> Estimator:
        """The estimator that it uses."""
        return self._estimator

    def use_estimator(self, estimator: Estimator) -> None:
        """Use another estimator, which starts with the next measurement."""
        self._estimator, self._monitor = estimator, None
        self._expect = getattr(estimator, "expect", None)

    @property
    def monitor(self) -> Monitor | None:
        """The tests of the estimator's innovations; None: there are none."""
        return self._monitor

    @property
    def law(self) -> Law:
        """The law that it runs."""
        return self._law

    @property
    def attitude(self) -> AttitudeJoints | None:
        """The joints that read an attitude; None: none do."""
        return self._attitude

    @property
    def plan_sequence(self) -> PlanSequence:
        """The plans that it follows."""
        return self._plan_sequence

    @property
    def last_tick(self) -> int:
        """Tick of the last measurement that the estimator has seen; -1: none."""
        return max(self._key[1], -1)

    @property
    def is_starting(self) -> bool:
        """The next measurement is its first one, or as good as that."""
        return self._was_reset or self.last_tick < 0

    @property
    def plan(self) -> Plan | None:
        """The newest plan that it follows, or will from its start on; None: there is none."""
        return self._plan_sequence.plan

    @property
    def started(self) -> tuple[Plan, ...]:
        """The plans that it has followed in this flight: that of tick 0 once a tick has passed."""
        now = self.last_tick
        return tuple(
            plan
            for plan, of_flight in self._plan_sequence.plans
            if plan.first_tick <= now or (now > 0 and not of_flight)
        )

    @property
    def estimate(self) -> Estimate:
        """The estimate of the last measurement."""
        return self._estimate

    def set_plan_sequence(self, plan_sequence: PlanSequence) -> None:
        """Follow a course in place of the plans that were adopted."""
        self._plan_sequence = plan_sequence

    def begin_epoch(self, epoch: int) -> None:
        """Begin an epoch after a reset: the plan of tick 0 is flown again, if there is one.

        Reasons against becoming active belonged to the flight that is over: they are dropped.
        """
        if epoch > self._key[0]:
            if self._key[0] >= 0:
                self._plan_sequence.restart()
            self._key, self._was_active, self._join_tick = (epoch, _NONE), False, 0
            self._failure, self._estimate_fault, self._not_finite = None, None, False

    def restart(self, epoch: int) -> None:
        """Take the next measurement for the first one, wherever the bench is."""
        self._key = epoch, _NONE

    @property
    def reason(self) -> Refusal | None:
        """Why it could not take charge now; None when it could."""
        if self._requires_plan and self.plan is None:
            return Refusal("no plan yet", cause=Cause.NO_PLAN)
        if self._plan_check is not None and (issue := self._plan_check(self.plan)):
            return Refusal(issue, cause=Cause.PLAN_MISMATCH)
        if self._failure or self._estimate_fault:
            return self._failure or self._estimate_fault
        return NOT_FINITE if self._not_finite else None

    def adopt(self, plan: Plan, of_flight: bool = False) -> Refusal | None:
        """Follow this plan from its start, and hold until then; return why not, or None.

        A plan that starts at or before a tick that has been seen is refused: which tick would be
        the first to follow it would depend on the moment of its arrival. So is one in flight that
        does not begin where the reference is then, see course.LARGEST_JUMP. A standby that has no
        plan takes it: it came after the plan that the bench flies, and starts again with it. One
        that was started in flight receives all plans of it, and takes them one after the other. So
        does one that had to answer before it received them: it was active at rest where it came,
        and hands over to itself. Of the plans that started after it came, it takes only the first
        that it receives, or one that continues from those.

        Args:
            plan: plan to be followed.
            of_flight: whether it was published in flight; a reset drops it then.
        """
        if plan.joint_names != self.joint_names:
            return _mismatch(f"the plan moves {plan.joint_names}, the bench has {self.joint_names}")
        if abs(plan.period - self.period) > 1e-9 * self.period:
            return _mismatch(
                f"the period of the plan is {plan.period} s, that of the bench {self.period} s"
            )
        if self.last_tick <= 0:
            (self._plan_sequence.add if of_flight else self._plan_sequence.begin_with)(plan)
            return None
        started = plan.first_tick <= self.last_tick
        if started and self._can_join(plan):
            (self._plan_sequence.add if of_flight else self._plan_sequence.begin_with)(plan)
            self._was_reset = True  # a repeated question gets the earlier answer
            return None
        if started:
            return _mismatch(
                f"the plan starts at {plan.start} s, the bench is at "
                f"{self.last_tick * self.period:.2f} s"
            )
        if far := jump(plan, self.reference(plan.first_tick)):
            return far
        self._plan_sequence.add(plan)
        return None

    def _can_join(self, plan: Plan) -> bool:
        """Return whether it follows a plan that has started, as it joined during the flight."""
        if not self._was_active:
            return self.plan is None or self._join_tick > 0
        if not self._join_tick:
            return False
        if self.plan is None or plan.first_tick <= self._join_tick:
            return True
        return jump(plan, self.reference(plan.first_tick)) is None

    def take_over(self, other: "Controller") -> None:
        """Take the place of another design of the same controller from the next measurement on.

        The other's plan and estimator state are taken over (where both estimators are of one kind
        and size; else the estimator starts afresh); its effort is blended out as in any handover.
        """
        self._plan_sequence, self._rest_reference, self._key = (
            other._plan_sequence,
            other._rest_reference,
            other._key,
        )
        self._was_active, self._is_new, self._join_tick = (
            other._was_active,
            other._is_new,
            other._join_tick,
        )
        self._was_reset = other._was_reset
        # one that was replaced before it saw a measurement has no state of its own
        self._previous_estimator = other._previous_estimator or other._estimator
        other.close()

    def observe(self, measurement: Measurement) -> Answer | None:
        """Return the answer if the measurement names this controller.

        The same measurement again gives the same answer; an old one gives none. A law that has
        failed gives none in this epoch, one without a finite estimate gives none until it has one.
        """
        if self._failure and measurement.epoch <= self._key[0]:
            self._key = max(self._key, (measurement.epoch, measurement.tick))
            return None
        try:
            return self._observed(measurement)
        except LawFailed as failure:
            self.error = failure
            self._failure = Refusal(str(failure), cause=Cause.LAW_FAILED)
            return None

    def _observed(self, measurement: Measurement) -> Answer | None:
        tick = measurement.tick
        key = measurement.epoch, tick
        if key < self._key:
            return None
        seen: Measurement | None = None
        if key > self._key:
            epoch, last_tick = self._key
            is_next = tick == last_tick + 1 and key[0] == epoch and not self._was_reset
            self._was_reset = False
            self.begin_epoch(key[0])
            self._key = key
            self._answer = None
            if not is_next:
                self._rest_reference = self.rest_at(measurement.joint_position)
                if tick > 0 or (self._is_new and measurement.epoch > 0):  # started again
                    self._queue_event(EstimateStarted(self.name, self._is_new), measurement)
            if self._expect is not None:
                self._expect(self.reference(tick))
            first, self._is_new = self._is_new, False
            # before a later flight, too, the others have their plan already
            self._join_tick = max(tick, int(key[0] > 0)) if first else self._join_tick
            seen = self._relative_measurement(measurement)
            if not is_next:
                self._estimator.reset(seen)
                # in a later epoch the law starts again, too
                self._answer_tick, self._estimate_fault = -1 if first else _NONE, None
                if self._monitor is not None:
                    self._monitor.reset()
            if self._previous_estimator is not None:
                self._estimator.reset(seen)
                if is_next:
                    _inherit(self._estimator, self._previous_estimator)
                self._previous_estimator = None
            self._estimate = read_only_estimate(self._estimator.update(seen))
            if self._not_finite:  # a filter that has swallowed NaN keeps it: start it afresh
                self._restart_estimator(seen)
            self._not_finite = not _finite(self._estimate)
            if self._monitor is not None and not (self._not_finite or self._estimate_fault):
                self._check_estimate(self._monitor, measurement)
        if measurement.controller != self.name or self.reason:
            return None
        if self._answer is None:
            seen = seen or self._relative_measurement(measurement)
            self._answer = self._compute_answer(seen, self._estimate)
            self._answer_tick, self._was_active = tick, True
        return self._answer

    def _restart_estimator(self, seen: Measurement) -> None:
        """Start the estimator afresh, unless it reads a sensor that is still no number.

        It starts with fewer sensors than it then reads: it is started a tick before.
        """
        before = seen._replace(tick=seen.tick - 1, time=seen.time - self.period)
        for begin in (before, seen):
            self._estimator.reset(begin)
            self._estimate = read_only_estimate(self._estimator.update(seen))
            if not _finite(self._estimate):
                return

    def _relative_measurement(self, measurement: Measurement) -> Measurement:
        """Return the measurement with positions that differ from the reference by the errors."""
        if self._attitude is None:
            return measurement
        reference, measured = self.reference(measurement.tick), measurement.joint_position
        position = read_only(self._attitude.about(reference.position, measured))
        return measurement._replace(joint_position=position)

    def _check_estimate(self, monitor: Monitor, measurement: Measurement) -> None:
        """Doubt the estimate from now on if its innovations are larger than its variance allows."""
        assert isinstance(self._estimator, Monitored)
        failed_test = monitor.take(self._estimate.innovation, self._estimator.innovation_variance())
        if failed_test is None:
            return
        channel = channel_name(failed_test.channel, self.joint_names)
        what = EstimateInconsistent(
            self.name, channel, failed_test.ticks, failed_test.statistic, failed_test.limit
        )
        self._estimate_fault = Refusal(what.reason, cause=Cause.DOUBTED)
        self._queue_event(what, measurement)

    def _queue_event(self, what: Fact, at: Measurement) -> None:
        """Queue an event of this tick."""
        self.events.append(event_of(what, at.tick, at.time, at.epoch, self.name))

    def _compute_answer(self, measurement: Measurement, estimate: Estimate) -> Answer:
        reference = self.reference(measurement.tick)
        takes_over = self._answer_tick != measurement.tick - 1
        if takes_over:
            applied = measurement.applied_effort
            self._law.reset(measurement, estimate, reference, applied)
        if self._preview is not None:
            self._preview(self.reference, measurement.tick)
        effort = self._law.update(measurement, estimate, reference)
        for what in getattr(self._law, "remarks", ()):
            self._queue_event(what, measurement)
        if takes_over:
            self._handover_tick = measurement.tick
            # at tick 0 there is no predecessor to blend out
            self._offset = applied - effort if measurement.tick > 0 else np.zeros_like(effort)
        terms = self._law.terms
        passed = measurement.tick - self._handover_tick
        if passed < self._handover_ticks and self._offset.any():
            blended = handover_effort(self._offset, passed, self._handover_ticks)
            effort, terms = effort + blended, {**terms, "handover": blended}
        command = EffortCommand(
            measurement.tick, measurement.epoch, self.name, read_only_view(effort)
        )
        orientation_pair: tuple[Vector, ...] = ()
        if self._attitude is not None:
            orientation_pair = self._orientation_pair(self._attitude, reference, estimate)
        return Answer(command, reference, estimate, terms, *orientation_pair)

    def _orientation_pair(
        self, attitude: AttitudeJoints, reference: Reference, estimate: Estimate
    ) -> tuple[Vector, Vector]:
        """Return the quaternions of reference and estimate; empty where they are not known."""
        estimated = estimate.position[: len(self.joint_names)]
        desired = read_only_view(attitude.orientation(reference.position))
        if estimated.size < len(self.joint_names):
            return desired, EMPTY
        left = attitude.orientation(reference.position - estimated)
        return desired, read_only_view(product(desired, conjugate(left)))

    def close(self) -> None:
        """Give back what the law holds of the machine, as a serial port, after a run."""
        getattr(self._law, "close", lambda: None)()

    def warm(self, appendages: int) -> None:
        """Compile and load what the first answers need, so that none of them comes late.

        A copy answers two questions at rest and is thrown away: this controller stays as it is.

        Args:
            appendages: how many the bench has.
        """
        with suppress(LawFailed, TypeError):  # a user's law may refuse the question or the copy
            self.warmed(appendages)

    def warmed(self, appendages: int) -> "Controller":
        """Return a copy that has answered two questions at rest; see warm."""
        joints, none = np.zeros(len(self.joint_names)), np.zeros(appendages)
        copied = deepcopy(self)
        for tick in range(2):
            time = tick * self.period
            copied.observe(
                Measurement(tick, 0, time, self.name, joints, joints, none, none, joints)
            )
        return copied

    def reference(self, tick: int) -> Reference:
        """Return the reference of the plans, or rest where the first measurement was."""
        return self._plan_sequence.reference(tick, self._rest_reference)

    def rest_at(self, position: Vector) -> Reference:
        """Return the reference of a rest at these joint positions, shape (joints,) [rad or m]."""
        rest = read_only(np.zeros(len(self.joint_names)))
        return Reference(read_only_view(position), rest, rest, EMPTY)


def _inherit(estimator: Estimator, other: Estimator) -> None:
    """Copy the state of an estimator into another one of the same kind and size, just reset."""
    if type(estimator) is not type(other) or not is_dataclass(estimator):
        return
    names = [item.name for item in fields(estimator) if not item.init]
    arrays = [name for name in names if isinstance(getattr(estimator, name), np.ndarray)]
    if all(getattr(estimator, n).shape == getattr(other, n).shape for n in arrays):
        for name in names:
            setattr(estimator, name, getattr(other, name))


def _mismatch(words: str) -> Refusal:
    return Refusal(words, cause=Cause.PLAN_MISMATCH)


def _finite(estimate: Estimate) -> bool:
    """Return whether a law can work with the estimate."""
    position, velocity, _, _, innovation, _ = estimate
    return isfinite(hypot(*position.tolist(), *velocity.tolist(), *innovation.tolist()))
