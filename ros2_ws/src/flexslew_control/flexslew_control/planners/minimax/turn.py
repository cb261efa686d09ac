"""A turn in three axes as it is sought: the rigid craft's efforts to start from, and its time."""

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from flexslew_control.planners.minimax.response import Grid
from flexslew_control.planners.minimax.turning_motion import RotationMotion, platform_of
from flexslew_control.planners.progress import ignore
from flexslew_control.planners.slew import Slew
from flexslew_control.planners.time_optimal.three_axes.fastest_turns import MinimumTimeSlew, means
from flexslew_control.planners.time_optimal.three_axes.path_limits import PathLimits
from flexslew_control.planners.time_optimal.three_axes.reorientation import Reorientation
from flexslew_control.planners.time_optimal.three_axes.round_cones import (
    minimum_time_rigid_limited,
    require_free_ends,
)
from flexslew_plant.arrays import Matrix, Vector
from flexslew_plant.errors import BadInput
from flexslew_plant.testbeds.contract import HasSky, ThreeAxes


@dataclass(frozen=True)
class AllDrivesTurn:
    """A turn of a craft in three axes.

    Args:
        testbed: that the planner believes in.
        motion: of its members.
    """

    testbed: ThreeAxes
    motion: RotationMotion

    @cached_property
    def angle(self) -> float:
        """About the eigenaxis [rad]."""
        return float(np.linalg.norm(self.motion.nominal.turn))

    @cached_property
    def fastest(self) -> MinimumTimeSlew:
        """The fastest turn of the craft without modes, by all drives, within the path's limits.

        Raises:
            PlanFailed: none was found.
        """
        rigid = self.testbed.rigid().model()
        rigid_slew = replace(self.motion.nominal, model=rigid)
        return minimum_time_rigid_limited(self.motion.limits, rigid_slew, ignore)

    @cached_property
    def rigid(self) -> float:
        """Its duration [s]."""
        return float(self.fastest.durations.sum())

    @property
    def cone_margin(self) -> float:
        """The least share of a half angle by which start and goal are outside its cone [-]."""
        n, limits = self.motion.nominal, self.motion.limits
        low = limits.bounds[0]
        margin = self.motion.along(np.array([n.start, n.rest])) / low - 1.0
        return float(margin[:, np.isfinite(low)].min(initial=np.inf))

    def eigenaxis_efforts(self, acceleration: Vector, rate: Vector) -> Matrix:
        """Return the efforts of a turn about the eigenaxis, shape (pieces, joints) [N m or N].

        Args:
            acceleration: of the share of the way, shape (pieces,) [1/s^2].
            rate: of it, shape (pieces,) [1/s].
        """
        nominal, angle = self.motion.nominal, self.angle
        rigid = self.testbed.rigid_turn_about(nominal.turn / angle)
        efforts = np.outer(angle * acceleration, rigid.tangential)
        return np.asarray(efforts + np.outer((angle * rate) ** 2, rigid.centrifugal))

    def scaled_weights(self, grid: Grid) -> Vector:
        """Return the weights of the fastest turn, along the same path in the time of a grid.

        With s times the duration, s^-2 times the efforts do: so do gyroscopic torques change.
        """
        knots = np.concatenate(([0.0], np.cumsum(self.fastest.durations)))
        edges = np.array(grid.edges) * grid.period
        time_scale = edges[-1] / knots[-1]
        return means(self.fastest.efforts / time_scale**2, time_scale * knots, edges).ravel()


def three_axis_slew(slew: Slew, demand: Vector, rate_limit: float | None) -> AllDrivesTurn | None:
    """Return the turn of a slew in three axes; None: its joints move one by one.

    Args:
        slew: the requested slew.
        demand: limits of the drives, shape (joints,) [N m or N].
        rate_limit: largest length of the body rate [rad/s]; None: any.

    Raises:
        BadInput: if nothing turns, a drive does not turn the craft, or it does not float.
        PlanFailed: if a boresight is inside a cone of `keep_out` at the start or the goal.
    """
    attitude, testbed = slew.model.attitude, slew.testbed
    if attitude is None:
        return None
    if slew.static:
        raise BadInput("plan: goal: the craft is there already; give another goal")
    for name, axis in zip(slew.model.joint_names, attitude.axes, strict=True):
        if not axis.any():
            words = f"{name} does not turn the platform; take moving, about the eigenaxis"
            raise BadInput(words, "plan", "drives", "all")
    if not isinstance(testbed, ThreeAxes):
        words = "this testbed turns about one axis at a time; take moving"
        raise BadInput(words, "plan", "drives", "all")
    nominal = Reorientation(slew.model, slew.start, slew.goal, demand)
    sky = testbed.sky() if isinstance(testbed, HasSky) else None
    limits = PathLimits(() if sky is None else sky.cones, rate_limit)
    if limits.names:
        require_free_ends(limits, nominal)
    return AllDrivesTurn(testbed, RotationMotion(nominal, platform_of(slew.testbed), limits))
