"""A member of a task on the bench itself, observed and scored tick by tick."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from flexslew_control.plan import Plan
from flexslew_lab.gym.episodes import Episodes
from flexslew_lab.metrics.efforts import saturation_excess
from flexslew_lab.metrics.from_bag import manoeuvre_of
from flexslew_lab.run.metrics_observer import MetricsObserver
from flexslew_lab.studies.batch.stepped import RUNNING, RunningTerm
from flexslew_lab.studies.flight import columns_of
from flexslew_lab.trial.trial import set_plan, set_up
from flexslew_plant.arrays import Vector
from flexslew_plant.bench.bench import Bench, Truth
from flexslew_plant.events import Started

_ROUNDING = 1e-9  # of a time [s]


class BenchEnvironment:
    """Steps a bench and its controller with actions, as an environment does.

    Args:
        task: name of the task.
        settings: of Episodes.
        member: seed of the member.
    """

    def __init__(self, task: str, settings: Mapping[str, Any], member: int) -> None:
        self._episodes = Episodes(task, **settings)
        trial = self._episodes.trial(member)
        self._bench, controllers = set_up(trial, trial.name)
        plan = self._episodes.plans.of(trial)
        assert set_plan(controllers, trial.active, plan) is None
        self._controller = controllers[trial.active]
        self._law: Any = self._controller.law
        self._metrics = MetricsObserver(self._bench, plan)
        self._running = _RunningScore(self._bench, plan, self._episodes.terms)
        self._bench.tell(Started())
        self._score = self._measure()
        self.observation = self._observe()

    def step(self, action: Vector) -> float:
        """Let an action act for a tick; return the reward."""
        self._law.action = np.asarray(action, dtype=np.float64)
        answer = self._controller.observe(self._bench.question)
        assert answer is not None
        self._bench.offer(answer.command)
        self._bench.advance()
        before, self._score = self._score, self._measure()
        self.observation = self._observe()
        return self._score - before

    def score(self) -> float:
        """Return the score of the member after its last tick."""
        return self._episodes.score(columns_of(self._metrics.result()))

    def _observe(self) -> Vector:
        question, controller = self._bench.question, self._controller
        controller.observe(question._replace(controller=""))  # estimated, and not answered yet
        observed: Vector = self._law.observe(
            question, controller.estimate, controller.reference(question.tick)
        )
        return np.where(np.isfinite(observed), observed, 0.0)

    def _measure(self) -> float:
        truth = self._bench.truth()
        self._metrics.truth(truth)
        while self._bench.events:
            self._metrics.event(self._bench.events.popleft())
        return self._running.update(truth)


class _RunningScore:
    """The sum of weight / (1 + value / half), as stepped_loop counts it in a batch.

    Args:
        bench: at tick 0.
        plan: that is flown; None: the manoeuvre is over from the start.
        terms: of the score.
    """

    def __init__(self, bench: Bench, plan: Plan | None, terms: Sequence[RunningTerm]) -> None:
        self._model, self._limit = bench.model, bench.limit
        self._period, self._terms = bench.settings.period, terms
        self._end, self._goal = 0.0, np.full(bench.limit.size, np.nan)
        if plan is not None:
            manoeuvre = manoeuvre_of(
                plan.position, plan.velocity, plan.start, plan.duration, bench.testbed
            )
            self._end = manoeuvre.end
            self._goal = self._goal if manoeuvre.goal is None else manoeuvre.goal
        self._values = dict.fromkeys((term.metric for term in terms), 0.0)

    def update(self, truth: Truth) -> float:
        """Return the running score after a tick."""
        values = self._values
        over = truth.time >= self._end - _ROUNDING
        for name in values:
            value = self._measure(name, truth, over)
            _, adds_up = RUNNING[name]
            values[name] = values[name] + value if adds_up else max(values[name], value)
        return sum(term.weight / (1.0 + values[term.metric] / term.half) for term in self._terms)

    def _measure(self, name: str, truth: Truth, over: bool) -> float:
        """Return what a tick adds to a metric, or its value at the tick."""
        held, effort = self._period if truth.tick else 0.0, truth.applied_effort
        match name:
            case "residual_tip_deflection" | "peak_tip_deflection":
                counted = over or name.startswith("peak")
                return _largest(truth.tip_deflection) if counted else 0.0
            case "residual_attitude_error":
                x = np.concatenate((truth.position, truth.velocity))
                return _largest(self._model.joint_state(x)[0] - self._goal) if over else 0.0
            case "peak_effort":
                return _largest(effort)
            case "control_effort":
                return held * float(effort.dot(effort))
            case _:
                full = (saturation_excess(effort, self._limit) >= 0.0).any()
                return held if full else 0.0


def _largest(values: Vector) -> float:
    return float(np.abs(values).max(initial=0.0))
