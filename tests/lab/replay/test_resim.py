"""The run again from its log: the demo with a fallback, wishes typed by hand, and a lie.

Random sessions: `--cases 1000` draws a thousand.
"""

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from tests.present import present
from tests.representatives import products, representatives

from flexslew_lab.log.bag_layout import TOPICS
from flexslew_lab.log.bag_reader import BagReader
from flexslew_lab.log.messages.cdr import decode, encode
from flexslew_lab.log.recording.bag_observer import BagObserver
from flexslew_lab.log.recording.bag_writer import BagWriter
from flexslew_lab.metrics.from_bag import metrics_of
from flexslew_lab.replay.logged_controllers import plan_changes
from flexslew_lab.replay.resim import resim
from flexslew_lab.run.in_process import run_bench
from flexslew_lab.run.run_trial import run_trial
from flexslew_lab.trial.sources import trial_path
from flexslew_lab.trial.trial import (
    bench_settings,
    build_controllers,
    load_trial,
    parse_trial,
    plan_of_trial,
    trial_text,
)
from flexslew_plant.bench.bench import Bench, SwitchRequest
from flexslew_plant.errors import BadInput
from flexslew_plant.events import SwitchDropped, SwitchRequested, kind_of
from flexslew_plant.measurement import EffortCommand
from flexslew_plant.refusal import Cause, Refusal

TRIAL = """
name: by_hand
duration: 12.0
sensors: {joint_position: {noise: 1.0e-5}}
plan:
  method: reference_only
  model: {variant: complete, modes: 1}
  goal: {base_yaw: 0.1, hub_pitch: 0.05}
  duration: 5.0
controllers: {pd_feedforward: {}, output_feedback: {mode: tracking_a}, lqr: {}}
fallback: [lqr]
allow_faults: true
"""


class Operated(Bench):
    """A bench with an operator at it, and answers that may never come."""

    wishes: list[Any]
    without_link: Any
    observer: Any
    controllers: Any
    again: bool

    def advance(self) -> None:
        due = [wish for tick, wish in self.wishes if tick == self.tick]
        self.wishes = [(tick, wish) for tick, wish in self.wishes if tick != self.tick]
        for wish in due:
            wish(self)
        super().advance()
        if self.again:
            self.again = False
            self.observer.question(self.question)  # the tick had begun
            self.observer.truth(self.truth())
            for controller in self.controllers.values():
                controller.observe(self.question)
            self.reset()

    def offer(self, command: EffortCommand) -> bool:
        return command.tick not in self.without_link and super().offer(command)


def record(
    folder: Path, wishes: Any = (), unheard: Any = (), text: str = TRIAL, taken: int = 0
) -> Path:
    """Fly with an operator; the controllers take the plan before the question `taken`."""
    trial = parse_trial(text, "test")
    bench = Operated(bench_settings(trial))
    bench.without_link, bench.again = unheard, False
    bench.controllers = controllers = build_controllers(trial, "test")
    plan = present(plan_of_trial(trial))
    bench.wishes = [*wishes, (taken - 1, lambda _: adopt())]

    def adopt() -> None:
        assert {controller.adopt(plan) for controller in controllers.values()} == {None}

    if taken == 0:
        adopt()
    with BagWriter(folder, {"trial": trial_text(trial)}) as writer:
        bench.observer = observer = BagObserver(writer)
        observer.notify(trial, bench, plan, controllers)
        run_bench(bench, controllers, observer)
    return folder


def switch(*request: Any) -> Any:
    return lambda bench: bench.request_switch(SwitchRequest(*request))


@pytest.mark.slow
def test_the_swap_demo_flies_again_to_the_same_hash(tmp_path: Path) -> None:
    demo = trial_path("swap_demo")
    result = run_trial(load_trial(demo), str(demo), tmp_path / "run", in_process=True, report=False)
    again = resim(tmp_path / "run" / "bag")
    assert again.identical
    assert again.first_difference is None
    assert again.hash == again.recorded_hash == result.metrics["trajectory_hash"]
    assert again.ticks == 10_001


