"""What an episode of a task is: its member by seed, its spaces, its score."""

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import numpy as np
from gymnasium import spaces

from flexslew_control.controllers import POLICY, build_controller
from flexslew_lab.benchmark.score import BEST, score_of, violation
from flexslew_lab.benchmark.task import entry_study, load_task, member_case
from flexslew_lab.studies.batch.batch_metrics import needs_truth
from flexslew_lab.studies.batch.stepped import RUNNING, RunningTerm
from flexslew_lab.studies.cases import Case, case_trial
from flexslew_lab.studies.flight import PlanCache
from flexslew_lab.trial.trial import Trial, plant_of
from flexslew_plant.arrays import Matrix
from flexslew_plant.errors import BadInput

_SEEDS = 1 << 31  # of members


class Episodes:
    """The episodes of a benchmark task.

    Args:
        task: name of the task.
        base: keys of pd_feedforward, whose efforts the actions are added to; None: zero.
        authority: effort of an action of one, as a share of the limit, above 0 to 1.
        plan: keys of a `plan` section in place of the task's; None: the task's.

    Raises:
        BadInput: there is no such task, or a value is not allowed.
    """

    def __init__(
        self,
        task: str,
        base: Mapping[str, Any] | None = None,
        authority: float = 1.0,
        plan: Mapping[str, Any] | None = None,
    ) -> None:
        self.task, self.authority = load_task(task), authority
        law = {"base": base and dict(base), "authority": authority}
        name = POLICY.name
        entry: dict[str, Any] = {"controllers": {name: law}, "active": name}
        trial = self.task.trial
        # the last tick is observed, and a reference, noise and faults are there for it
        longer = replace(self.task, trial=replace(trial, duration=trial.duration + trial.period))
        self.study = entry_study(longer, entry | ({"plan": dict(plan)} if plan else {}))
        self.ticks = round(trial.duration / trial.period)
        self.plans = PlanCache()
        nominal = self.trial(1)
        self.plans.keep(nominal)
        self.testbed = nominal.testbed
        plant = plant_of(nominal)
        controller = build_controller(name, name, law, plant, f"{task}: {name}")
        law_built: Any = controller.law
        self.signals: tuple[str, ...] = law_built.signals
        self.joints = len(plant.joint_names)
        self.observation_space = spaces.Box(-np.inf, np.inf, (len(self.signals),), np.float64)
        self.action_space = spaces.Box(-1.0, 1.0, (self.joints,), np.float32)
        counted = not needs_truth(nominal)
        self.terms = tuple(
            RunningTerm(name, BEST * term.weight, term.half)
            for name, term in self.task.score.items()
            if counted and name in RUNNING
        )

    def case(self, seed: int) -> Case:
        """Return the member of a seed."""
        return member_case(self.study, seed)

    def trial(self, seed: int) -> Trial:
        """Return the trial of the member of a seed."""
        return case_trial(self.study, self.case(seed))

    def score(self, metrics: Mapping[str, float | None] | None) -> float:
        """Return the score of a member, 0 to 100; None: it has failed."""
        return score_of(self.task, metrics)

    def failure(self, metrics: Mapping[str, float | None] | None) -> str:
        """Return why a member has failed; empty: it has not."""
        return "the state is lost" if metrics is None else violation(self.task, metrics)

    @property
    def unmeasured(self) -> float:
        """What the terms of the score count that are measured at the end alone: all of it."""
        return BEST - sum(term.weight for term in self.terms)


def option_member(options: Mapping[str, Any] | None) -> Any:
    """Return the seeds of members that the options of a reset ask for; None: they ask for none.

    Raises:
        BadInput: an option is not known.
    """
    for name in options or {}:
        if name != "member":
            raise BadInput("is not known; allowed: member", "options", name)
    return (options or {}).get("member")


def member_seed(generator: np.random.Generator) -> int:
    """Return the seed of the next member."""
    return int(generator.integers(_SEEDS))


def checked_actions(actions: Any, shape: tuple[int, ...]) -> Matrix:
    """Return actions as float64, shape as asked.

    Raises:
        BadInput: another shape, or one is not finite.
    """
    try:
        given = np.asarray(actions, dtype=np.float64)
    except (TypeError, ValueError):
        raise BadInput(f"the action is no array of numbers of shape {shape}") from None
    if given.shape != shape:
        raise BadInput(f"the action has shape {given.shape}, expected {shape}")
    if not np.isfinite(given).all():
        place = tuple(np.argwhere(~np.isfinite(given))[0].tolist())
        raise BadInput(f"the action is {given[place]} at {list(place)}; give finite numbers")
    return given
