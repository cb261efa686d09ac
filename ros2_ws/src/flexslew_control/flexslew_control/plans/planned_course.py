"""The planner's model of the course that the bench flies: its plans, and their acceptance."""

from collections.abc import Collection
from copy import copy
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np

from flexslew_control.law import PlantDescription, Reference
from flexslew_control.plan import Plan
from flexslew_control.plans.course import LARGEST_JUMP, PlanSequence, jump
from flexslew_control.plans.plan_file import plan_hash
from flexslew_plant.arrays import EMPTY
from flexslew_plant.refusal import Cause, Refusal
from flexslew_plant.testbeds import initial_positions

PATIENCE = 2.0  # for the answers of the controllers to a plan [wall s]
_OVER = Refusal(
    "it was requested before the bench was reset; request it again",
    cause=Cause.BENCH_RESET,
)


class PlanHistory:
    """The plans that were published for a bench.

    Args:
        plant: what stands there.
    """

    def __init__(self, plant: PlantDescription) -> None:
        self._period, self._names = plant.period, plant.joint_names
        first = initial_positions(plant.testbed)
        rest = np.zeros(len(self._names))
        self._rest_reference = Reference(
            np.array([first[n] for n in self._names]), rest, rest, EMPTY
        )
        self._plan_sequence, self._epoch = PlanSequence(), 0
        self._before = self._plan_sequence  # the newest plan

    @property
    def plan(self) -> Plan | None:
        """The newest plan that is flown, or will be; None: there is none."""
        return self._plan_sequence.plan

    @property
    def first(self) -> Plan | None:
        """The plan of tick 0, which is flown again after a reset; None: there is none."""
        return self._plan_sequence.first

    @property
    def plans(self) -> tuple[tuple[Plan, bool], ...]:
        """All plans that are flown, in order, and whether each was published in flight."""
        return self._plan_sequence.plans

    def has_later_plan(self, plan: Plan, time: float) -> bool:
        """Return whether another plan is flown in place of one at a simulated time [s]."""
        return self._plan_sequence.has_later_plan(plan, round(time / self._period))

    def flight(self, now: float) -> int | None:
        """Return the epoch that is flown at a simulated time [s]; None: it is at tick 0."""
        return self._epoch if now > 0.0 else None

    def begin_epoch(self, epoch: int) -> None:
        """Know that the bench was reset: the controllers return to the plan of tick 0."""
        if epoch != self._epoch:
            self._epoch = epoch
            self._plan_sequence.restart()
            self._before = self._plan_sequence

    def rest_at(self, start: float, now: float) -> dict[str, float]:
        """Return where each joint's reference is at a simulated time, by name; at tick 0 nothing.

        Args:
            start: of a plan to be made [s].
            now: at which the bench is [s].
        """
        if now <= 0.0:
            return {}
        at = self._plan_sequence.reference(
            round(start / self._period), self._rest_reference
        ).position
        return dict(zip(self._names, at.tolist(), strict=True))

    def before(self, plan: Plan, tick: int) -> Plan:
        """Return a plan preceded by the references from an earlier tick on."""
        return self._plan_sequence.before(plan, tick, self._rest_reference)

    def late(
        self, start: float, now: float, last_tick: int = 0, flight: int | None = None
    ) -> Refusal | None:
        """Return why no plan can begin at a start [s] any more, or None; see objection."""
        if flight not in (None, self._epoch):
            return _OVER
        if now > 0.0 and start <= now:
            return Refusal(
                f"the plan starts at {start:g} s, the bench is at {now:.2f} s; "
                "make one that starts later",
                cause=Cause.PAST,
            )
        if last_tick and round(start / self._period) >= last_tick:
            ends = last_tick * self._period
            return Refusal(
                f"the plan starts at {start:g} s, the run ends at {ends:g} s; "
                "make one that starts earlier",
                cause=Cause.RUN_OVER,
            )
        return None

    def objection(
        self,
        plan: Plan,
        now: float,
        last_tick: int = 0,
        flight: int | None = None,
        active_hash_set: Collection[str] = (),
    ) -> Refusal | None:
        """Return why the bench cannot fly a plan from a simulated time on, or None.

        Args:
            plan: the plan to be adopted.
            now: current simulated time of the bench [s].
            last_tick: tick at which the run ends; zero: not known.
            flight: epoch of the request: the plan begins where the reference was to be in it.
            active_hash_set: hashes of the plans that controllers follow. Where the newest one here
                is not
                among them, an earlier planner has made theirs: they know how far they jump.
        """
        why = self.late(plan.start, now, last_tick, flight) or self._end_motion_error(
            plan, last_tick
        )
        if now <= 0.0 or why is not None:
            return why
        newest = self.plan
        if active_hash_set and (newest is None or plan_hash(newest) not in active_hash_set):
            return None
        far = jump(plan, self._plan_sequence.reference(plan.first_tick, self._rest_reference))
        if far is None:
            return None
        words = f"{far.why}; leave `initial` out, and start when the plan before is over"
        return replace(far, why=words)

    def _end_motion_error(self, plan: Plan, last_tick: int) -> Refusal | None:
        """Return by how much the reference still moves where a plan is over before the run is."""
        rates = np.abs(plan.velocity[-1])
        joint = int(rates.argmax())
        if rates[joint] <= LARGEST_JUMP or plan.first_tick + plan.ticks >= last_tick:
            return None
        return Refusal(
            f"{plan.joint_names[joint]} still moves when the plan is over, at {plan.end:g} s, and "
            f"the run ends at {last_tick * self._period:g} s; let the plan last until then",
            cause=Cause.PLAN_MISMATCH,
        )

    def add(self, plan: Plan, now: float) -> None:
        """Take note that a plan was published at this simulated time [s]."""
        self._before, self._plan_sequence = self._plan_sequence, copy(self._plan_sequence)
        if now <= 0.0:
            self._plan_sequence.begin_with(plan)
        else:
            self._plan_sequence.add(plan)

    def remove(self, plan: Plan) -> None:
        """Note that no controller follows the newest plan: the one before it is flown on."""
        if plan is self.plan:
            self._plan_sequence = self._before


