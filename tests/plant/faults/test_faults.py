from functools import cache
from typing import Any

import numpy as np
import pytest

from flexslew_plant.bench.bench import Bench, BenchSettings, SwitchRequest
from flexslew_plant.bench.operation.backlog import NodeProgress
from flexslew_plant.errors import BadInput
from flexslew_plant.events import BrakeActivated, FallbackActivated, Level
from flexslew_plant.events.run import RejectionReason
from flexslew_plant.hardware.disturbances import Pulse, shape_effort
from flexslew_plant.measurement import EffortCommand
from flexslew_plant.refusal import Cause, Reply
from flexslew_plant.settings import plain, validated
from flexslew_plant.yaml_data import yaml_text

KP, KD, GOAL = 460.0, 920.0, np.array([0.05, -0.03])
AT, UNTIL = 2.0, 4.0  # when the faults act [s]
AT_TICK, UNTIL_TICK = 200, 400
MAX_MISSED = 5


def pd(name: Any) -> Any:
    def law(question: Any) -> EffortCommand | None:
        if question.controller != name:
            return None
        effort = KP * (GOAL - question.joint_position) - KD * question.joint_velocity
        return EffortCommand(question.tick, question.epoch, name, effort)

    return law


def settings(*faults: Any, **more: Any) -> Any:
    schedule = [{"at": AT, "until": UNTIL, "fault": fault} for fault in faults]
    values = {
        "testbed": {"damping_ratio": 0.1, "modes": 1},
        "duration": 60.0,
        "active": "first",
        "fallback": ["second"],
        "schedule": schedule,
        "allow_faults": True,
        **more,
    }
    return validated(BenchSettings, values, "test")


class Run:
    """A bench flown to its end by plain functions, with everything that happened."""

    def __init__(self, bench_settings: Any, laws: Any = None, meanwhile: Any = None) -> None:
        self.bench = bench = Bench(bench_settings)
        self.laws = laws or {"first": pd("first"), "second": pd("second")}
        self.events, self.measurements, self.truth_log = [], [], []
        while not bench.done:
            self.measurements.append(bench.question)
            self.truth_log.append(bench.truth())
            if meanwhile is not None:
                meanwhile(bench)
            for law in self.laws.values():
                command = law(bench.question)
                if command is not None:
                    bench.offer(command)
            bench.advance()
        self.events = list(bench.events)

    def of(self, kind: Any) -> list[Any]:
        return [event for event in self.events if event.kind == kind]

    def applied(self, tick: Any) -> Any:
        return self.truth_log[tick + 1].applied_effort

    @property
    def states(self) -> Any:
        return np.array([np.concatenate((t.position, t.velocity)) for t in self.truth_log])

    def ends_at_rest(self) -> Any:
        return np.abs(self.truth_log[-1].velocity[:2]).max() < 1e-3  # joints [rad/s]


@pytest.fixture(scope="module")
def healthy() -> Run:
    return Run(settings())


FAULTS: dict[str, dict[str, Any]] = {
    "actuator_stuck": {"kind": "actuator_stuck", "joint": "hub_pitch", "effort": 2.0},
    "actuator_gain": {"kind": "actuator_gain", "joint": "base_yaw", "gain": 0.5},
    "command_delay": {"kind": "command_delay", "ticks": 10},
    "command_lost": {"kind": "command_lost", "probability": 0.3},
    "command_late": {"kind": "command_late", "probability": 0.3},
    "command_duplicated": {"kind": "command_duplicated", "probability": 0.3},
    "command_reordered": {"kind": "command_reordered", "probability": 0.3},
    "sensor_dropout": {"kind": "sensor_dropout", "channel": "joint_position", "probability": 0.2},
    "sensor_bias": {
        "kind": "sensor_bias",
        "channel": "joint_position",
        "of": "hub_pitch",
        "bias": 0.01,
    },
    "sensor_freeze": {"kind": "sensor_freeze", "channel": "joint_velocity"},
}
SILENCES = {
    "command_lost": {"kind": "command_lost"},
    "command_late": {"kind": "command_late", "ticks": 3},
    "command_reordered": {"kind": "command_reordered"},
    "controller_silent": {"kind": "controller_silent", "controller": "first"},
    "sensor_nan": {"kind": "sensor_nan", "channel": "joint_velocity", "of": "base_yaw"},
}


@cache
def with_fault(kind: Any) -> Run:
    return Run(settings(FAULTS[kind]))


