from typing import Any

import numpy as np
import pytest

from flexslew_plant.bench.bench import Bench, BenchSettings, SwitchRequest
from flexslew_plant.bench.schedule import ScheduleEntry
from flexslew_plant.errors import BadInput
from flexslew_plant.hardware.actuator import ActuatorSettings
from flexslew_plant.measurement import EffortCommand
from flexslew_plant.settings import validated
from flexslew_plant.testbeds import WITH_EQUATIONS, read_testbed
from flexslew_plant.testbeds.csa import CsaInitial, CsaTestbed


def bench(**more: Any) -> Bench:
    return Bench(BenchSettings(**({"active": "a"} | more)))


def tick(bed: Any, effort: Any = (0.0, 0.0)) -> None:
    question = bed.question
    command = EffortCommand(question.tick, question.epoch, question.controller, np.array(effort))
    assert bed.offer(command)
    bed.advance()


def flown(bed: Any, ticks: Any, seed: int = 2) -> Any:
    rng = np.random.default_rng(seed)
    for _ in range(ticks):
        tick(bed, rng.normal(0.0, 30.0, bed.model.joints))
    return bed.truth()


def bits(truth: Any) -> Any:
    return truth.position.tobytes() + truth.velocity.tobytes() + truth.applied_effort.tobytes()


def test_the_first_question_is_the_rest_at_the_start() -> None:
    bed = bench(testbed=CsaTestbed(initial=CsaInitial(base_yaw=0.1, hub_pitch=-0.2)))
    question = bed.question
    assert (question.tick, question.epoch, question.time, question.controller) == (0, 0, 0.0, "a")
    np.testing.assert_array_equal(question.joint_position, [0.1, -0.2])
    np.testing.assert_array_equal(question.joint_velocity, 0.0)
    np.testing.assert_array_equal(question.applied_effort, 0.0)
    assert bed.truth().energy == 0.0


def test_a_tick_integrates_the_held_effort_over_the_period() -> None:
    bed = bench()
    before = bed.truth()
    tick(bed, (20.0, -5.0))
    after, state = bed.truth(), np.concatenate((before.position, before.velocity))
    expected = bed.model.advance(state, np.array([20.0, -5.0]), 0.01)
    np.testing.assert_array_equal(np.concatenate((after.position, after.velocity)), expected)
    assert (after.tick, after.time) == (1, 0.01)
    np.testing.assert_array_equal(bed.question.applied_effort, [20.0, -5.0])


def test_time_is_the_tick_times_the_period_without_drift() -> None:
    bed = bench(period=0.1)
    for _ in range(1000):
        tick(bed)
    assert bed.time == 1000 * 0.1


@pytest.mark.parametrize("parameters", [{"hub_radius": 1e200}, {"length": 1e-300}])
@pytest.mark.filterwarnings("ignore:overflow", "ignore:invalid value")
def test_a_testbed_whose_numbers_are_out_of_range_is_refused(parameters: dict[str, float]) -> None:
    testbed = read_testbed({"kind": "csa", "parameters": parameters}, "here")
    with pytest.raises(BadInput, match="testbed: its numbers are out of range"):
        Bench(validated(BenchSettings, {"testbed": testbed}, "here"))


def test_the_limit_holds_and_saturated_ticks_are_counted() -> None:
    bed = bench()
    tick(bed, (400.0, 0.0))
    tick(bed, (10.0, 0.0))
    assert bed.saturated_ticks == 1
    np.testing.assert_array_equal(bed.truth().applied_effort, [10.0, 0.0])


def test_it_is_done_after_its_duration() -> None:
    bed = bench(duration=0.05)
    for k in range(5):
        assert not bed.done, k
        tick(bed)
    assert bed.done


def test_without_a_duration_it_is_never_done() -> None:
    bed = bench()
    tick(bed)
    assert not bed.done


