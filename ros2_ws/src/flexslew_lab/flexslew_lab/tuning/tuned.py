"""A tuned controller: its goals, measured, and its loop as the bench runs it."""

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from flexslew_control.analysis.loop import ControlLoop, loop_of
from flexslew_control.analysis.loop_margins import disk_margins, frequency_response
from flexslew_lab.analysis.analysis import (
    Analysis,
    disk_margin,
    is_stable,
    loop_analysis,
)
from flexslew_lab.analysis.trial_models import running_law_at
from flexslew_lab.json_text import finite
from flexslew_lab.notebook import trial as changed_trial
from flexslew_lab.short_values import short
from flexslew_lab.trial.trial import Trial
from flexslew_lab.tuning.kept_keys import kept_section
from flexslew_lab.tuning.problem import GoalNumber, TuningProblem
from flexslew_lab.tuning.settings import GainBlock, MarginGoal
from flexslew_lab.tuning.solve import StartOutcome, solve_starts
from flexslew_plant.arrays import Vector
from flexslew_plant.errors import BadInput
from flexslew_plant.notebook_table import in_notebook
from flexslew_plant.settings import plain

_ROUNDING = 1e-6  # of a goal's number, by which it may exceed one


@dataclass(frozen=True)
class TunedGoal:
    """A goal on its worst model.

    Args:
        label: of the goal.
        hard: whether it had to be met first.
        value: its number, at most one where it is met; inf: not stable.
        model: on which it is worst.
        frequency: where it is determined [rad/s]; nan: no one frequency.
        before: its number with the trial's own controller, or at the first start; inf: not stable.
    """

    label: str
    hard: bool
    value: float
    model: str
    frequency: float
    before: float

    @property
    def met(self) -> bool:
        """Whether it is met on every model."""
        return bool(self.value <= 1.0 + _ROUNDING)

    @property
    def words(self) -> str:
        """Its number, model and frequency in words."""
        at = f" at {self.frequency:.4g} rad/s" if np.isfinite(self.frequency) else ""
        return f"{self.label}: {self.value:.4g} on {self.model}{at}"


@dataclass(frozen=True, repr=False)
class TunedController:
    """The best controller of a tuning.

    Args:
        problem: that was solved.
        starts: what every start reached.
        best: the best of them.
        goals: of the file, as the bench's own linear form of the tuned law has them.
        stable: by model, whether that loop is stable.
        margins: by model, disk margin at the efforts [-]; 0: not stable.
        trial: the trial with the tuned controller, active from the start.
    """

    problem: TuningProblem
    starts: tuple[StartOutcome, ...]
    best: StartOutcome
    goals: tuple[TunedGoal, ...]
    stable: dict[str, bool]
    margins: dict[str, float]
    trial: Trial

    @property
    def met(self) -> bool:
        """Whether every loop is stable and every goal is met on every model."""
        return all(self.stable.values()) and all(goal.met for goal in self.goals)

    @property
    def section(self) -> dict[str, Any]:
        """The controller's section, plain data."""
        return dict(self.trial.controllers[self.problem.settings.controller] or {})

    @property
    def verdict(self) -> str:
        """The result in a sentence: stable or not, goals met, the worst goal and where."""
        unstable = [name for name, stable in self.stable.items() if not stable]
        if unstable:
            return f"not stable on {', '.join(unstable)}"
        count, met = len(self.goals), sum(goal.met for goal in self.goals)
        models = f"{len(self.stable)} model" + "s" * (len(self.stable) > 1)
        worst = max(self.goals, key=lambda goal: goal.value)
        return (
            f"stable on {models}; {met} of {count} goals met; the worst is {worst.words} "
            f"(1 or less: met); smallest disk margin {min(self.margins.values()):.4g}"
        )

    def __repr__(self) -> str:
        """Return one line: the controller and the verdict."""
        return f"<TunedController {self.problem.settings.controller}: {self.verdict}>"

    def _repr_html_(self) -> str:
        """Return the goals, for notebooks."""
        rows = ((g.label, short(g.before), short(g.value), g.model) for g in self.goals)
        return in_notebook(repr(self), ("goal", "before", "after", "worst model"), rows)

    @property
    def analysis(self) -> Analysis:
        """The loop of the tuned trial, analysed by `analyse`'s own means."""
        settings, joints = self.problem.settings, self.problem.point.rest.joints
        return loop_analysis(
            self.trial, settings.tuning, settings.controller, settings.at, joints, errors=()
        )

    def plain(self) -> dict[str, Any]:
        """Return the numbers as JSON holds them; what is infinite or has no value is null."""
        found: dict[str, Any] = finite(
            {
                "tuning": self.problem.settings.tuning,
                "verdict": self.verdict,
                "met": self.met,
                "goals": [vars(goal) | {"met": goal.met} for goal in self.goals],
                "stable": self.stable,
                "disk_margins": self.margins,
                "starts": [vars(start) for start in self.starts],
                "controller": self.section,
            }
        )
        return found


