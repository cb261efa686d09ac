import importlib.util
from pathlib import Path

from flexslew_control.controllers import CONTROLLERS
from flexslew_lab.benchmark.baselines import RESULTS, baselines, merged, read_rows, shipped_results
from flexslew_lab.benchmark.leaderboard import leaderboard_page
from flexslew_lab.benchmark.task import load_task, task_names
from flexslew_lab.trial.trial import law_of
from flexslew_plant.settings import plain

SCRIPT = Path(__file__).parents[3] / "docs" / "make_leaderboard.py"
SPEC = importlib.util.spec_from_file_location("make_leaderboard", SCRIPT)
assert SPEC is not None
assert SPEC.loader is not None
make_leaderboard = importlib.util.module_from_spec(SPEC)
SPEC.loader.exec_module(make_leaderboard)


def test_the_leaderboard_has_every_baseline_of_every_task() -> None:
    for name in task_names():
        task = load_task(name)
        flown = {row["entry"]["name"] for row in shipped_results(task)}
        assert flown == {entry.name for entry in baselines(task)}


def test_every_law_is_a_baseline_of_a_task() -> None:
    flown = set[str]()
    for task in map(load_task, task_names()):
        base = plain(task.trial)
        for entry in baselines(task):
            trial = base | entry.sections
            flown.add(law_of(trial["active"], trial["controllers"][trial["active"]])[0])
    assert flown == CONTROLLERS.keys() - {"policy"}  # which needs a file of its own


def test_the_page_of_the_leaderboard_is_current() -> None:
    text = make_leaderboard.PAGE.read_text(encoding="utf-8")
    assert text == make_leaderboard.page(), "run python docs/make_leaderboard.py"


def test_rows_of_other_tasks_stay_and_the_best_comes_first() -> None:
    rows = read_rows(RESULTS)
    acc = [row | {"score": row["score"] | {"mean": -1.0}} for row in rows if row["task"] == "acc"]
    found = merged(acc[:1], rows)
    assert [row for row in found if row["task"] == "acc"] == acc[:1]
    assert len(found) == len(rows) - len(acc) + 1
    assert [r for r in found if r["task"] == "scole"] == [r for r in rows if r["task"] == "scole"]


def test_the_page_shows_score_over_effort_of_each_task() -> None:
    text = leaderboard_page(read_rows(RESULTS))
    for name in task_names():
        assert f"{name}: score over effort" in text
