"""Every metric of the table, and one of the user's own."""

import json
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
from tests.lab.metrics.blocks import ticks_of

from flexslew_lab.cli.output.summary import metric_rows
from flexslew_lab.log.bag_reader import BagReader
from flexslew_lab.metrics import KEYS, METRICS, Metric
from flexslew_lab.metrics.from_bag import metrics_of, user_keys_of
from flexslew_lab.metrics.metric import Block, Ending, ReferenceManoeuvre, RunSetup
from flexslew_lab.metrics.own import load_user_metrics
from flexslew_lab.metrics.rows import flat
from flexslew_lab.reproduce.scole_flights import example_trial
from flexslew_lab.run.run_trial import run_trial
from flexslew_lab.trial.sources import trial_path
from flexslew_lab.trial.trial import load_trial, parse_trial
from flexslew_plant.errors import BadInput
from flexslew_plant.events import (
    AnswerMissing,
    Event,
    Fact,
    FallbackActivated,
    FaultChanged,
    RunFinished,
    SwitchCompleted,
    event_of,
)
from flexslew_plant.own_code import ANY_CODE
from flexslew_plant.testbeds import initial_state

OWN = '''
from flexslew_lab.metrics import Key

class Travel:
    """How far the first joint travels in all."""

    KEYS = {"travel": Key("rad or m", False, "total distance travelled by the first joint")}

    def __init__(self, setup):
        self.way, self.last = 0.0, None

    def add(self, block):
        q = block.position[:, 0]
        self.way += float(abs(q[0] - (q[0] if self.last is None else self.last)))
        self.way += float(sum(abs(q[1:] - q[:-1])))
        self.last = q[-1]

    def result(self, ending):
        return {"travel": self.way}
'''
TRIAL = """
duration: 2.0
plan: {method: none, goal: {base_yaw: 0.2}, duration: 1.0}
metrics: [OWN]
"""

_TWICE = [{"to": 0.3, "at": 0.5, "duration": 0.06}, {"to": 0.1, "at": 0.6, "duration": 0.01}]
TURNING = example_trial(
    "antenna_4", {"testbed": {"appendages": {"beam": {"hinge": {"motion": _TWICE}}}}}
).testbed


