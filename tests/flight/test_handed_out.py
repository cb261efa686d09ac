"""Nothing that a bench hands out can be written into, in process as over the wire."""

import pickle
from collections.abc import Iterator
from typing import Any

import numpy as np
import pytest
from tests.plants import plant

from flexslew_control.controllers import CONTROLLERS, build_controller
from flexslew_control.controllers.controller import Answer
from flexslew_control.plan import Plan
from flexslew_lab.trial.trial import bench_settings, parse_trial
from flexslew_plant.bench.bench import Bench, Truth
from flexslew_plant.bench.wire import measurement_bytes, measurement_from
from flexslew_plant.measurement import EffortCommand, Measurement

TRIAL = parse_trial(
    """
controllers: {pd_feedforward: {}}
duration: 0.05
sensors: {joint_position: {noise: 1.0e-3}}
actuator: {lag: 0.1, quantisation: 0.01}
""",
    "test",
)


def arrays(record: Any) -> Iterator[tuple[str, Any]]:
    """Yield every array of a record and of the records in it."""
    for name, value in zip(record._fields, record, strict=True):
        if isinstance(value, np.ndarray):
            yield name, value
        elif hasattr(value, "_fields"):
            yield from arrays(value)


class Watch:
    """Notes what could be written into."""

    def __init__(self) -> None:
        self.open: set[str] = set()
        self.seen: set[str] = set()

    def look(self, record: Any) -> None:
        self.seen.add(type(record).__name__)
        for name, value in arrays(record):
            if value.flags.writeable:
                self.open.add(f"{type(record).__name__}.{name}")


def answers(law: str) -> Iterator[tuple[Measurement, Truth, Answer | None]]:
    """Yield what passes between a bench and a law in charge."""
    bench = Bench(bench_settings(TRIAL))
    controller = build_controller("pd_feedforward", law, {}, plant(), law)
    while not bench.done:
        question = bench.question
        answer = controller.observe(question)
        yield question, bench.truth(), answer
        if answer is not None:
            bench.offer(answer.command)
        bench.advance()


@pytest.mark.slow
@pytest.mark.parametrize("law", CONTROLLERS)
def test_measurement_truth_estimate_reference_and_answer_may_only_be_read(law: str) -> None:
    watch = Watch()
    for question, truth, answer in answers(law):
        watch.look(question)
        watch.look(truth)
        if answer is not None:
            watch.look(answer)
        watch.look(measurement_from(measurement_bytes(question), 0.01)[0])
    assert watch.seen >= {"Measurement", "Truth"}
    assert watch.open == set()


def test_the_numbers_of_a_message_lie_where_a_processor_reads_them_at_once() -> None:
    bench = Bench(bench_settings(TRIAL))
    for name in ("a", "ab", "abc", "a_longer_name"):
        question = bench.question._replace(controller=name)
        heard, _ = measurement_from(measurement_bytes(question), 0.01)
        assert heard.controller == name
        for field, value in arrays(heard):
            assert value.flags.aligned, (name, field)
            np.testing.assert_array_equal(value, getattr(question, field))


class Thief:
    """A law that writes into what it was handed."""

    def __init__(self, settings: dict[str, Any], period: float, limit: Any) -> None:
        self.what = settings["what"]

    def update(self, measurement: Any, estimate: Any, reference: Any) -> Any:
        given = {"measurement": measurement, "estimate": estimate, "reference": reference}
        record, field = self.what.split(".")
        value = getattr(given[record], field)
        value -= 1.0
        return np.zeros(2)


@pytest.mark.parametrize(
    "what",
    ["measurement.joint_position", "measurement.applied_effort", "estimate.position",
     "reference.position"],
)  # fmt: skip
def test_a_law_that_writes_into_the_plant_fails_and_the_plant_stays_as_it_is(what: str) -> None:
    bench = Bench(bench_settings(TRIAL))
    name = f"{__name__}.Thief"
    controller = build_controller("pd_feedforward", name, {"what": what}, plant(), "test")
    before = bench.truth()
    assert controller.observe(bench.question) is None
    assert "read-only" in str(controller.reason)
    np.testing.assert_array_equal(bench.truth().position, before.position)


def test_what_becomes_of_a_senders_array_changes_no_effort() -> None:
    bench = Bench(bench_settings(TRIAL))
    effort = np.array([1.0, 2.0])
    assert bench.offer(EffortCommand(0, 0, "pd_feedforward", effort))
    effort[:] = 1e9
    bench.advance()
    assert abs(bench.truth().applied_effort).max() < 3.0


def test_a_plan_may_only_be_read_also_where_another_process_has_sent_it() -> None:
    rows = np.zeros((3, 2))
    plan = Plan("none", ("a", "b"), 0.0, 0.01, rows, rows, rows[1:], np.zeros((3, 0)), 0.02)
    for one in (plan, pickle.loads(pickle.dumps(plan))):
        for tick in (-1, 0, 1, 99):
            assert [n for n, a in arrays(one.reference(tick)) if a.flags.writeable] == []
        with pytest.raises(ValueError, match="read-only"):
            one.position[0] = 1.0
    rows[0] = 0.5  # that of its maker
