"""A budget's total against flights of the non-linear bench: members that differ by their seed."""

from collections.abc import Callable, Iterator
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from scipy.stats import t

from flexslew_lab.budget.budget import Budget
from flexslew_lab.budget.contribution import sum_parts
from flexslew_lab.budget.error_free import simulate
from flexslew_lab.studies.batch.fleet import BatchRunner, ReadyTrial
from flexslew_lab.studies.batch.legs import BatchFlight, FlightMode
from flexslew_lab.studies.batch.recorded import TICKS
from flexslew_lab.studies.cases import Case, case_trial, trial_seed
from flexslew_lab.studies.flight import PlanCache
from flexslew_lab.studies.study import study_of_values
from flexslew_lab.studies.ways import Way
from flexslew_lab.trial.trial import Trial
from flexslew_plant.arrays import Matrix, Vector
from flexslew_plant.errors import BadInput
from flexslew_plant.testbeds.compiled.batch_kernel import BATCH_WIDTH

LINEAR = 0.05  # largest error of linear theory that agrees, of the root mean square [-]
_CONFIDENCE = 0.9973  # of the scatter of the flown root mean square, by Student's t [-]


class ProvedMetric(NamedTuple):
    """A metric on an axis.

    Args:
        metric, axis: by name.
        predicted: root mean square over points and members by the budget [rad or m].
        flown: by the bench [rad or m].
        error: standard error of `flown`, from the scatter between members [rad or m].
        inside: share of points of all members that the total bounds [-].
        agrees: |flown - predicted| is at most LINEAR of the prediction and the standard errors that
            contain 99.73 % by Student's t, about three.
    """

    metric: str
    axis: str
    predicted: float
    flown: float
    error: float
    inside: float
    agrees: bool


@dataclass(frozen=True, repr=False)
class ProvedBudget:
    """A budget's total, flown.

    Args:
        members: how many were flown.
        metrics: by metric and axis.
    """

    members: int
    metrics: tuple[ProvedMetric, ...]

    def __repr__(self) -> str:
        """Return one line: how many metrics were flown as predicted."""
        return f"<ProvedBudget: {self.verdict}>"

    @property
    def holds(self) -> bool:
        """Everything agrees."""
        return all(one.agrees for one in self.metrics)

    @property
    def verdict(self) -> str:
        """The result in a sentence."""
        count, ratios = len(self.metrics), [m.flown / m.predicted for m in self.metrics]
        agreed = sum(one.agrees for one in self.metrics)
        return (
            f"{agreed} of {count} metrics flown as predicted by {self.members} members, flown over "
            f"predicted {min(ratios):.3f} to {max(ratios):.3f}"
        )

    def plain(self) -> dict[str, Any]:
        """Return it as plain data."""
        return asdict(self) | {
            "metrics": [one._asdict() for one in self.metrics], "holds": self.holds
        }  # fmt: skip


def prove_budget(
    trial: Trial,
    source: str,
    budget: Budget,
    members: int,
    progress: Callable[[int, int], None] | None = None,
) -> ProvedBudget:
    """Return the total of a budget together with flights of the bench.

    Args:
        trial: of the budget, with all its error sources.
        source: its file, for an error.
        budget: its budget.
        members: how many are flown, each with noises of its own.
        progress: called with the members that were flown and with all.

    Raises:
        BadInput: if the budget has errors of the model, which a trial does not draw, lacks a
            source, or a flight fails.
    """
    if members < 2:
        raise BadInput("at least 2 members", key="--prove", value=members)
    if budget.request.vary:
        raise BadInput("--prove: not with --vary: members of a trial draw no errors of the model")
    if budget.request.controller not in (None, trial.active):
        raise BadInput("--prove: flies the controllers of the trial's schedule; omit --controller")
    squares: dict[str, list[Vector]] = {}
    inside: dict[str, list[Vector]] = {}
    total = budget.total.bounds
    for number, error in enumerate(_flights(trial, source, budget, members), 1):
        for metric, values in budget.windows.of_series(error).items():
            squares.setdefault(metric, []).append((values**2).mean(axis=0))
            bounded = abs(values) <= total[metric].value
            inside.setdefault(metric, []).append(bounded.mean(axis=0))
        if progress is not None:
            progress(number, members)
    found = [
        one
        for metric in squares
        for one in _compared(budget, metric, np.array(squares[metric]), np.array(inside[metric]))
    ]
    return ProvedBudget(members, tuple(found))


