"""A program in place of a logged controller, without a process: names, plans, repeats, faults."""

from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import AbstractContextManager, contextmanager
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from tests.present import present

from flexslew_control.controllers import build_controller
from flexslew_control.controllers.controller import Controller
from flexslew_control.law import plant_description
from flexslew_control.message_fields import received_plan
from flexslew_lab.log.bag_reader import BagReader
from flexslew_lab.log.messages.cdr import decode, encode
from flexslew_lab.log.recording.bag_writer import BagWriter
from flexslew_lab.replay.check import AnswerTolerance, check
from flexslew_lab.replay.program import compared_controller, logged_plans, replaced_controller
from flexslew_lab.replay.resim import resim
from flexslew_lab.run.run_trial import run_trial
from flexslew_lab.trial.trial import parse_trial
from flexslew_plant.errors import BadInput
from flexslew_plant.graph.topics import TOPICS
from flexslew_plant.measurement import EffortCommand, Measurement

TRIAL = """
name: replaced
duration: 3.0
plan:
  method: reference_only
  model: {variant: complete, modes: 1}
  goal: {base_yaw: 0.1, hub_pitch: 0.05}
  duration: 2.0
controllers: {output_feedback: {}, pd_feedforward: {kp: [460.0, 460.0]}}
active: pd_feedforward
schedule: [{at: 1.0, switch: output_feedback}, {at: 2.0, switch: pd_feedforward}]
"""
PD = {"kp": [460.0, 460.0]}
Start = Callable[
    [Mapping[str, Any], Sequence[bytes]], AbstractContextManager["LawInPlaceOfProgram"]
]


class LawInPlaceOfProgram:
    """A law of the bench that answers as a program would, and notes what it receives."""

    command, reason = "./program", ""

    def __init__(self, controller: Controller, plans: Sequence[bytes]) -> None:
        self._controller, self.name = controller, controller.name
        self.questions: list[Measurement] = []
        self.plans: list[tuple[int, str]] = []  # questions before it, hash
        for plan in plans:
            self.publish_plan(plan)

    def publish_plan(self, data: bytes) -> None:
        message = decode(TOPICS["plan"].type, data)
        self.plans.append((len(self.questions), message.hash))
        assert self._controller.adopt(*received_plan(message, "test")) is None

    def observe(self, question: Measurement) -> EffortCommand | None:
        self.questions.append(question)
        answer = self._controller.observe(question)
        return None if answer is None else answer.command._replace(instance=7)


def program(
    law: str, settings: dict[str, Any], name: str, started: list[LawInPlaceOfProgram]
) -> Start:
    """Return what starts a law as a program with this name."""

    @contextmanager
    def start(testbed: Mapping[str, Any], plans: Sequence[bytes]) -> Iterator[LawInPlaceOfProgram]:
        plant = plant_description(testbed["settings"], "test")
        built = build_controller(name, law, settings, plant, "test")
        started.append(LawInPlaceOfProgram(built, plans))
        yield started[-1]

    return start


