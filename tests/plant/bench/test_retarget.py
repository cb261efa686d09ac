"""New targets for antennas: in the schedule, in flight, as angles and as lines of sight."""

from typing import Any

import numpy as np
import pytest

from flexslew_lab.reproduce.scole_flights import example_trial
from flexslew_lab.run.in_process import Observer, run_bench
from flexslew_lab.trial.trial import (
    Trial,
    bench_settings,
    build_controllers,
    plant_of,
    trial_of_values,
)
from flexslew_plant.bench.bench import Bench, Truth
from flexslew_plant.errors import BadInput
from flexslew_plant.testbeds.contract import Retargetable

MOTION = {"to": 0.3, "duration": 0.2, "profile": "smooth"}
SHORT: dict[str, Any] = {
    "duration": 0.6,
    "period": 0.01,
    "plan": None,
    "controllers": {"pd_feedforward": {"kp": [5.0], "kd": [5.0]}},
    "active": "pd_feedforward",
    "testbed": {"appendages": {"beam": {"hinge": {"range": [-0.5, 0.5], "motion": MOTION}}}},
}
AGAIN = {"appendage": "beam", "to": -0.2, "duration": 0.1}


def antenna(**changes: Any) -> Trial:
    """Return a short flight of a small antenna."""
    return example_trial("antenna_4", {**SHORT, **changes})


class TruthLog(Observer):
    """The states, and a wish in flight."""

    def __init__(self, bench: Bench, wish: str = "") -> None:
        self.bench, self.wish = bench, wish
        self.states: list[tuple[float, ...]] = []

    def truth(self, truth: Truth) -> None:
        """Keep the state; wish at tick 10."""
        self.states.append((*truth.position, *truth.velocity))
        if truth.tick == 10 and self.wish:
            assert self.bench.retarget(self.wish, 40, "me").ok


def flown(trial: Trial, wish: str = "") -> list[tuple[float, ...]]:
    bench = Bench(bench_settings(trial))
    truth_log = TruthLog(bench, wish)
    run_bench(bench, build_controllers(trial, "trial"), truth_log)
    return truth_log.states


def test_a_wish_in_flight_is_the_same_flight_as_one_in_the_schedule() -> None:
    scheduled = flown(antenna(schedule=[{"at": 0.4, "retarget": AGAIN}]))
    wished = flown(antenna(), "{appendage: beam, to: -0.2, duration: 0.1}")
    assert wished == scheduled
    assert flown(antenna()) != scheduled


def test_a_wish_for_a_time_after_the_end_of_the_run_is_refused() -> None:
    bench = Bench(bench_settings(antenna()))
    refused = bench.retarget("{appendage: beam, to: -0.2, duration: 0.1}", 60, "me")
    assert refused.message == "tick 60 is too late: the run ends at tick 60"
    assert not bench.events
    assert bench.retarget("{appendage: beam, to: -0.2, duration: 0.1}", 59, "me").ok


def test_everybody_knows_the_turns_of_the_schedule() -> None:
    testbed = plant_of(antenna(schedule=[{"at": 0.4, "retarget": AGAIN}])).testbed
    assert isinstance(testbed, Retargetable)
    turns = testbed.hinge_turns()
    assert [turn.to for turn in turns] == pytest.approx([0.3, -0.2])
    assert [turn.end for turn in turns] == pytest.approx([0.2, 0.5])


@pytest.mark.parametrize(
    ("wish", "words"),
    [
        ("{appendage: mast, to: 0.1, duration: 1.0}", "appendage: mast is not allowed"),
        ("{appendage: beam, to: 0.7, duration: 1.0}", "0.7 rad is outside of the range -0.5 to"),
        ("{appendage: beam, duration: 1.0}", "give one of to and line_of_sight"),
        ("{appendage: beam, to: 0.1}", "duration"),
        ("[1, 2", "is not YAML"),
        ("nothing", "give YAML keys"),
    ],
)
def test_a_wish_that_cannot_be_is_refused_and_nothing_changes(wish: str, words: str) -> None:
    bench = Bench(bench_settings(antenna()))
    before = bench.model
    result = bench.retarget(wish, 40)
    assert not result.ok
    assert words in result.message
    assert "\n" not in result.message
    assert bench.model is before