@pytest.mark.slow
def test_switches_faults_and_disturbances_by_hand_come_at_their_ticks(tmp_path: Path) -> None:
    wishes = [
        (100, switch("output_feedback", 150)),
        (300, switch("lqr", 0, True, -1.0)),  # refused when it comes: any step is larger
        (400, lambda bench: bench.inject("{disturbance: {base_yaw: 3.0}, until: 6.5}")),
        (500, lambda bench: bench.inject("{kind: command_lost, probability: 0.2}", 600)),
        (900, switch("pd_feedforward", 0)),
        (950, lambda bench: bench.inject("{kind: controller_silent, controller: pd_feedforward}")),
    ]
    bag = record(tmp_path / "bag", wishes)
    kinds = [event.kind for event in BagReader(bag).overview.events]
    assert {"switched", "switch_refused", "disturbance", "missed", "fallback"} <= {*kinds}
    again = resim(bag)
    assert again.first_difference is None
    assert again.identical
    assert again.replayed["switch_requested"] == again.replayed["injected"] == 3
    assert again.hash == metrics_of(bag)["trajectory_hash"]
    assert again.hash != resim(record(tmp_path / "undisturbed")).hash


FAULTS = ("command_lost", "command_late", "command_duplicated", "command_reordered")
LAWS = ("pd_feedforward", "output_feedback", "lqr")


def any_wish(rng: np.random.Generator) -> Any:
    """Return something that an operator may want, or that becomes of a controller."""
    law, soon = str(rng.choice(LAWS)), int(rng.integers(0, 20))
    strict, step = bool(rng.random() < 0.3), float(rng.choice([-1.0, 5.0]))
    fault = f"{{kind: {rng.choice(FAULTS)}, probability: {rng.choice([0.3, 1.0])}}}"
    wishes = (
        lambda bench: bench.brake(True),
        lambda bench: bench.brake(False),
        lambda bench: bench.request_switch(SwitchRequest(law, bench.tick + soon, strict, step)),
        lambda bench: bench.request_switch(SwitchRequest(law, 0, strict, step)),
        lambda bench: bench.set_ready_status(law, None if strict else Refusal("it is elsewhere")),
        lambda bench: bench.inject(fault, bench.tick + soon),
        lambda bench: bench.inject(f"{{kind: controller_silent, controller: {law}}}"),
        lambda bench: bench.end_fault(int(rng.integers(0, 4))),
        lambda bench: setattr(bench, "again", strict),
    )
    return wishes[int(rng.integers(len(wishes)))]


def test_any_session_flies_again_with_the_same_bits(
    tmp_path: Path, case: np.random.Generator
) -> None:
    rng = case
    bursts = rng.integers(0, 1150, 15)  # several wishes at once and shortly after one another
    wishes = [(int(rng.choice(bursts) + rng.integers(0, 4)), any_wish(rng)) for _ in range(60)]
    alone = set(rng.integers(0, 1200, 60).tolist())
    rows = {int(first) + k for first in rng.integers(0, 1150, 8) for k in range(rng.integers(2, 9))}
    bag = record(tmp_path / "bag", wishes, alone | rows)
    again = resim(bag)
    assert again.first_difference is None
    assert again.identical
    assert again.missing == ""


DROPS = [  # one switch for each cause for which it can be dropped
    (95, switch("lqr", 100)),
    (99, lambda bench: bench.set_ready_status("lqr", Refusal("it is elsewhere"))),  # when due
    (110, switch("output_feedback", 120)),
    (111, switch("output_feedback", 130)),  # already in charge when due
    (150, switch("pd_feedforward", 160)),
    (158, lambda bench: bench.brake(True)),  # latched before it is due
    (170, lambda bench: bench.brake(False)),
    (175, switch("pd_feedforward", 180)),
    (300, switch("output_feedback", 400)),
    (350, lambda bench: setattr(bench, "again", True)),  # a reset before it is due
    (360, switch("output_feedback", 1190)),
    (361, lambda bench: bench.inject("{kind: command_lost, probability: 0.2, until: 7.0}")),
]


def reworded(monkeypatch: pytest.MonkeyPatch) -> None:
    """Replace the message of every event and every refusal."""
    monkeypatch.setattr("flexslew_plant.events.event.message_of", lambda what: "in other words")
    monkeypatch.setattr(Refusal, "__str__", lambda self: "for another reason")