class PlanResponse(NamedTuple):
    """The controllers that follow a plan, and those that do not."""

    taken: tuple[str, ...]
    refused: dict[str, str]  # name: why
    inactive: tuple[str, ...]

    @property
    def message(self) -> str:
        """One line for the client that requested the plan."""
        parts = [f"taken by {', '.join(self.taken)}"] if self.taken else []
        parts += [f"refused by {name}: {why}" for name, why in self.refused.items()]
        parts += [f"no answer from {', '.join(self.inactive)}"] if self.inactive else []
        return "; ".join(parts) or "no controller is on the graph; the next one will take it"


class PlanResponses:
    """The answers of the controllers to the plans that they receive."""

    def __init__(self) -> None:
        self._hash_by_controller: dict[str, str] = {}  # hash by name
        self._rejected: dict[tuple[str, str], str] = {}  # why, by name and hash

    def status(self, status: Any) -> None:
        """Take a flexslew_msgs/ControllerStatus."""
        self._hash_by_controller[status.controller] = status.plan_hash

    @property
    def controller_names(self) -> tuple[str, ...]:
        """The controllers from which a status has come."""
        return tuple(self._hash_by_controller)

    @property
    def active_hash_set(self) -> set[str]:
        """The hashes of the plans that are followed."""
        return {*self._hash_by_controller.values()} - {""}

    def refusal(self, controller: str, digest: str, why: str) -> None:
        """Note that a controller refuses a plan with this hash."""
        self._rejected[controller, digest] = why

    def expect(self, digest: str) -> None:
        """Forget the answers to an earlier plan with this hash: it is published again."""
        self._rejected = {key: why for key, why in self._rejected.items() if key[1] != digest}

    def of(self, digest: str, removed: Collection[str] = ()) -> PlanResponse:
        """Return what has come so far on a plan.

        Args:
            digest: its hash.
            removed: controllers that are no longer there.
        """
        names = sorted(self._hash_by_controller.keys() - {*removed})
        taken = tuple(name for name in names if self._hash_by_controller[name] == digest)
        rejected = {n: self._rejected[n, digest] for n in names if (n, digest) in self._rejected}
        rejected = {name: why for name, why in rejected.items() if name not in taken}
        pending = tuple(name for name in names if name not in taken and name not in rejected)
        return PlanResponse(taken, rejected, pending)