def _compared(budget: Budget, metric: str, squares: Matrix, inside: Matrix) -> list[ProvedMetric]:
    """Return a metric by axis; squares and shares inside of all members, (members, axes)."""
    d, b, n = sum_parts(one.parts[metric] for one in budget.contributions if metric in one.parts)
    predicted = np.sqrt((d**2 + b + n).mean(axis=0))
    flown = np.sqrt(squares.mean(axis=0))
    scatter = squares.std(axis=0, ddof=1) / np.sqrt(len(squares))
    error = scatter / (2.0 * np.maximum(flown, np.finfo(float).tiny))
    errors = float(t.ppf(0.5 * (1.0 + _CONFIDENCE), len(squares) - 1))  # 3.03 of 500 members
    agrees = abs(flown - predicted) <= LINEAR * predicted + errors * error
    share = inside.mean(axis=0)
    return [
        ProvedMetric(
            metric,
            axis,
            float(predicted[k]),
            float(flown[k]),
            float(error[k]),
            float(share[k]),
            bool(agrees[k]),
        )
        for k, axis in enumerate(budget.axes.names)
    ]


def _flights(trial: Trial, source: str, budget: Budget, members: int) -> Iterator[Matrix]:
    """Yield the errors of every member, shape (ticks, axes): in batches where these can fly it."""
    bias = trial.sensors.joint_position.bias
    keys = {
        "study": "budget",
        "trial": trial.name,
        "seed": trial.seed,
        "vary": {"sensors.joint_position.bias": {"choice": [bias, bias + 1.0]}},
    }
    study = study_of_values(keys, source, Path(), trial.trust, trial)
    runner = BatchRunner(study, PlanCache())
    # a study varies something: here it is what it was, and members differ by their seed alone
    cases = [Case(k, k, 0, trial_seed(trial.seed, k), (bias,)) for k in range(members)]
    groups: dict[Any, list[ReadyTrial]] = {}
    for case, ready in runner.all_ready(cases):
        if isinstance(ready, Way):
            one = case_trial(study, case)
            plan = runner.plans.of(one)
            error = simulate(trial, one, source, plan, budget.loop).error
            yield error[:, : len(budget.axes.names)]
            continue
        group = groups.setdefault(ready.group, [])
        group.append(ready)
        if len(group) == BATCH_WIDTH:
            yield from _batch(groups.pop(ready.group), budget)
    for group in groups.values():
        yield from _batch(group, budget)


def _batch(ready: list[ReadyTrial], budget: Budget) -> Iterator[Matrix]:
    """Yield the errors of a group that flies side by side."""
    law, model = ready[0].law, ready[0].member.model
    full = [*ready, *(ready[-1] for _ in range(BATCH_WIDTH - len(ready)))]
    flight = BatchFlight(
        [one.member for one in full],
        [one.law.segments for one in full],
        np.array([one.gains for one in full]),
        law.schedule,
        law.target,
        len(ready),
        FlightMode(True),
    )
    size = model.positions + model.coordinates
    record = np.empty((BATCH_WIDTH, TICKS, size + model.joints))
    states = []
    for first, last in flight.intervals(TICKS):
        flight.fly(first, last, record)
        states.append(record[:, : last - first, :size].copy())
    joints = law.goal.goal
    for member in np.concatenate(states, axis=1)[: len(ready)]:
        position, _ = model.joint_states(np.ascontiguousarray(member))
        goal = position[0] if joints is None else joints
        yield -model.joint_error(position, goal) @ budget.axes.from_joints.T
