"""A state that is lost ends the run: the tick, the coordinate and the likely cause are told."""

import re
from typing import Any

import numpy as np
import pytest

from flexslew_plant.bench.bench import Bench, BenchSettings
from flexslew_plant.bench.divergence import STABLE_STEP, STATE_LIMIT, is_lost
from flexslew_plant.bench.schedule import ScheduleEntry
from flexslew_plant.errors import BadInput
from flexslew_plant.events import FastMode, Level, message_of
from flexslew_plant.measurement import EffortCommand
from flexslew_plant.testbeds import read_testbed
from flexslew_plant.testbeds.compiled.dynamics import STAGE_WEIGHTS, STEP_WEIGHTS
from flexslew_plant.testbeds.csa import CsaTestbed


def flown(bed: Any, gain: float = 0.0, most: int = 2000) -> None:
    """Fly to the end of the run; a positive gain feeds the rates back the wrong way."""
    rng = np.random.default_rng(2)
    for _ in range(most):
        if bed.done:
            return
        question = bed.question
        effort = gain * question.joint_velocity + rng.normal(0.0, 30.0, bed.model.joints)
        bed.offer(EffortCommand(question.tick, question.epoch, question.controller, effort))
        bed.advance()
    raise AssertionError("it never ends")


def too_slow() -> Bench:
    slow: dict[str, Any] = {"period": 0.1, "integration_steps": 1}
    return Bench(BenchSettings(active="a", testbed=CsaTestbed(modes=12), **slow))


def pushed() -> Bench:
    entry = ScheduleEntry(at=0.5, disturbance={"hub_pitch": 1e22})
    return Bench(BenchSettings(active="a", schedule=(entry,)))


def unstable() -> Bench:
    strong = CsaTestbed(modes=1, effort_limit=(1e18, 1e18))
    return Bench(BenchSettings(active="a", testbed=strong))


@pytest.mark.parametrize(
    ("build", "gain", "cause"),
    [
        (too_slow, 0.0, r"an integration step of 0\.1 s is too long for .* at most 0\.011 s: more"),
        (pushed, 0.0, r"a disturbance of 1e\+22 on hub_pitch, whose limit is 150"),
        (unstable, 1e5, r"a does not stabilise it"),
    ],
)
def test_the_run_ends_at_its_last_finite_tick_and_says_why(
    build: Any, gain: float, cause: str
) -> None:
    bed = build()
    flown(bed, gain)
    words = rf"the state is not finite after tick {bed.tick} \(.* s\), .* was .* before; "
    assert re.fullmatch(rf"{words}likely cause: {cause}.*", bed.failure)
    assert bed.faulted
    told = [event for event in bed.events if event.kind == "not_finite"]
    assert [event[:4] for event in told] == [(bed.tick, bed.time, bed.epoch, Level.FAULT)]
    state = bed.truth()
    numbers = [state.position, state.velocity, state.applied_effort, state.disturbance]
    assert np.isfinite(np.concatenate((*numbers, state.tip_deflection, [state.energy]))).all()


def test_the_truth_stays_what_was_told_before() -> None:
    bed = pushed()
    for _ in range(50):
        bed.advance()
    before = bed.truth()
    bed.advance()
    assert bed.failure
    after = bed.truth()
    for name, value, same in zip(before._fields, before, after, strict=True):
        np.testing.assert_array_equal(value, same, err_msg=name)


def test_a_reset_begins_anew() -> None:
    bed = pushed()
    flown(bed)
    bed.reset()
    assert (bed.failure, bed.faulted, bed.done, bed.tick) == ("", False, False, 0)


@pytest.mark.parametrize("value", [np.nan, np.inf, -np.inf, 1e300, -2.0 * STATE_LIMIT])
@pytest.mark.parametrize("place", [0, 3])
def test_what_cannot_be_told_is_lost(value: Any, place: int) -> None:
    state = np.ones(4)
    assert not is_lost(state)
    state[place] = value
    assert is_lost(state)


def test_the_stable_turn_is_where_the_method_begins_to_amplify() -> None:
    def amplification(turn: Any) -> Any:
        identity, ones = np.eye(len(STEP_WEIGHTS)), np.ones(len(STEP_WEIGHTS))
        stages = np.linalg.solve(identity - 1j * turn * STAGE_WEIGHTS, ones)
        return abs(1.0 + 1j * turn * STEP_WEIGHTS @ stages)

    assert max(map(amplification, np.linspace(0.1, STABLE_STEP, 500))) <= 1.0
    assert amplification(STABLE_STEP * 1.001) > 1.0


@pytest.mark.parametrize(
    ("frequency", "steps", "warned"), [(14.0, 1, False), (20.0, 2, True), (50.0, 3, True)]
)
def test_a_mode_that_turns_far_in_a_tick_is_integrated_and_warned_of_once_an_epoch(
    frequency: float, steps: int, warned: bool
) -> None:
    """A step of the hub leaves (p / w^2) (1 - cos w t) of a mode: 1.4, 2 and 5 rad a tick."""
    mode = {"frequency": frequency, "joints": [0.05], "tips": [1.0]}
    bed = read_testbed({"kind": "identified", "inertia": [[100.0]], "free_modes": [mode]}, "here")
    push = ScheduleEntry(at=0.0, until=20.0, disturbance={"hub": 1.0})
    own: dict[str, Any] = {
        "active": "a",
        "period": 0.1,
        "duration": 30.0,
        "testbed": bed,
        "schedule": (push,),
    }
    bench = Bench(BenchSettings(**own))
    tips: list[float] = []
    still = np.zeros(1)
    for _ in range(2):
        tips.clear()
        for _ in range(200):
            question = bench.question
            bench.offer(EffortCommand(question.tick, question.epoch, question.controller, still))
            bench.advance()
            tips.append(bench.truth().tip_deflection[0])
        bench.reset()
    facts = [e.what for e in bench.events if isinstance(e.what, FastMode)]
    assert len(facts) == 2 * warned
    size = 0.05 / frequency**2
    off = np.array(tips) - size * (1.0 - np.cos(0.1 * frequency * np.arange(1, 201)))
    assert np.abs(off).max() < 0.01 * size
    for fact in facts:
        assert fact.turn == pytest.approx(0.1 * frequency)
        assert fact.steps == steps
        assert f"take at most {fact.period:g} s" in message_of(fact)
        assert ("lower frequency" in message_of(fact)) == (fact.turn > np.pi)
        named = Bench(BenchSettings(**{**own, "period": fact.period}))
        named.advance()
        assert not [e for e in named.events if isinstance(e.what, FastMode)]


def test_a_period_that_no_number_of_steps_helps_is_refused() -> None:
    numbers = {"driven_mass": 1.0, "free_mass": 1.0, "stiffness": 1e12}
    bed = read_testbed({"kind": "floating_oscillator", "parameters": numbers}, "here")
    with pytest.raises(BadInput, match=r"period: 0\.01 .*fastest mode of 1\.414e\+06 rad/s"):
        Bench(BenchSettings(active="a", testbed=bed))