@cache
def with_silence(kind: Any) -> Run:
    return Run(settings(SILENCES[kind]))


@pytest.mark.parametrize("kind", FAULTS)
def test_a_passing_fault_is_logged_changes_only_its_ticks_and_ends_at_rest(
    kind: Any, healthy: Run
) -> None:
    run = with_fault(kind)
    on, off = run.of("fault")
    assert (on.tick, off.tick) == (AT_TICK, UNTIL_TICK)
    assert (on.data["on"], off.data["on"]) == (True, False)
    assert on.data["fault"]["kind"] == kind
    assert on.level is Level.WARNING
    assert np.array_equal(run.states[: AT_TICK + 1], healthy.states[: AT_TICK + 1])
    if kind != "command_duplicated":
        assert not np.array_equal(run.states, healthy.states)
    assert run.ends_at_rest()


@pytest.mark.parametrize("kind", ["command_late", "sensor_dropout"])
def test_a_fault_by_chance_is_the_same_in_every_run_of_its_seed(kind: str) -> None:
    first, again = with_fault(kind), Run(settings(FAULTS[kind]))
    assert np.array_equal(first.states, again.states)
    assert first.events == again.events


def test_another_seed_loses_other_commands() -> None:
    lost = FAULTS["command_lost"]
    ticks = [
        [event.tick for event in Run(one).of("missed")]
        for one in (settings(lost), settings(lost, seed=2), settings({**lost, "seed": 3}))
    ]
    assert ticks[0] != ticks[1]
    assert ticks[0] != ticks[2]
    assert 30 < len(ticks[0]) < 90  # of 200, each with 0.3


@pytest.mark.parametrize("kind", SILENCES)
def test_a_silence_is_found_within_max_missed_ticks_and_somebody_else_takes_over(kind: Any) -> None:
    run = with_silence(kind)
    missed, handed = run.of("missed"), run.of("fallback")
    assert missed[0].tick == AT_TICK
    assert handed[0].tick == AT_TICK + MAX_MISSED - 1
    assert handed[0].level is Level.FAULT
    assert handed[0].what == FallbackActivated("second", "first", Cause.NO_ANSWER)
    assert run.bench.faulted
    assert run.ends_at_rest()


@pytest.mark.parametrize("kind", ["command_lost", "command_late", "command_reordered"])
def test_a_dead_cable_ends_on_the_brake_at_rest(kind: str) -> None:
    run = with_silence(kind)
    (brake,) = run.of("brake")
    assert brake.tick == AT_TICK + 2 * MAX_MISSED - 1
    assert run.bench.drive.active == ""
    assert run.ends_at_rest()


def test_the_fallback_flies_on_to_the_goal_when_one_controller_is_silent() -> None:
    run = with_silence("controller_silent")
    assert not run.of("brake")
    assert run.bench.drive.active == "second"
    assert run.states[-1][:2] == pytest.approx(GOAL, abs=5e-3)


def test_a_missed_tick_holds_the_last_effort() -> None:
    run = with_silence("command_lost")
    for tick in range(AT_TICK, AT_TICK + MAX_MISSED):
        assert np.array_equal(run.applied(tick), run.applied(AT_TICK - 1))


def test_a_stuck_motor_holds_what_it_is_told_or_what_it_had() -> None:
    stuck = {"kind": "actuator_stuck", "joint": "hub_pitch"}
    told, kept = Run(settings({**stuck, "effort": 2.0})), Run(settings(stuck))
    for tick in (AT_TICK, UNTIL_TICK - 1):
        assert told.applied(tick)[1] == 2.0
        assert kept.applied(tick)[1] == kept.applied(AT_TICK - 1)[1]
    assert kept.applied(UNTIL_TICK)[1] != kept.applied(UNTIL_TICK - 1)[1]


def test_a_gain_error_scales_one_motor() -> None:
    run = with_fault("actuator_gain")
    question = run.measurements[AT_TICK]
    asked = KP * (GOAL - question.joint_position) - KD * question.joint_velocity
    assert run.applied(AT_TICK) == pytest.approx(asked * [0.5, 1.0], rel=1e-12)


def test_a_delay_moves_the_effort_by_its_ticks_without_a_missed_tick() -> None:
    run = with_fault("command_delay")
    for tick in range(AT_TICK + 10, UNTIL_TICK):
        question = run.measurements[tick - 10]
        asked = KP * (GOAL - question.joint_position) - KD * question.joint_velocity
        assert np.array_equal(run.applied(tick), asked)
    assert not run.of("missed")