def flown(name: str, ticks: int, rng: np.random.Generator) -> tuple[RunSetup, Block]:
    """Return a run of a shipped trial's testbed under random efforts, its manoeuvre half-way."""
    craft = TURNING if name == "antenna" else load_trial(trial_path(name)).testbed
    model, x = craft.model(), initial_state(craft)
    limit = np.array(craft.effort_limit)
    effort = rng.uniform(-1.5, 1.5, (ticks, model.joints)).clip(-1.0, 1.0) * limit
    states, joints = [], []
    for push in effort:
        states.append(model.split(x))
        q = states[-1][0]
        joints.append(q[: model.joints] if model.reading is None else model.reading(x)[0])
        x = model.advance(x, push, 0.004)
    time = 0.5 + np.arange(ticks, dtype=float) * 0.004
    goal = joints[0] + [craft.typical_goal.get(joint, 0.0) for joint in model.joint_names]
    manoeuvre = ReferenceManoeuvre(time[ticks // 4], time[ticks // 2], goal, goal - joints[0])
    block = Block(
        np.arange(3, 3 + ticks), time, np.diff(time, prepend=time[0]),
        np.array([q for q, _ in states]), np.array([v for _, v in states]), effort,
        rng.normal(0.0, 0.1, (ticks, len(model.appendages.names))), np.array(joints) - goal,
        time >= manoeuvre.start, time >= manoeuvre.end,
    )  # fmt: skip
    return RunSetup(tuple(model.joint_names), manoeuvre, limit, craft), block


def cut(block: Block, where: list[int]) -> list[Block]:
    return [ticks_of(block, a, b) for a, b in pairwise(where)]


def events() -> list[Event]:
    facts: list[Fact] = [
        SwitchCompleted("a", "b", [0.5, -0.7]),
        AnswerMissing("b", ticks=3),
        FaultChanged(on=True),
        FaultChanged(on=False),
        FallbackActivated("a", "b"),
        RunFinished(wall_time=1.5),
    ]
    return [event_of(fact, 0, 0.0, 0, "plant") for fact in facts]


@pytest.mark.parametrize("kind", ["m1", "time_optimal_oscillator", "scole_s_open", "antenna"])
@pytest.mark.parametrize("name", METRICS)
def test_a_metric_does_not_depend_on_how_the_run_is_cut(name: str, kind: str) -> None:
    rng = np.random.default_rng(5)
    setup, block = flown(kind, 60, rng)
    if not METRICS[name].is_for(setup.testbed):
        return
    ending = Ending(events(), [], True, ("said",))
    whole = METRICS[name].metric(setup)
    whole.add(block)
    expected = flat(whole.result(ending))
    for _ in range(5):
        where = [0, *sorted(rng.choice(np.arange(1, 60), 4, replace=False).tolist()), 60]
        pieces = METRICS[name].metric(setup)
        for piece in cut(block, where):
            pieces.add(piece)
        assert flat(pieces.result(ending)) == expected  # to the last bit


@pytest.mark.parametrize("kind", ["m1", "time_optimal_oscillator", "scole_s_open", "antenna"])
@pytest.mark.parametrize("name", METRICS)
def test_a_metric_says_what_it_promises_in_json(name: str, kind: str) -> None:
    setup, block = flown(kind, 30, np.random.default_rng(6))
    if not METRICS[name].is_for(setup.testbed):
        return
    for blocks in ([block], []):
        metric = METRICS[name].metric(setup)
        for each in blocks:
            metric.add(each)
        found = metric.result(Ending(events(), [2.0], False))
        assert set(found) in (set(METRICS[name].metric.KEYS), set())
        json.dumps(found, allow_nan=False)
        for key, value in found.items():
            if METRICS[name].metric.KEYS[key].per_joint:
                assert list(value) == list(setup.joint_names)


def test_the_page_on_metrics_lists_every_key_with_its_unit_and_meaning() -> None:
    page = (Path(__file__).parents[3] / "docs/metrics.md").read_text()
    for key, metric in KEYS.items():
        meaning = metric.meaning.replace("|", "\\|")
        joint = "yes" if metric.per_joint else ""
        assert f"| `{key}` | {metric.unit} | {joint} | {meaning} |" in page


def test_a_metric_of_the_user_s_own_is_measured_in_every_run(tmp_path: Path) -> None:
    (tmp_path / "travel.py").write_text(OWN)
    trial = parse_trial(TRIAL.replace("OWN", f"{tmp_path}/travel.py:Travel"), "test", ANY_CODE)
    result = run_trial(trial, "test", tmp_path / "run", in_process=True)
    yaw = BagReader(tmp_path / "run/bag").columns("/truth", {"position"})["position"][:, 0]
    assert result.metrics["travel"] == pytest.approx(np.abs(np.diff(yaw)).sum()) != 0.0
    page = (tmp_path / "run/report.html").read_text()
    assert "total distance travelled by the first joint" in page  # what its key says of it
    bag = BagReader(tmp_path / "run/bag", trust=ANY_CODE)
    assert user_keys_of(bag)["travel"].unit == "rad or m"
    rows = metric_rows(result.metrics, {"base_yaw": "rad"}, user_keys_of(bag))
    assert next(row[2] for row in rows if row[0] == "travel") == "rad"
    metrics = metrics_of(tmp_path / "run/bag")  # as a received log is read
    assert "travel" not in metrics
    assert f"allow it with --trust {tmp_path}/travel.py:Travel" in metrics["warnings"][0]


@pytest.mark.parametrize(
    ("code", "words"),
    [
        ("class Travel:\n    pass\n", "needs KEYS"),
        (OWN.replace("def result", "def results"), "it has no result"),
        (OWN.replace('"travel": Key', '"ticks": Key'), "the key ticks is taken by the bench"),
        (OWN.replace("class Travel", "class Other"), "cannot be loaded"),
    ],
)
def test_what_is_no_metric_is_refused_before_the_flight(
    tmp_path: Path, code: str, words: str
) -> None:
    (tmp_path / "travel.py").write_text(code)
    trial = parse_trial(TRIAL.replace("OWN", f"{tmp_path}/travel.py:Travel"), "test", ANY_CODE)
    with pytest.raises(BadInput, match=f"test: metrics: .*{words}"):
        run_trial(trial, "test", tmp_path / "run", in_process=True)
    assert not (tmp_path / "run").exists()


def test_two_metrics_with_one_key_are_refused(tmp_path: Path) -> None:
    for name in ("one", "two"):
        (tmp_path / f"{name}.py").write_text(OWN)
    names = [f"{tmp_path}/{name}.py:Travel" for name in ("one", "two")]
    with pytest.raises(BadInput, match=r"travel is taken by .*one\.py:Travel"):
        load_user_metrics(names, "test", ANY_CODE)


def test_every_metric_is_a_metric() -> None:
    for entry in METRICS.values():
        _: type[Metric] = entry.metric
        assert entry.metric.KEYS


def test_the_wall_time_is_what_the_plant_says_at_its_end_or_else_the_recorded_one() -> None:
    setup, block = flown("m1", 30, np.random.default_rng(6))
    metric = METRICS["CourseMetric"].metric(setup)
    metric.add(block)
    assert metric.result(Ending(events(), [], True))["wall_time"] == 1.5
    assert metric.result(Ending([], [2.0], True))["wall_time"] == 2.0
    assert metric.result(Ending([], [], True))["wall_time"] is None