def test_a_turn_before_the_last_one_has_ended_is_refused() -> None:
    bench = Bench(bench_settings(antenna()))
    result = bench.retarget("{appendage: beam, to: 0.1, duration: 1.0}", 5)
    assert not result.ok
    assert "before the last one ends at 0.2 s" in result.message
    with pytest.raises(BadInput, match=r"schedule.0.retarget.*before the last one ends"):
        Bench(bench_settings(antenna(schedule=[{"at": 0.1, "retarget": AGAIN}])))


def test_a_reset_takes_the_first_targets_again() -> None:
    bench = Bench(bench_settings(antenna()))
    packed = bench.model.packed
    assert bench.retarget("{appendage: beam, to: 0.1, duration: 1.0}", 40).ok
    assert bench.model.packed.size > packed.size
    bench.reset()
    np.testing.assert_array_equal(bench.model.packed, packed)


def test_a_line_of_sight_becomes_the_angle_that_points_there() -> None:
    # the beam lies along y and turns about x
    sight = {"line_of_sight": [0.0, float(np.cos(0.4)), float(np.sin(0.4))], "to": None}
    hinge = {"range": None, "motion": {**MOTION, **sight}}
    testbed = antenna(testbed={"appendages": {"beam": {"hinge": hinge}}}).testbed
    assert isinstance(testbed, Retargetable)
    assert testbed.hinge_turns()[0].to == pytest.approx(0.4, abs=1e-12)
    beside = {"motion": {**MOTION, "to": None, "line_of_sight": [0.3, 1.0, 0.0]}}
    with pytest.raises(BadInput, match=r"line_of_sight: .* comes within 0.2915 rad of it at best"):
        antenna(testbed={"appendages": {"beam": {"hinge": beside}}})


def free_arm(at: float, duration: float, profile: str = "bang_bang") -> Trial:
    """Return a free craft of 90 kg m^2 with an arm of 10 kg m^2 that turns by 1.5 rad."""
    motion = {"to": 1.5, "at": at, "duration": duration, "profile": profile}
    arm = {"mass": 5.0, "inertia": {"xx": 10.0, "yy": 10.0, "zz": 10.0}}
    values = {
        "duration": 40.0,
        "period": 0.02,
        "testbed": {
            "kind": "spacecraft",
            "platform": {"inertia": {"xx": 90.0, "yy": 90.0, "zz": 90.0}},
            "appendages": {"arm": {"hinge": {"axis": [0, 0, 1.0], "motion": motion}, "body": arm}},
        },
        "controllers": {"pd_feedforward": {"kp": [0.0], "kd": [0.0]}},
    }
    return trial_of_values(values, "arm")


@pytest.mark.slow
@pytest.mark.parametrize(
    ("turn", "near"),
    [
        ((1.0, 3.0, "bang_bang"), 1e-9),
        ((1.02, 12.04, "bang_bang"), 1e-9),
        ((1.013, 3.0, "bang_bang"), 1e-9),  # jumps within ticks
        ((1.0, 3.01, "bang_bang"), 1e-9),
        ((1.001, 0.017, "bang_bang"), 3e-9),  # thrice within a tick, at up to 176 rad/s
        ((1.013, 11.987, "smooth"), 1e-6),  # its jerk jumps within ticks
    ],
)
def test_a_free_craft_turns_against_its_arm_and_then_stands_still(turn: Any, near: float) -> None:
    at, duration, profile = turn
    for tick, state in enumerate(flown(free_arm(*turn))):
        x, y, z, w = state[3:7]
        assert (x, y) == pytest.approx((0.0, 0.0), abs=1e-12)
        s = min(max((0.02 * tick - at) / duration, 0.0), 1.0)
        done = s - np.sin(2.0 * np.pi * s) / (2.0 * np.pi)
        if profile == "bang_bang":
            done = 2.0 * s**2 if s < 0.5 else 1.0 - 2.0 * (1.0 - s) ** 2
        # momentum is none all the time: 90 w + 10 (w + 1.5 / s) = 0
        assert 2.0 * np.arctan2(z, w) == pytest.approx(-0.15 * done, abs=near)