def test_a_delay_that_sets_in_wakes_no_dead_motor_and_runs_ahead_of_no_other_delay() -> None:
    dead = {"kind": "actuator_gain", "joint": "base_yaw", "gain": 0.0}
    entries = [
        {"at": 1.0, "fault": dead},
        {"at": 2.0, "fault": {"kind": "command_delay", "ticks": 20}},
        {"at": 3.0, "fault": {"kind": "command_delay", "ticks": 30, "joint": "hub_pitch"}},
    ]

    def law(question: Any) -> EffortCommand:  # what it asks for tells the tick
        asked = np.array([5.0, 0.01 * question.tick])
        return EffortCommand(question.tick, question.epoch, "first", asked)

    run = Run(settings(schedule=entries, duration=5.0), {"first": law})
    base, hub = np.array([run.applied(tick) for tick in range(499)]).T
    assert (base[:100] == 5.0).all()
    assert (base[100:] == 0.0).all()
    arrives = [*range(200), *[199] * 20, *range(200, 280), *range(280, 300), *[299] * 30]
    arrives += range(300, 449)
    assert np.array_equal(hub, 0.01 * np.array(arrives))


@pytest.mark.parametrize(
    ("kind", "missed"),
    [("command_late", True), ("command_duplicated", False), ("command_reordered", True)],
)
def test_an_answer_out_of_its_tick_is_rejected_as_stale(
    kind: str, missed: bool, healthy: Run
) -> None:
    run = with_fault(kind)
    assert run.bench.drive.rejected[RejectionReason.STALE] > 30
    assert run.of("rejected")[0].data["reason"] == "stale"
    assert bool(run.of("missed")) is missed
    assert np.array_equal(run.states, healthy.states) is not missed


def test_broken_sensors_lie_to_the_question_and_not_to_the_truth() -> None:
    frozen = with_fault("sensor_freeze")
    first = frozen.measurements[AT_TICK].joint_velocity
    for tick in (AT_TICK + 1, UNTIL_TICK - 1):
        assert np.array_equal(frozen.measurements[tick].joint_velocity, first)
        assert not np.array_equal(frozen.truth_log[tick].velocity[:2], first)
    biased = with_fault("sensor_bias")
    tick = AT_TICK + 7
    error = biased.measurements[tick].joint_position - biased.truth_log[tick].position[:2]
    assert error == pytest.approx([0.0, 0.01], abs=1e-15)
    dropped = with_fault("sensor_dropout")
    zeros = [not dropped.measurements[k].joint_position.any() for k in range(AT_TICK, UNTIL_TICK)]
    assert 15 < sum(zeros) < 70


def test_a_second_fault_does_not_thaw_a_frozen_sensor() -> None:
    entries = [
        {"at": AT, "until": UNTIL, "fault": FAULTS["sensor_freeze"]},
        {"at": 3.0, "fault": {"kind": "actuator_gain", "joint": "base_yaw", "gain": 0.9}},
    ]
    run = Run(settings(schedule=entries))
    first, later = run.measurements[AT_TICK], run.measurements[350]
    assert np.array_equal(first.joint_velocity, later.joint_velocity)


LIARS = {
    "sender": lambda c: c._replace(controller="somebody"),
    "stale": lambda c: c._replace(tick=c.tick + 1),
    "size": lambda c: c._replace(effort=np.zeros(3)),
    "finite": lambda c: c._replace(effort=np.array([0.0, np.inf])),
}


@pytest.mark.parametrize("lie", LIARS)
def test_a_lying_controller_is_named_and_replaced(lie: Any) -> None:
    def liar(question: Any) -> Any:
        command = pd("first")(question)
        return LIARS[lie](command) if command and question.tick >= AT_TICK else command

    run = Run(settings(), {"first": liar, "second": pd("second")})
    assert run.of("rejected")[0].data["reason"] == lie
    assert run.of("fallback")[0].tick == AT_TICK + MAX_MISSED - 1
    assert run.ends_at_rest()


def test_a_crashed_controller_without_fallback_leaves_the_brake_at_rest() -> None:
    def crashed(question: Any) -> Any:
        return pd("first")(question) if question.tick < 30 else None

    run = Run(settings(fallback=[]), {"first": crashed})
    assert run.of("brake")[0].what == BrakeActivated("", "first", Cause.NO_ANSWER)
    assert run.of("brake")[0].tick == 30 + MAX_MISSED - 1
    assert run.ends_at_rest()