def dropped(bag: Path) -> set[Cause]:
    events = BagReader(bag).overview.events
    return {e.what.cause for e in events if isinstance(e.what, SwitchDropped)}


@pytest.mark.slow
def test_a_log_in_other_words_flies_again_with_the_same_bits(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    bag = record(tmp_path / "bag", DROPS)
    known = {Cause.NOT_READY, Cause.ALREADY_IN_CHARGE, Cause.LATCHED, Cause.BENCH_RESET}
    assert dropped(bag) == known
    assert resim(bag).identical
    reworded(monkeypatch)
    other = record(tmp_path / "other", DROPS)
    assert {event.message for event in BagReader(other).overview.events} == {"in other words"}
    assert dropped(other) == known
    again = resim(other)
    assert again.identical
    assert again.hash == resim(bag).hash


def as_before(bag: Path, folder: Path) -> Path:
    """Return a log as versions wrote it whose events said in words alone why."""
    later = {"cause", "detail", "duration", "max_effort_step", "what"}
    reader = BagReader(bag)
    with BagWriter(folder, {"trial": reader.trial_text}) as writer:
        for name, kind, stamp, _, data in reader.messages():
            if name == "/events":
                message = decode(kind, data)
                if message.kind != kind_of(SwitchRequested):
                    told = json.loads(message.data)
                    kept = {key: value for key, value in told.items() if key not in later}
                    message.data = json.dumps(kept)
                data = encode(kind, message)
            writer.write(name, kind, data, stamp)
    return folder


@pytest.mark.slow
def test_a_log_of_before_that_says_causes_in_words_alone_flies_again(tmp_path: Path) -> None:
    bag = record(tmp_path / "bag", DROPS)
    older = as_before(bag, tmp_path / "older")
    assert dropped(older) == dropped(bag)
    again = resim(older)
    assert again.identical
    assert again.hash == resim(bag).hash


def test_nothing_is_planned_again(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    bag = record(tmp_path / "bag")
    monkeypatch.setattr("flexslew_lab.trial.trial.make_plan", None)
    assert resim(bag).identical


PLANNED_LATER = TRIAL.replace("duration: 5.0", "duration: 5.0\n  start: 6.0")


def told_later(bag: Path, folder: Path, tick: int, keep: bool = False, **status: int) -> Path:
    """Return a log whose recorder heard of the controllers at a tick, unless kept there first."""
    reader = BagReader(bag)
    topic = "/controller_status"
    statuses = [m for m in reader.messages() if m.topic == topic]
    with BagWriter(folder, {"trial": reader.trial_text}) as writer:
        for name, kind, stamp, _, data in reader.messages():
            if name == "/measurement" and decode(kind, data).tick == tick:
                for late in statuses:
                    message = decode(late.type, late.data)
                    for field, value in {"last_tick": tick, **status}.items():
                        setattr(message, field, value)
                    writer.write(topic, late.type, encode(late.type, message), stamp)
            if name != topic or keep:
                writer.write(name, kind, data, stamp)
    return folder


@pytest.mark.slow
@pytest.mark.parametrize(("heard", "taken"), products([0, 1, 100, 599, 1000], [0, 1, 2, 100, 599]))
def test_a_plan_counts_from_the_question_at_which_it_was_taken_whenever_that_was_heard(
    tmp_path: Path, taken: int, heard: int
) -> None:
    flown = record(tmp_path / "flown", text=PLANNED_LATER, taken=taken)
    bag = told_later(flown, tmp_path / "bag", max(taken, heard), plan_number=1, plan_tick=taken)
    assert {a.first for a in plan_changes(BagReader(bag))} == {(0, taken)}
    assert resim(bag).identical


@pytest.mark.slow
def test_a_controller_that_is_built_anew_leaves_its_plans_in_their_order(tmp_path: Path) -> None:
    flown = record(tmp_path / "flown", text=PLANNED_LATER, taken=100)
    bag = told_later(flown, tmp_path / "bag", 100, plan_number=2, plan_tick=100)
    again = told_later(bag, tmp_path / "again", 700, plan_number=1, plan_tick=0, keep=True)
    assert [a.first for a in plan_changes(BagReader(again))] == [(0, 100)] * 6
    assert resim(again).identical


@pytest.mark.slow
@pytest.mark.parametrize("taken", representatives([0, 2, 100, 599], 2))  # it does not tell 1 from 0
def test_an_older_log_has_the_plan_from_the_tick_after_the_status(
    tmp_path: Path, taken: int
) -> None:
    flown = record(tmp_path / "flown", text=PLANNED_LATER, taken=taken)
    bag = told_later(flown, tmp_path / "bag", taken, plan_number=0, last_tick=max(taken - 1, 0))
    assert {a.first for a in plan_changes(BagReader(bag))} == {(0, taken)}
    assert resim(bag).identical


def altered(bag: Path, folder: Path, topic: str, tick: int, change: Any) -> Path:
    reader = BagReader(bag)
    with BagWriter(folder, {"trial": reader.trial_text}) as writer:
        for name, kind, stamp, _, data in reader.messages():
            if name == topic:
                message = decode(kind, data)
                if getattr(message, "tick", tick) == tick:
                    change(message)
                    data = encode(TOPICS[topic].type, message)
            writer.write(name, kind, data, stamp)
    return folder


def test_one_bit_of_the_truth_is_found_with_its_tick_and_field(tmp_path: Path) -> None:
    def change(truth: Any) -> None:
        truth.velocity = np.array(truth.velocity)
        truth.velocity[1] = np.nextafter(truth.velocity[1], 1.0)

    bag = altered(record(tmp_path / "a"), tmp_path / "b", "/truth", 777, change)
    again = resim(bag)
    assert not again.identical
    assert again.within_tolerance
    assert again.hash != again.recorded_hash
    found = present(again.first_difference)
    assert (found.epoch, found.tick, found.field) == (0, 777, "velocity[1]")
    assert found.recorded == np.nextafter(found.ours, 1.0)


@pytest.mark.slow
def test_a_truth_that_changes_its_size_is_refused(tmp_path: Path) -> None:
    def change(truth: Any) -> None:
        truth.position, truth.velocity = np.zeros(9), np.zeros(9)

    bag = altered(record(tmp_path / "a"), tmp_path / "b", "/truth", 777, change)
    for read in (resim, metrics_of):
        with pytest.raises(BadInput, match="tick 777 has arrays of other sizes than those before"):
            read(bag)


def test_a_plan_that_is_not_the_one_that_was_flown_is_refused(tmp_path: Path) -> None:
    def change(plan: Any) -> None:
        plan.position = np.array(plan.position) * 1.1

    bag = altered(record(tmp_path / "a"), tmp_path / "b", "/plan", 0, change)
    with pytest.raises(BadInput, match="does not fit its content"):
        resim(bag)


def test_a_log_without_truth_is_refused(tmp_path: Path, write_bag: Any, messages: Any) -> None:
    bag = write_bag(tmp_path / "bag", [m for m in messages if m[0] == "/testbed"])
    with pytest.raises(BadInput, match="no truth"):
        resim(bag)


@pytest.mark.parametrize(
    "text",
    [
        "{disturbance: {base_yaw: &much 3.0, hub_pitch: *much}}",
        f"{{disturbance: {{base_yaw: 3.0}}}}{' ' * (1 << 16)}",
    ],
    ids=["an anchor", "too long"],
)
def test_no_request_of_an_operator_makes_the_log_unreadable(text: str, tmp_path: Path) -> None:
    said: list[Any] = []
    wishes = [
        (10, lambda bench: said.append(bench.inject(text))),
        (20, lambda bench: said.append(bench.inject("{disturbance: {base_yaw: 3.0}}", 0, text))),
        (30, switch("output_feedback", 40, False, 1.0, "\N{GRINNING FACE}" * (1 << 20))),
    ]
    bag = record(tmp_path / "bag", wishes, text=TRIAL.replace("12.0", "1.0"))
    assert [answer.ok for answer in said] == [False, True]
    again = resim(bag)
    assert again.identical
    assert (again.replayed["injected"], again.replayed["switch_requested"]) == (1, 1)