def test_two_runs_have_the_same_bits_and_so_has_the_second_epoch() -> None:
    one, two = bench(), bench()
    first = bits(flown(one, 200))
    assert first == bits(flown(two, 200))
    one.reset()
    assert one.truth().epoch == 1
    assert first == bits(flown(one, 200))


def test_a_truth_that_was_taken_stays_as_it_was() -> None:
    bed = bench()
    tick(bed, (50.0, 20.0))
    kept, question = bed.truth(), bed.question
    copy = [np.copy(part) for part in kept[3:8]]
    flown(bed, 50)
    for part, before in zip(kept[3:8], copy, strict=True):
        np.testing.assert_array_equal(part, before)
    np.testing.assert_array_equal(question.joint_position, kept.position[:2])


@pytest.mark.parametrize("kind", WITH_EQUATIONS)
def test_every_testbed_ticks(kind: Any) -> None:
    bed = Bench(validated(BenchSettings, {"testbed": {"kind": kind}, "active": "a"}, "here"))
    state = flown(bed, 20)
    assert np.isfinite(state.position).all()
    assert len(bed.question.tip_deflection) == len(bed.appendages.names)


def test_tips_of_the_two_beams_are_opposite() -> None:
    bed = bench()
    flown(bed, 100)
    left, right = bed.question.tip_deflection
    assert left == -right != 0.0
    assert left == pytest.approx(bed.truth().position[2:].sum(), rel=1e-12)


def test_a_disturbance_acts_from_its_time_to_its_end_and_is_told() -> None:
    entry = ScheduleEntry(at=0.02, until=0.05, disturbance={"hub_pitch": 7.0})
    bed = bench(schedule=(entry,))
    seen = []
    for _ in range(7):
        tick(bed)
        seen.append(bed.truth().disturbance[1])
    assert seen == [0.0, 0.0, 7.0, 7.0, 7.0, 0.0, 0.0]
    told = [(event.tick, event.message.split(":")[0]) for event in bed.events]
    assert told == [(2, "disturbance on"), (5, "disturbance off")]
    np.testing.assert_array_equal(bed.truth().applied_effort, 0.0)


def test_disturbances_add_up() -> None:
    entries = [
        ScheduleEntry(at=0.0, disturbance={"base_yaw": 2.0}),
        ScheduleEntry(at=0.0, disturbance={"base_yaw": 3.0, "hub_pitch": 1.0}),
    ]
    bed = bench(schedule=tuple(entries))
    tick(bed)
    np.testing.assert_array_equal(bed.truth().disturbance, [5.0, 1.0])


def test_a_scheduled_switch_names_the_newcomer_at_its_tick() -> None:
    bed = bench(schedule=(ScheduleEntry(at=0.03, switch="b"),))
    in_charge = []
    for _ in range(5):
        in_charge.append(bed.question.controller)
        tick(bed)
    assert in_charge == ["a", "a", "a", "b", "b"]
    (result,) = bed.switch_results
    assert result.ok
    assert result.tick == 3


def test_a_schedule_serves_every_epoch() -> None:
    bed = bench(schedule=(ScheduleEntry(at=0.01, switch="b"),))
    for _ in range(2):
        tick(bed)
        assert bed.question.controller == "b"
        bed.reset()
        assert bed.question.controller == "a"


def test_a_switch_in_the_past_happens_at_the_next_tick() -> None:
    bed = bench()
    tick(bed)
    assert bed.request_switch(SwitchRequest("b", 0)) is None
    assert bed.question.controller == "a"
    tick(bed)
    assert bed.question.controller == "b"


@pytest.mark.parametrize("past", [1, -1, -500])
def test_what_is_asked_for_a_time_that_has_passed_is_refused(past: int) -> None:
    bed = bench(allow_faults=True)
    tick(bed)
    tick(bed)
    words = f"{'0.01 s' if past == 1 else 'that time'} is past: the bench is at 0.02 s"
    assert str(bed.request_switch(SwitchRequest("b", past))) == words
    assert bed.inject("{disturbance: {base_yaw: 1.0}}", past).message == words
    assert bed.retarget("{appendage: beam, to: 0.1, duration: 1.0}", past).message == words