def test_a_swap_whose_first_answers_are_lost_is_still_reported() -> None:
    entries = [
        {"at": AT, "switch": "second"},
        {"at": AT, "until": AT + 0.03, "fault": {"kind": "command_lost"}},
    ]
    run = Run(settings(schedule=entries))
    (swap,) = run.of("switched")
    assert swap.tick == AT_TICK + 3
    assert not run.of("fallback")


def test_a_newcomer_that_never_answers_is_reported_as_refused() -> None:
    run = Run(settings(), {"first": pd("first")}, switch_to_nobody)
    (result,) = run.bench.switch_results
    assert not result.ok
    assert "nobody" in result.message


def switch_to_nobody(bench: Any) -> None:
    if bench.tick == 10:
        bench.request_switch(SwitchRequest("nobody", 11))


def test_disturbances_have_the_shape_and_the_mean_of_their_formula() -> None:
    sine = {"sine": {"amplitude": 3.0, "frequency": 0.25, "phase": 0.5}}
    pulse = {"pulse": {"amplitude": -2.0, "width": 0.5, "every": 1.0}}
    entries = [
        {"at": AT, "until": UNTIL, "disturbance": {"base_yaw": sine, "hub_pitch": pulse}},
        {"at": 1.0, "disturbance": {"base_yaw": 5}},
    ]
    run = Run(settings(schedule=entries, allow_faults=False))
    found = np.array([truth.disturbance for truth in run.truth_log[1:]])
    fine = np.linspace(0.0, 2.0, 200_001)
    mean = 3.0 * np.sin(2.0 * np.pi * 0.25 * fine + 0.5)
    expected = [mean[1000 * k : 1000 * (k + 1) + 1].mean() for k in range(200)]
    assert found[AT_TICK:UNTIL_TICK, 0] - 5.0 == pytest.approx(np.array(expected), abs=1e-5)
    assert (found[AT_TICK:UNTIL_TICK, 1] == ([-2.0] * 50 + [0.0] * 50) * 2).all()
    assert not found[UNTIL_TICK:, 1].any()
    assert not found[:100].any()
    assert [event.tick for event in run.of("disturbance")] == [100, AT_TICK, UNTIL_TICK]
    assert run.of("disturbance")[1].data["hub_pitch"]["pulse"]["amplitude"] == -2.0


def test_pulses_that_are_no_whole_ticks_keep_their_impulse() -> None:
    def impulses(ticks: int, **pulse: float) -> Any:
        """Return the impulse until the end of each tick [N m s]."""
        shape = validated(Pulse, {"pulse": pulse}, "test")
        return np.cumsum([0.01 * shape_effort(shape, k, 0.01) for k in range(ticks)])

    ends = 0.01 * np.arange(1, 301)
    for width, every in ((0.004, 1.0), (0.015, 1.0), (0.012, 0.0333), (0.001, 0.0007)):
        fine = np.arange(0.5e-5, 3.0, 1e-5)  # midpoints
        on = np.cumsum(fine % every < width) * 1e-5
        found = impulses(300, amplitude=2.0, width=width, every=every)
        assert found == pytest.approx(2.0 * on[999::1000], abs=5e-4)
    assert impulses(300, amplitude=2.0, width=0.004) == pytest.approx(np.full(300, 0.008))
    once = impulses(300, amplitude=2.0, width=0.025)
    assert once == pytest.approx(2.0 * np.minimum(ends, 0.025))
    assert (
        impulses(300, amplitude=3.0, width=0.2, every=0.3).tolist()
        == np.cumsum([0.01 * 3.0 * (k % 30 < 20) for k in range(300)]).tolist()
    )  # whole ticks have no error of rounding


def test_a_disturbance_that_is_ended_before_it_begins_leaves_no_event_of_one() -> None:
    for end_tick in (100, 148, 149):  # the end is a tick later
        numbers: list[int] = []

        def operate(bench: Any, end: int = end_tick, numbers: list[int] = numbers) -> None:
            if bench.tick == 50:
                numbers.append(bench.inject("{disturbance: {base_yaw: 5.0}}", 150).number)
            if bench.tick == end:
                assert bench.end_fault(numbers[0]).ok

        run = Run(settings(duration=2.0), meanwhile=operate)
        assert not run.of("disturbance")
        assert not any(truth.disturbance.any() for truth in run.truth_log)
        assert len(run.of("injected")) == len(run.of("fault_ended")) == 1


