"""From what the loop counted to the metrics of all trials at once, by the rules for all runs."""

from collections.abc import Sequence

import numpy as np

from flexslew_lab.metrics import KEYS, METRICS
from flexslew_lab.metrics.course import CourseMetric
from flexslew_lab.metrics.efforts import EffortSums, effort_values
from flexslew_lab.metrics.epoch import merged
from flexslew_lab.metrics.joint_errors import ErrorExtremes, error_values
from flexslew_lab.metrics.metric import Ending, ReferenceManoeuvre, RunSetup
from flexslew_lab.metrics.operator_changes import OperatorChanges
from flexslew_lab.metrics.settling import SettlingExtremes, goal_displacement, settling_values
from flexslew_lab.metrics.takeovers import Takeovers
from flexslew_lab.metrics.tip_deflection import tip_values
from flexslew_lab.studies.batch.groups.batch_trial import BatchTrial
from flexslew_lab.studies.batch.groups.rows import Rows
from flexslew_lab.studies.batch.loop import Schedule
from flexslew_lab.studies.flight import columns_of
from flexslew_lab.trial.trial import Trial
from flexslew_plant.arrays import Matrix, Vector
from flexslew_plant.events import Event
from flexslew_plant.testbeds.compiled.batch_kernel import BATCH_WIDTH


def needs_truth(trial: Trial) -> bool:
    """Return whether a metric of a trial is measured from its recorded truth."""
    return bool(trial.metrics) or any(
        entry.needs_truth and entry.is_for(trial.testbed) for entry in METRICS.values()
    )


class BatchMetrics:
    """The metrics of trials that flew side by side; all are measured alike.

    Args:
        members: the trials.
        rows: of the array.
        schedule: that all followed.
        target: of the manoeuvre.
        at_rest: joint positions at the start, shape (joints, members) [rad or m].
    """

    def __init__(
        self,
        members: Sequence[BatchTrial],
        rows: Rows,
        schedule: Schedule,
        target: ReferenceManoeuvre,
        at_rest: Matrix,
    ) -> None:
        member = members[0]
        joints = member.model.joints
        self._goal = np.full(joints, np.nan) if target.goal is None else target.goal
        self._rows, self._of_kernel, self._target = rows, member.kernel.rows, target
        self._names, self._first = member.model.joint_names, at_rest.T - self._goal
        self._finished, time = bool(schedule.over.any()), schedule.time
        self._times = float(time[0]), float(time[-1])
        testbed = member.trial.testbed
        setup = RunSetup(self._names, target, np.array(testbed.effort_limit), testbed)
        course = CourseMetric(setup)
        course.ticks, course.times = (0, len(time) - 1), self._times
        of_events = Takeovers(setup), OperatorChanges(setup), course
        found: dict[tuple[Event, ...], dict[str, float | None]] = {}
        for one in members:
            events = one.happens.charge.events
            if events not in found:
                found[events] = columns_of(merged(of_events, Ending(events, [], True)))
        self._others = [found[one.happens.charge.events] for one in members]

    def metrics(self, w: Vector) -> list[dict[str, float | None]]:
        """Return the columns of every member of the flown array."""
        with np.errstate(all="ignore"):
            found = self._columns(w)
        table = np.array(list(found.values())).T
        known = np.isfinite(table).all(axis=1).tolist()
        members = []
        each = zip(table.tolist(), known, self._others, strict=False)  # the filled ones
        for row, whole, others in each:
            values = row if whole else [x if abs(x) < np.inf else None for x in row]
            members.append({**dict(zip(found, values, strict=True)), **others})
        return members

    def _columns(self, w: Vector) -> dict[str, Vector]:
        """Return every column, shape (members,); what is not known is not finite."""
        rows, target, of_kernel = self._rows, self._target, self._of_kernel

        def one(begin: int) -> Vector:
            return w[begin : begin + BATCH_WIDTH]

        def joints(begin: int) -> Matrix:
            return w[begin : begin + len(self._names) * BATCH_WIDTH].reshape(-1, BATCH_WIDTH).T

        final = joints(of_kernel.position) - self._goal
        terminal = one(rows.terminal) if self._finished else np.full(BATCH_WIDTH, np.nan)
        ends = self._first, final, joints(of_kernel.rate), terminal
        move = goal_displacement(target.displacement, self._first)
        extremes = SettlingExtremes(joints(rows.outside), joints(rows.limit_excess))
        efforts = joints(rows.peak_effort), joints(rows.square_sum), one(rows.saturated)
        first, last = self._times
        least = 0.0 if self._finished else -np.inf  # also where there are no tips
        values = {
            **tip_values(np.maximum(one(rows.residual_tip), least), one(rows.peak_tip)),
            **error_values(target, None, ErrorExtremes(joints(rows.residual), *ends)),
            **settling_values(target, move, extremes, last),
            **effort_values(EffortSums(*efforts), last - first),
        }
        found = dict[str, Vector]()
        for name, value in values.items():
            found |= self._by_joint(name, value) if KEYS[name].per_joint else {name: value}
        return found

    def _by_joint(self, name: str, values: Matrix) -> dict[str, Vector]:
        """Return the columns of what each joint has, see columns_of."""
        known = np.where(np.isfinite(values), values, np.nan)
        parts = zip(self._names, known.T, strict=True)
        most = np.fmax if KEYS[name].some else np.maximum
        largest: Vector = most.reduce(abs(known), axis=1)
        return {name: largest} | {f"{name}.{joint}": part for joint, part in parts}
