"""From what the loop counted to the metrics of each trial, by the rule for all runs."""

import numpy as np

from flexslew_lab.metrics.course import CourseMetric
from flexslew_lab.metrics.efforts import Efforts
from flexslew_lab.metrics.epoch import merged
from flexslew_lab.metrics.joint_errors import JointErrors
from flexslew_lab.metrics.metric import Ending, FlownManoeuvre, RunSetup
from flexslew_lab.metrics.operator_changes import OperatorChanges
from flexslew_lab.metrics.settling import Settling
from flexslew_lab.metrics.takeovers import Takeovers
from flexslew_lab.metrics.tip_deflection import TipDeflection
from flexslew_lab.studies.flight import columns_of
from flexslew_lab.studies.lanes.lane_trial import LaneTrial
from flexslew_lab.studies.lanes.loop import Schedule
from flexslew_lab.studies.lanes.rows import Rows, of_lane
from flexslew_plant.arrays import Matrix, Vector

_ENDING = Ending([], [], True)


class LaneMetrics:
    """The metrics of trials that flew beside each other; all are measured alike.

    Args:
        lane: one of them.
        rows: of the array.
        schedule: that all followed.
        aim: of the manoeuvre.
        at_rest: joint positions at the start, shape (joints, lanes) [rad or m].
    """

    def __init__(
        self,
        lane: LaneTrial,
        rows: Rows,
        schedule: Schedule,
        aim: FlownManoeuvre,
        at_rest: Matrix,
    ) -> None:
        assert aim.goal is not None
        self._rows, self._goal, self._at_rest = rows, aim.goal, at_rest
        self._ended = bool(schedule.over.any())
        testbed, time = lane.trial.testbed, schedule.time
        limit = np.array(testbed.effort_limit)
        setup = RunSetup(lane.model.joint_names, aim, limit, testbed)
        self._tip, self._errors = TipDeflection(setup), JointErrors(setup)
        self._settling, self._efforts = Settling(setup), Efforts(setup)
        self._joints = limit.size
        course = CourseMetric(setup)
        course.ticks = 0, len(time) - 1
        self._efforts.times = course.times = float(time[0]), float(time[-1])
        self._settling.last_time = float(time[-1])
        self._measured = self._tip, self._errors, self._settling, self._efforts
        self._alike = columns_of(
            merged((Takeovers(setup), OperatorChanges(setup), course), _ENDING)
        )

    def metrics(self, w: Vector, k: int) -> dict[str, float | None]:
        """Return the columns of the trial in lane k of the flown array."""
        rows, m = self._rows, self._joints
        tip, errors, settling, efforts = self._tip, self._errors, self._settling, self._efforts
        tip.peak = float(w[rows.peak_tip + k])
        settling.outside = of_lane(w, rows.outside, m, k)
        settling.beyond = of_lane(w, rows.beyond, m, k)
        errors.first = self._at_rest[:, k] - self._goal
        errors.final = of_lane(w, 0, m, k) - self._goal
        if self._ended:
            tip.residual = float(w[rows.residual_tip + k])
            errors.residual = of_lane(w, rows.residual, m, k)
            errors.terminal = float(w[rows.terminal + k])
        efforts.peak = of_lane(w, rows.peak_effort, m, k)
        efforts.square_sum = of_lane(w, rows.square_sum, m, k)
        efforts.integral = float(efforts.square_sum.sum())
        efforts.saturated = float(w[rows.saturated + k])
        return columns_of(merged(self._measured, _ENDING)) | self._alike