def tune_structure(
    problem: TuningProblem,
    state: Path | None = None,
    progress: Callable[[int, int], None] = lambda done, last: None,
) -> TunedController:
    """Return the best controller of a problem.

    Args:
        problem: to be solved.
        state: see solve_starts.
        progress: see solve_starts.

    Raises:
        BadInput: if no start leads to a stable loop on all models, or the law is refused.
    """
    starts = solve_starts(problem, state, progress)
    best = min(starts, key=lambda one: one.rank)
    if not best.parameters:
        growth = min(one.growth for one in starts)
        raise BadInput(
            f"no stable loop on all models from {len(starts)} starts, the smallest growth rate was "
            f"{growth:.3g} 1/s{_growing(problem)}; give other signals or a larger order"
        )
    x = np.array(best.parameters)
    problem.rescaled(x)
    tuned = trial_with(problem, x)
    loops = bench_loops(problem, tuned)
    stable = {name: is_stable(loop) for name, loop in loops.items()}
    margins = {name: disk_margin(loop) for name, loop in loops.items()}
    goals = _measured(problem, x, loops, stable)
    return TunedController(problem, starts, best, goals, stable, margins, tuned)


def _growing(problem: TuningProblem) -> str:
    """Return where the loop grows from the first start."""
    from flexslew_lab.tuning.norms import stability

    k = np.real(problem.structure.matrix(problem.structure.start))
    found = [stability(plant.closed(k)) for plant in problem.stable]
    worst = max(range(len(found)), key=lambda m: found[m].value)
    label = list(problem.models)[worst]
    return f"; the first start grows on {label} at {found[worst].frequency:.3g} rad/s"


def trial_with(problem: TuningProblem, x: Vector) -> Trial:
    """Return the trial with the controller at parameters, which a new controller makes active."""
    settings, trial = problem.settings, problem.trial
    name = settings.controller
    given = dict(trial.controllers.get(name) or {})
    if not isinstance(settings.structure, GainBlock):
        given = kept_section(name, given)
    section = {**given, **problem.structure.section(x)}
    changes: dict[str, Any] = {"controllers": {**plain(trial)["controllers"], name: section}}
    if name not in trial.controllers:
        changes["active"] = name
    return changed_trial(trial, changes)


def bench_loops(problem: TuningProblem, trial: Trial) -> dict[str, ControlLoop]:
    """Return the loop of the running law with every model.

    Raises:
        BadInput: if the bench refuses the law.
    """
    name = problem.settings.controller
    section, source = trial.controllers[name] or {}, f"controllers.{name}"
    form = running_law_at(trial, name, section, problem.point, source).form
    return {label: loop_of(one.plant, form) for label, one in problem.models.items()}


def _measured(
    problem: TuningProblem, x: Vector, loops: dict[str, ControlLoop], stable: dict[str, bool]
) -> tuple[TunedGoal, ...]:
    """Return the goals on their worst models; a margin as the analysis of a loop has it."""
    tuned, before = problem.numbers(x), problem.numbers(problem.structure.start)
    out = []
    for g, goal in enumerate(problem.goals):
        found: list[tuple[GoalNumber, str]] = []
        for m, label in enumerate(problem.models):
            number = tuned[m][g]
            if not stable[label]:
                number = number._replace(value=np.inf)
            elif isinstance(goal.settings, MarginGoal):
                number = _margin(goal.settings, number, goal.parts[0].sources, loops[label])
            found.append((number, label))
        worst, label = max(found, key=lambda pair: pair[0].value)
        first = max(of_model[g].value for of_model in before)
        out.append(
            TunedGoal(goal.label, goal.settings.hard, float(worst.value), label,
                      float(worst.frequency), float(first))
        )  # fmt: skip
    return tuple(out)


def _margin(
    goal: MarginGoal, number: GoalNumber, sources: tuple[str, ...], loop: ControlLoop
) -> GoalNumber:
    """Return the number of a margin from the bench's loop."""
    known = (*loop.effort_names, *loop.sensor_names)
    names = tuple(s.replace("disturbance.", "effort.", 1).removeprefix("noise.") for s in sources)
    if not set(names) <= set(known):
        return number
    found = disk_margins(frequency_response(loop), names)
    return number._replace(value=goal.disk / found.alpha, frequency=found.frequency)
