"""How closely joints follow a plan: tolerances on the way, at the end, and what comes of them."""

from collections.abc import Mapping
from dataclasses import dataclass
from enum import IntEnum
from typing import NamedTuple

import numpy as np

from flexslew_control.plan import Plan
from flexslew_plant.arrays import Vector


class TrackingCode(IntEnum):
    """The error codes of control_msgs/action/FollowJointTrajectory."""

    SUCCESSFUL = 0
    INVALID_GOAL = -1
    INVALID_JOINTS = -2
    OLD_HEADER_TIMESTAMP = -3
    PATH_TOLERANCE_VIOLATED = -4
    GOAL_TOLERANCE_VIOLATED = -5


class Tolerance(NamedTuple):
    """The largest errors of a joint; zero or less: any."""

    position: float = 0.0  # [rad or m]
    velocity: float = 0.0  # [rad/s or m/s]


class Tracked(NamedTuple):
    """Joints against a plan at one time."""

    desired: tuple[Vector, Vector]  # position, velocity, (joints,) each
    actual: tuple[Vector, Vector]

    @property
    def error(self) -> tuple[Vector, Vector]:
        """Desired minus actual."""
        return self.desired[0] - self.actual[0], self.desired[1] - self.actual[1]


class TrackingEnd(NamedTuple):
    """What came of a trajectory."""

    code: TrackingCode
    words: str


@dataclass(frozen=True)
class Tracking:
    """Holds what joints do against a plan.

    Args:
        plan: that is flown.
        joints: that are looked at, of those of the plan.
        path: tolerances while it is flown, by joint.
        goal: tolerances at its end, by joint.
        goal_time: how long after its end the joints may still come within them [s].
    """

    plan: Plan
    joints: tuple[str, ...]
    path: Mapping[str, Tolerance]
    goal: Mapping[str, Tolerance]
    goal_time: float = 0.0

    def at(
        self, time: float, positions: Mapping[str, float], rates: Mapping[str, float]
    ) -> Tracked:
        """Return where the joints should be and are.

        Args:
            time: simulated [s].
            positions: of the joints [rad or m].
            rates: of the joints [rad/s or m/s].
        """
        reference = self.plan.reference(round(time / self.plan.period))
        columns = [self.plan.joint_names.index(name) for name in self.joints]
        actual = [np.array([values[name] for name in self.joints]) for values in (positions, rates)]
        return Tracked(
            (reference.position[columns], reference.velocity[columns]), (actual[0], actual[1])
        )

    def end(self, time: float, tracked: Tracked, replaced: bool = False) -> TrackingEnd | None:
        """Return what has come of it at a simulated time; None: it goes on.

        Args:
            time: simulated [s].
            tracked: the joints then.
            replaced: another plan is flown by then.
        """
        if replaced and time < self.plan.end:
            return TrackingEnd(TrackingCode.INVALID_GOAL, "another plan has replaced this one")
        if time < self.plan.start:
            return None
        if time < self.plan.end:
            violation = self._violation(self.path, tracked)
            if violation is None:
                return None
            words = f"at {time:g} s {violation}; the plan is flown on, the brake would stop it"
            return TrackingEnd(TrackingCode.PATH_TOLERANCE_VIOLATED, words)
        violation = self._violation(self.goal, tracked)
        if violation is None:
            return TrackingEnd(TrackingCode.SUCCESSFUL, f"within tolerance at {time:g} s")
        if time < self.plan.end + self.goal_time and not replaced:
            return None
        return TrackingEnd(TrackingCode.GOAL_TOLERANCE_VIOLATED, f"at {time:g} s {violation}")

    def _violation(self, allowed: Mapping[str, Tolerance], tracked: Tracked) -> str | None:
        """Return which joint is farther off than it may be, and by how much."""
        for k, name in enumerate(self.joints):
            limits = allowed.get(name, Tolerance())
            for what, limit, error in zip(limits._fields, limits, tracked.error, strict=True):
                if 0.0 < limit < abs(error[k]):
                    return f"the {what} of {name} is {abs(error[k]):.3g} off, allowed {limit:g}"
        return None
