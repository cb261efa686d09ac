"""The plan that the parameters of a planner ask for."""

from pathlib import Path

from flexslew_control.plan_file import load_plan
from flexslew_control.ros.plan_job import Outcome, PlanJob
from flexslew_control.ros.plan_release import PlanRelease
from flexslew_control.ros.plan_result import failure
from flexslew_control.ros.planner_settings import PlannerSettings
from flexslew_plant.refusal import Refusal


class OwnPlan:
    """Makes or reads it, and publishes it.

    Args:
        settings: parameters of the node.
        job: that plans.
        release: of plans.
    """

    def __init__(self, settings: PlannerSettings, job: PlanJob, release: PlanRelease) -> None:
        self._settings, self._job, self._release = settings, job, release
        self.due = False  # there is a bench that it is for

    def poll(self) -> None:
        """Begin, if it is due."""
        if not self.due:
            return
        self.due = False
        if self._settings.file:
            self._release.begin_with(load_plan(Path(self._settings.file)))
        elif self._settings.plan and not self._job.busy:
            self._job.ask(self._release.requests.own_request(self._settings.plan), self._planned)

    def _planned(self, outcome: Outcome) -> None:
        """Publish what came of it; without it the node has no purpose."""
        if isinstance(outcome, Refusal):
            raise failure(outcome)
        self._release.begin_with(outcome)
