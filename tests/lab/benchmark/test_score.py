import numpy as np
import pytest

from flexslew_lab.benchmark.score import ensemble_score, score_of, violation
from flexslew_lab.benchmark.task import Task, load_task


@pytest.fixture(scope="module")
def task() -> Task:
    return load_task("csa-slew")


def good(task: Task, factor: float) -> dict[str, float | None]:
    """Return metrics that are a factor times the half values, and meet the requirements."""
    scored: dict[str, float | None] = {name: factor * t.half for name, t in task.score.items()}
    return {name: 0.0 for name in task.require} | scored


def test_half_values_give_half_of_the_score_and_zero_all_of_it(task: Task) -> None:
    assert score_of(task, good(task, 1.0)) == pytest.approx(50.0)
    assert score_of(task, good(task, 0.0)) == pytest.approx(100.0)
    assert score_of(task, good(task, -3.0)) == pytest.approx(25.0)


def test_a_metric_without_a_value_adds_nothing(task: Task) -> None:
    metrics = good(task, 0.0) | {"settling_time": None}
    assert score_of(task, metrics) == pytest.approx(100.0 - 100.0 * 0.2)


def test_a_failed_member_has_the_worst_score(task: Task) -> None:
    assert score_of(task, None) == 0.0
    far = good(task, 0.0) | {"goal_error": 0.2}
    assert score_of(task, far) == 0.0
    assert violation(task, far) == "goal_error is 0.2, required below 0.1"
    assert violation(task, far | {"goal_error": None}) == "goal_error has no value"


def test_bounds_of_the_mean_shrink_with_the_root_of_the_members() -> None:
    rng = np.random.default_rng(5)
    few = ensemble_score(rng.normal(50.0, 10.0, 64).tolist())
    many = ensemble_score(rng.normal(50.0, 10.0, 6400).tolist())
    assert few.low < few.mean < few.high
    assert few.high - few.low == pytest.approx(2 * 1.96 * 10.0 / 8.0, rel=0.25)
    assert (few.high - few.low) / (many.high - many.low) == pytest.approx(10.0, rel=0.25)
