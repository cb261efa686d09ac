"""The course that a controller follows: one plan after the other, each from its start on."""

from dataclasses import replace
from typing import NamedTuple

import numpy as np

from flexslew_control.law import Reference
from flexslew_control.plan import Plan
from flexslew_plant.refusal import Cause, Refusal

# By how much the reference may jump where a plan begins in flight: its positions [rad or m], and
# its rates [rad/s or m/s]
LARGEST_JUMP = 0.01


class _Segment(NamedTuple):
    first: int  # tick from which on it is followed
    plan: Plan


class PlanSequence:
    """Plans by their starts. The reference at a tick is that of the newest plan that has started.

    Before the first start of a plan adopted in flight the reference is the one before it, or
    `hold`; a plan adopted before tick 0 holds its own first joint positions until it starts.
    """

    def __init__(self) -> None:
        self._segments: tuple[_Segment, ...] = ()

    @property
    def plan(self) -> Plan | None:
        """The newest plan; None: there is none."""
        return self._segments[-1].plan if self._segments else None

    @property
    def first(self) -> Plan | None:
        """The plan of tick 0; None: there is none."""
        return next((segment.plan for segment in self._segments if segment.first < 0), None)

    @property
    def plans(self) -> tuple[tuple[Plan, bool], ...]:
        """All plans in the order of their starts, and whether each was adopted in flight."""
        return tuple((segment.plan, segment.first >= 0) for segment in self._segments)

    def reference(self, tick: int, default: Reference) -> Reference:
        """Return the reference of a tick.

        Args:
            tick: tick of the bench.
            default: the reference where no plan has started.
        """
        for segment in reversed(self._segments):
            if tick >= segment.first:
                return segment.plan.reference(tick)
        return default

    def has_later_plan(self, plan: Plan, tick: int) -> bool:
        """Return whether another plan is followed at a tick where this one would be, or is to be.

        Args:
            plan: that was added.
            tick: of the bench.
        """
        after = next(
            (k for k, segment in enumerate(self._segments, 1) if segment.plan is plan), None
        )
        return after is None or any(segment.first < tick for segment in self._segments[after:])

    def begin_with(self, plan: Plan) -> None:
        """Follow a plan from tick 0 on, and no other one."""
        self._segments = (_Segment(-1, plan),)

    def add(self, plan: Plan) -> None:
        """Follow a plan from its start on; one that would begin later is dropped."""
        first = plan.first_tick
        self._segments = (
            *(segment for segment in self._segments if segment.first < first),
            _Segment(first, plan),
        )

    def before(self, plan: Plan, tick: int, default: Reference) -> Plan:
        """Return a plan preceded by the references from an earlier tick on.

        Args:
            plan: a plan that is not added yet.
            tick: tick of the bench.
            default: the reference where no plan has started.
        """
        previous = [self.reference(k, default) for k in range(tick, plan.first_tick)]
        if not previous:
            return plan
        count, nominal, gains = len(previous), plan.state[0], plan.gains
        states = [r.state if r.state.size == nominal.size else nominal for r in previous]
        if len(gains):
            gains = np.vstack((np.tile(gains[0], (count, 1)), gains))
        return replace(
            plan,
            start=tick * plan.period,
            duration=plan.duration + count * plan.period,
            position=np.vstack(([r.position for r in previous], plan.position)),
            velocity=np.vstack(([r.velocity for r in previous], plan.velocity)),
            effort=np.vstack(([r.effort for r in previous], plan.effort)),
            state=np.vstack((states, plan.state)),
            gains=gains,
        )

    def restart(self) -> None:
        """Return to the plan of tick 0: those adopted in flight are of the flight that is over."""
        self._segments = tuple(segment for segment in self._segments if segment.first < 0)


def jump(plan: Plan, before: Reference) -> Refusal | None:
    """Return by how much the reference would jump where a plan begins, if it is too much.

    Args:
        plan: that begins.
        before: the reference at its start without it.
    """
    for what, here, new in (
        ("stands at", before.position, plan.position[0]),
        ("moves at", before.velocity, plan.velocity[0]),
    ):
        off = np.abs(new - here)
        joint = int(off.argmax())
        if off[joint] > LARGEST_JUMP:
            words = (
                f"at its start, {plan.start:g} s, the reference of {plan.joint_names[joint]} "
                f"{what} {here[joint]:.6g}, the plan begins with {new[joint]:.6g}; at most "
                f"{LARGEST_JUMP:g} apart is allowed"
            )
            return Refusal(words, cause=Cause.PLAN_MISMATCH)
    return None
