"""Tuning from several starts, each kept on the disk as it ends."""

import json
from collections.abc import Callable
from dataclasses import asdict, dataclass
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from flexslew_lab.log.files.whole_file import write_whole
from flexslew_lab.tuning.descent import minimise, stabilised
from flexslew_lab.tuning.problem import TuningProblem
from flexslew_plant.arrays import Vector
from flexslew_plant.errors import BadInput

_ROUNDS = 3  # of scalings of disk margins
_WEIGHTS = (10.0, 100.0, 1000.0)  # of what a hard goal exceeds one
_MET = 1.0 + 1e-9

Count = Callable[[int, int], None]


@dataclass(frozen=True)
class StartOutcome:
    """What one start reached.

    Args:
        number: of the start, from 1.
        parameters: there; none: no stable loop was found.
        hard: largest number of the hard goals; 0: there are none.
        soft: of the soft goals.
        growth: largest growth rate that was reached [1/s]; below 0: stable.
        evaluations: of all goals.
    """

    number: int
    parameters: tuple[float, ...]
    hard: float
    soft: float
    growth: float
    evaluations: int

    @property
    def rank(self) -> tuple[bool, bool, float, float]:
        """Order of starts: stable, hard goals met, then the soft goals, then the hard ones."""
        met = self.hard <= _MET
        return not self.parameters, not met, self.soft if met else self.hard, self.hard


def solve_starts(
    problem: TuningProblem, state: Path | None = None, progress: Count = lambda done, last: None
) -> tuple[StartOutcome, ...]:
    """Return what every start reached.

    Args:
        problem: to be solved.
        state: a file that keeps every start that ended, and from which a tuning goes on; None:
            none.
        progress: called with the evaluations done, and how many there will be at most.

    Raises:
        BadInput: if the file is of another tuning.
    """
    found = _read(state, problem.identity)
    settings, most = problem.settings, problem.settings.starts * problem.settings.evaluations
    for number in range(len(found) + 1, settings.starts + 1):
        before = (number - 1) * settings.evaluations

        def count(done: int, before: int = before) -> None:
            progress(before + min(done, settings.evaluations), most)

        found.append(_from_start(problem, number, count))
        if state is not None:
            _write(state, problem.identity, found)
    progress(most, most)
    return tuple(found)


def _from_start(problem: TuningProblem, number: int, count: Callable[[int], None]) -> StartOutcome:
    rng = np.random.default_rng((problem.settings.seed, number))
    problem.unscaled()
    start = problem.structure.start if number == 1 else problem.structure.other_start(rng)
    x = stabilised(problem.growth, start)
    if x is None:
        growth = problem.growth(start)[0]
        return StartOutcome(number, (), np.inf, np.inf, growth, 0)
    used = 0
    for share in range(1, _ROUNDS + 1):
        most = problem.settings.evaluations * share // _ROUNDS
        x, used = _descend(problem, x, used, most, rng, count)
        if not problem.rescaled(x):
            x, used = _descend(problem, x, used, problem.settings.evaluations, rng, count)
            break
    hard, soft = problem.worst(x, True)[0], problem.worst(x, False)[0]
    return StartOutcome(
        number, tuple(map(float, x)), float(hard), float(soft), problem.growth(x)[0], used
    )


def _descend(
    problem: TuningProblem, x: Vector, used: int, most: int, rng: np.random.Generator,
    count: Callable[[int], None],
) -> tuple[Vector, int]:  # fmt: skip
    """Return parameters after a descent of the hard goals, then of the soft ones among them."""
    has_soft = any(not goal.settings.hard for goal in problem.goals)
    spent = used

    def counted(function: Callable[[Vector], tuple[float, Vector]]) -> Any:
        def evaluate(x: Vector) -> tuple[float, Vector]:
            nonlocal spent
            spent += 1
            count(spent)
            return function(x)

        return evaluate

    if any(goal.settings.hard for goal in problem.goals):
        target = 0.99 if has_soft else -np.inf
        hard = counted(lambda x: problem.worst(x, True))
        x = minimise(hard, x, most - spent, target, rng).x
    for weight in _WEIGHTS if has_soft else ():
        if spent >= most:
            break
        soft = counted(partial(problem.penalised, weight=weight))
        x = minimise(soft, x, most - spent, rng=rng).x
        if problem.worst(x, True)[0] <= _MET:
            break
    return x, spent


def _read(state: Path | None, identity: str) -> list[StartOutcome]:
    if state is None or not state.exists():
        return []
    try:
        kept = json.loads(state.read_text(encoding="utf-8"))
        same = kept["identity"] == identity
        found = [StartOutcome(**{**one, "parameters": tuple(one["parameters"])})
                 for one in kept["starts"]]  # fmt: skip
    except (OSError, ValueError, KeyError, TypeError) as error:
        raise BadInput(f"is no state of a tuning: {error}; give another --out", state) from None
    if not same:
        raise BadInput("is of another tuning; give another --out", state)
    return found


def _write(state: Path, identity: str, found: list[StartOutcome]) -> None:
    state.parent.mkdir(parents=True, exist_ok=True)
    content = {"identity": identity, "starts": [asdict(one) for one in found]}
    write_whole(state, json.dumps(content))