@pytest.fixture(scope="module")
def flown(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("replaced") / "run"
    run_trial(parse_trial(TRIAL, "test"), "test", folder, in_process=True, report=False)
    return folder / "bag"


@pytest.mark.parametrize(("law", "settings"), [("pd_feedforward", PD), ("output_feedback", {})])
@pytest.mark.parametrize("name", ["port", "pd_feedforward", "output_feedback"])
def test_a_program_with_the_law_gives_the_recorded_answers_under_any_name(
    flown: Path, law: str, settings: dict[str, Any], name: str
) -> None:
    started: list[LawInPlaceOfProgram] = []
    start = program(law, settings, name, started)
    result = check(flown, law, program=start)
    assert (result.ok, result.law) == (True, "./program")
    assert result.ticks == {"pd_feedforward": 200, "output_feedback": 100}[law]
    assert [row.field for row in result.rows] == ["stamp", "effort[base_yaw]", "effort[hub_pitch]"]
    assert resim(flown, program=start, controller=law).identical
    for one in started:
        assert [question.tick for question in one.questions] == [*range(300)]
        assert sum(question.controller == name for question in one.questions) == result.ticks


def test_the_plan_of_the_log_comes_before_the_first_question(flown: Path) -> None:
    started: list[LawInPlaceOfProgram] = []
    check(flown, "", program=program("pd_feedforward", PD, "port", started))
    (plan,) = BagReader(flown).overview.plans
    assert started[0].plans == [(0, plan.hash)]


def test_a_plan_in_flight_comes_before_the_question_that_followed_it(
    flown: Path, tmp_path: Path
) -> None:
    bag, plan = BagReader(flown), TOPICS["plan"].type
    with BagWriter(tmp_path / "later", bag.metadata) as writer:
        for topic, kind, stamp, _, data in bag.messages():
            writer.write(topic, kind, data, stamp)
            if topic == "/measurement" and decode(kind, data).tick == 120:
                writer.write("/plan", plan, encode(plan, bag.overview.plans[0]), stamp)
        writer.close({})
    assert [key for key, _ in logged_plans(BagReader(tmp_path / "later"))] == [(0, 0), (0, 121)]


def test_a_repeated_question_of_a_log_is_asked_once(flown: Path, tmp_path: Path) -> None:
    bag = BagReader(flown)
    with BagWriter(tmp_path / "run", bag.metadata) as writer:
        for topic, kind, stamp, _, data in bag.messages():
            for _ in range(3 if topic == "/measurement" else 1):
                writer.write(topic, kind, data, stamp)
        writer.close({})
    started: list[LawInPlaceOfProgram] = []
    result = check(tmp_path / "run", "", program=program("pd_feedforward", PD, "port", started))
    assert (result.ok, result.ticks) == (True, 200)
    assert len(started[0].questions) == 300


def test_a_tolerance_is_relative_to_the_peak_of_each_field_or_absolute(flown: Path) -> None:
    off = {"kp": [460.0 * (1 + 1e-6), 460.0]}
    found = check(flown, "pd_feedforward", settings=off)
    effort = next(row for row in found.rows if row.field == "effort")
    start = program("pd_feedforward", off, "port", [])
    yaw = next(r for r in check(flown, program=start, controller="").rows if r.largest)
    assert (yaw.field, yaw.largest) == ("effort[base_yaw]", effort.largest)
    for relative in (0.99 * yaw.relative, 1.01 * yaw.relative):
        result = check(flown, "", program=start, tolerance=AnswerTolerance(relative))
        assert result.ok == (relative > yaw.relative)
        row = next(row for row in result.rows if row.field == yaw.field)
        assert row.largest == yaw.largest
        assert (row.first_tick is None) == result.ok
    for absolute in (0.99 * effort.largest, 1.01 * effort.largest):
        by_law = check(
            flown, "pd_feedforward", settings=off, tolerance=AnswerTolerance(0, absolute)
        )
        rows = {row.field: row for row in by_law.rows}
        assert (rows["effort"].different == 0) == (absolute > effort.largest)


def test_the_default_is_the_first_active_controller_or_the_only_program(
    flown: Path, tmp_path: Path
) -> None:
    bag, kind = BagReader(flown), TOPICS["controller_status"].type
    assert compared_controller(bag) == replaced_controller(bag) == "pd_feedforward"
    with BagWriter(tmp_path / "other", bag.metadata) as writer:
        status = {"controller": "rust", "law": "pd in Rust", "ready": True}
        writer.write("/controller_status", kind, encode(kind, status), 0)
        for topic, name, stamp, _, data in bag.messages():
            writer.write(topic, name, data, stamp)
        writer.close({})
    other = BagReader(tmp_path / "other")
    assert (compared_controller(other), replaced_controller(other)) == ("pd_feedforward", "rust")
    with pytest.raises(BadInput, match="no controller c; it has output_feedback, pd_feedforward"):
        replaced_controller(other, "c")
    with pytest.raises(BadInput, match=r"pd in Rust is not a law.* by --with COMMAND"):
        resim(tmp_path / "other")
    started: list[LawInPlaceOfProgram] = []
    start = program("pd_feedforward", {}, "rust", started)
    assert resim(tmp_path / "other", program=start).identical
    assert not any(question.controller == "rust" for question in started[0].questions)
    with pytest.raises(BadInput, match="rust has not answered in this log"):
        check(tmp_path / "other", "", program=start)


def test_an_answer_of_another_size_in_the_log_is_a_divergence(flown: Path, tmp_path: Path) -> None:
    bag = BagReader(flown)
    with BagWriter(tmp_path / "run", bag.metadata) as writer:
        for topic, kind, stamp, _, data in bag.messages():
            if topic == "/effort_command" and (message := decode(kind, data)).tick == 50:
                message.effort = np.zeros(3)
                data = encode(kind, message)
            writer.write(topic, kind, data, stamp)
        writer.close({})
    result = check(tmp_path / "run", "", program=program("pd_feedforward", PD, "port", []))
    first = present(result.first_divergence)
    assert (first.tick, first.field) == (50, "effort[base_yaw]")
    assert np.isnan(first.recorded)