def test_a_switch_to_who_is_in_charge_or_twice_at_a_tick_is_refused() -> None:
    bed = bench()
    assert "already in charge" in str(bed.request_switch(SwitchRequest("a", 3)))
    assert bed.request_switch(SwitchRequest("b", 3)) is None
    assert "another switch" in str(bed.request_switch(SwitchRequest("c", 3)))


def test_friction_slows_the_joint() -> None:
    plain, rough = bench(), bench(actuator=ActuatorSettings(viscous_friction=50.0))
    for _ in range(100):
        tick(plain, (100.0, 0.0))
        tick(rough, (100.0, 0.0))
    assert 0.0 < rough.truth().velocity[0] < plain.truth().velocity[0]
    np.testing.assert_array_equal(rough.truth().applied_effort, [100.0, 0.0])


TURN = {"kind": "torque", "direction": [1.0, 0.0, 0.0], "limit": 9.0}
WHEEL = {"axis": [1.0, 0.0, 0.0], "inertia": 2.0, "limit": 9.0}
GYRO, OTHER = (  # whose rotors store nothing together
    {"axis": [0.0, way, 0.0], "rotor": [0.0, 0.0, way], "momentum": 1e4} for way in (1.0, -1.0)
)
PUSH, BACK = (
    {"kind": "thruster", "place": [0.0, arm, 0.0], "direction": [0.0, 0.0, 1.0], "limit": 9.0}
    for arm in (1.0, -1.5)
)


@pytest.mark.parametrize(
    ("drives", "inertia", "brakes"),
    [
        ({"actuators": {"x": TURN}}, 50.0, 1),
        ({"wheels": {"x": WHEEL}}, 48.0, 1),  # of all but its own wheel
        ({"control_moment_gyros": {"x": GYRO, "y": OTHER}}, 50.0, 2),
        ({"actuators": {"x": PUSH, "back": BACK}}, 50.0, 1),  # of two one pushes back
    ],
    ids=["torque", "wheel", "gyros", "thrusters"],
)
def test_the_brake_slows_a_craft_by_its_damping_ratio_whatever_turns_it(
    drives: dict[str, Any], inertia: float, brakes: int
) -> None:
    """I w' = d - c w with c = zeta w0 I, and w0 = 0.1 rad/s of what has no mode."""
    craft = read_testbed({"kind": "spacecraft", "actuators": {}, **drives}, "here")
    pushed = ScheduleEntry(at=0.0, disturbance={"x": 0.2})
    bed = bench(testbed=craft, period=0.1, brake_damping_ratio=0.5, schedule=(pushed,))
    assert bed.brake(True) is None
    tick(bed, np.zeros(bed.model.joints))
    for _ in range(400):
        bed.advance()
    slowing = brakes * 0.5 * 0.1
    expected = 0.2 / (slowing * inertia) * (1.0 - np.exp(-slowing * bed.time))
    # the brake of a tick is that of the rate at its start
    assert bed.truth().velocity[3] == pytest.approx(expected, rel=0.1 * slowing)


def test_what_does_not_speed_its_own_joint_up_brakes_nothing() -> None:
    """The craft's centre lies beyond the thruster, so it turns the other way round."""
    platform = {"centre": [0.0, 2.0, 0.0], "inertia": {"xx": 450.0, "yy": 50.0, "zz": 450.0}}
    craft = read_testbed(
        {"kind": "spacecraft", "platform": platform, "actuators": {"x": PUSH}}, "here"
    )
    bed = bench(testbed=craft)
    assert np.isinf(bed.model.inertias(np.concatenate((bed.model.rest({}), np.zeros(6)))))
    assert bed.brake(True) is None
    tick(bed, [1.0])
    for _ in range(9):
        bed.advance()
    assert bed.truth().applied_effort == 0.0