def test_a_sensor_that_drops_out_reads_zero_whatever_else_is_wrong_with_it() -> None:
    entries = [
        {"at": 0.0, "fault": {"kind": kind, "channel": "joint_velocity"}}
        for kind in ("sensor_nan", "sensor_dropout")
    ]
    assert not Bench(settings(schedule=entries)).question.joint_velocity.any()


def test_an_injected_fault_does_what_a_scheduled_one_does() -> None:
    def inject(bench: Any) -> None:
        if bench.tick == 150:
            answers.append(bench.inject("{kind: command_lost, probability: 0.3, until: 4.0}", 200))

    answers: list[Any] = []
    run, scheduled = Run(settings(), meanwhile=inject), with_fault("command_lost")
    assert answers[0] == Reply("command_lost from 2 s on (tick 200, no. 0)", tick=200, number=0)
    assert np.array_equal(run.states, scheduled.states)
    (wish,) = run.of("injected")
    assert wish.data["start"] == 200
    assert [event for event in run.events if event is not wish] == scheduled.events


def test_an_injected_disturbance_begins_at_the_next_tick() -> None:
    bench = Bench(settings())
    words = "disturbance from 0.01 s on (tick 1, no. 0)"
    assert bench.inject("disturbance: {base_yaw: 4.0}") == Reply(words, tick=1, number=0)
    bench.advance()
    assert not bench.truth().disturbance.any()
    bench.advance()
    assert bench.truth().disturbance.tolist() == [4.0, 0.0]


def test_what_acts_can_be_ended_by_its_number_and_ends_with_the_next_tick() -> None:
    bench = Bench(settings(FAULTS["actuator_gain"], max_missed=100))
    bench.inject("disturbance: {base_yaw: 4.0}")
    bench.inject("{kind: command_lost}")
    bench.inject("{kind: command_lost}", 50)
    assert [fault.number for fault in bench.active_faults()] == [0, 1, 2, 3]
    assert bench.active_faults()[3].start == 50
    for _ in range(10):
        bench.advance()
    for number in (1, 2, 3):
        words = f"fault or disturbance {number} ends at tick 11"
        assert bench.end_fault(number, "me") == Reply(words, tick=11, number=number)
    refused = bench.end_fault(1)
    assert (refused.ok, refused.message) == (
        False, "no fault or disturbance 1; active or due: 0",
    )  # fmt: skip
    bench.advance()
    assert bench.truth().disturbance.tolist() == [4.0, 0.0]
    for _ in range(60):
        missed = bench.drive.missed
        bench.offer(pd("first")(bench.question))
        bench.advance()
        assert bench.drive.missed == missed
        assert bench.truth().disturbance.tolist() == [0.0, 0.0]
    ended = [e for e in bench.events if e.kind == "fault" and not e.data["on"]]
    assert [event.tick for event in ended] == [11]
    assert [e.data["who"] for e in bench.events if e.kind == "fault_ended"] == ["me"] * 3


def test_nothing_breaks_after_the_end_of_the_run() -> None:
    bench = Bench(settings(duration=1.0))
    assert bench.inject("{kind: command_lost}", 99).ok
    for tick in (100, 10**9):
        refused = bench.inject("{kind: command_lost}", tick).refused
        assert refused is not None
        assert refused.cause is Cause.RUN_OVER
        assert f"tick {tick} is too late: the run ends at tick 100" in str(refused)
    assert len(bench.active_faults()) == 1


def test_a_controller_that_is_not_there_cannot_fall_silent() -> None:
    bench, there = Bench(settings()), ("first", "second")
    text = "{kind: controller_silent, controller: third}"
    refused = bench.inject(text, controllers=there)
    assert not refused.ok
    words = "fault.fault.controller: there is no third; allowed: first, second"
    assert words in refused.message
    assert not bench.active_faults()
    assert not bench.events
    assert bench.inject(text.replace("third", "second"), controllers=there).ok


def test_a_reset_forgets_what_was_injected_and_keeps_what_was_scheduled() -> None:
    bench = Bench(settings(FAULTS["actuator_gain"]))
    bench.inject("{kind: command_lost}")
    bench.reset()
    bench.events.clear()
    for _ in range(AT_TICK + 1):
        bench.offer(pd("first")(bench.question))
        assert bench.drive.missed == 0
        bench.advance()
    assert [event.data["fault"]["kind"] for event in bench.events] == ["actuator_gain"]


@pytest.mark.parametrize(
    ("text", "word"),
    [
        ("{kind: gremlins}", "gremlins"),
        ("{kind: command_lost, probability: 2}", "probability"),
        ("{kind: command_lost, propability: 1}", "propability"),
        ("{kind: actuator_stuck, joint: elbow}", "elbow"),
        ("{kind: actuator_stuck, joint: hub_pitch, effort: 1e6}", "fault.fault.effort"),
        ("{kind: actuator_stuck, joint: hub_pitch, effort: -1e6}", "its effort limit"),
        ("{kind: sensor_bias, channel: tip_deflection, of: base_yaw, bias: 1}", "beam_positive"),
        ("{disturbance: {elbow: 1.0}}", "elbow"),
        ("{switch: second}", "switch_controller"),
        ("{kind: command_lost, until: 0.001}", "until"),
        ("nonsense", "keys"),
        ("{", "YAML"),
    ],
)
def test_a_wrong_fault_is_refused_in_one_line_and_changes_nothing(text: str, word: str) -> None:
    bench = Bench(settings())
    done = bench.inject(text)
    assert not done.ok
    assert word in done.message
    assert "\n" not in done.message
    bench.advance()
    assert [event.kind for event in bench.events] == ["missed"]


def test_no_motor_gives_more_than_its_limit_by_a_fault_of_the_schedule() -> None:
    most = settings().testbed.effort_limit[1]
    stuck = {"kind": "actuator_stuck", "joint": "hub_pitch", "effort": most}
    Bench(settings(stuck))
    with pytest.raises(BadInput, match=r"schedule\.0\.fault\.effort: .*hub_pitch gives at most"):
        Bench(settings({**stuck, "effort": np.nextafter(most, np.inf)}))


@pytest.mark.parametrize(
    "entry",
    [
        {"at": 1e308, "switch": "second"},
        {"at": 1e308, "fault": FAULTS["command_lost"]},
        {"at": 0.0, "until": 1e308, "disturbance": {"base_yaw": 1.0}},
    ],
)
def test_a_time_beyond_the_last_tick_is_refused(entry: dict[str, Any]) -> None:
    with pytest.raises(BadInput, match=r"1e\+308 is not allowed"):
        Bench(settings(schedule=[entry]))
    assert not Bench(settings()).inject("{kind: command_lost, until: 1.0e308}").ok


def test_nothing_breaks_unless_the_trial_allows_it() -> None:
    with pytest.raises(BadInput, match=r"schedule\.0\.fault.*allow_faults: true"):
        Bench(settings(FAULTS["command_lost"], allow_faults=False))
    answer = Bench(settings(allow_faults=False)).inject("{kind: command_lost}")
    assert not answer.ok
    assert "allow_faults: true" in answer.message


def test_settings_with_faults_survive_yaml() -> None:
    sine = {"base_yaw": {"sine": {"amplitude": 1.0, "frequency": 2.0}}, "hub_pitch": 3}
    entries = [{"at": 1.0, "fault": fault} for fault in {**FAULTS, **SILENCES}.values()]
    given = settings(schedule=[*entries, {"at": 2.0, "disturbance": sine}])
    again = validated(BenchSettings, plain(given), yaml_text(plain(given)))
    assert again == given


def test_the_plant_holds_back_for_a_slow_controller_but_not_for_a_dead_one() -> None:
    backlog = NodeProgress(patience=2.0)
    backlog.received("slow", 0, 0)
    assert backlog.slow(1000, 0, now=0.0) == []
    assert backlog.slow(1001, 0, now=0.0) == ["slow"]
    backlog.received("slow", 100, 0)
    assert backlog.slow(1001, 0, now=1.9) == []
    assert backlog.slow(1101, 0, now=2.0) == ["slow"]
    assert backlog.slow(1101, 0, now=4.1) == []  # given up
    assert "tick 100" in str(backlog.reason("slow", 1101, 0))
    backlog.received("slow", 200, 0)
    assert backlog.reason("slow", 1101, 0) is None


def test_a_paced_plant_does_not_wait_but_says_who_is_behind() -> None:
    backlog = NodeProgress(paced=True)
    backlog.received("slow", 10, 0)
    assert backlog.slow(5000, 0, now=0.0) == []
    assert str(backlog.reason("slow", 5000, 0)) == "it has seen tick 10, the bench is at 5000"
    assert backlog.reason("slow", 900, 1) is None  # a new epoch counts from its own tick 0
