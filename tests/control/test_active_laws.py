"""The law that a plan is made for is the law that is active at its start."""

from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from tests.plants import with_dish
from tests.wire_bench import WireBench

from flexslew_control.active_laws import (
    ActiveLaws,
    LawAt,
    PendingSwitch,
    active_at,
    canonical,
    describe_plan_law,
    other_law,
    with_law,
)
from flexslew_control.controllers import settings_text
from flexslew_control.law import ActiveLaw
from flexslew_control.planners import make_plan, plan_settings
from flexslew_control.planners.law_gains import law_gains
from flexslew_lab.trial.trial import (
    active_controller,
    feedback_of,
    law_in_charge,
    plan_of_trial,
    trial_of_values,
)
from flexslew_plant.bench.records import SwitchRequest
from flexslew_plant.bench.schedule import ScheduleEntry
from flexslew_plant.events import SwitchRequested, TargetRequested

CONTROLLERS: dict[str, Any] = {
    "stiff": {"law": "pd_feedforward", "kp": [460.0], "kd": [920.0]},
    "soft": {"law": "pd_feedforward", "kp": [60.0, 60.0], "kd": [300.0, 300.0]},
    "lqr": {},
}


DISH = with_dish(to=0.001, duration=0.02)


class Planned(WireBench):
    """A bench whose statuses, states and events reach the laws of a planner."""

    def __init__(
        self, schedule: Any = (), active: str = "stiff", testbed: dict[str, Any] | None = None
    ) -> None:
        controllers = CONTROLLERS
        if testbed is not None:
            gains = {"kp": [20.0], "kd": [60.0]}
            controllers = {
                "stiff": {"law": "pd_feedforward", **gains},
                "soft": CONTROLLERS["stiff"],
            }
        values = {"controllers": controllers, "active": active, "duration": 60.0}
        trial = trial_of_values(values | ({"testbed": testbed} if testbed else {}), "test")
        trial = replace(trial, schedule=tuple(schedule))
        super().__init__(trial)
        self.laws, self._seen = ActiveLaws(), 0
        self.laws.begin(trial.schedule, trial.period)
        self.report()

    def report(self) -> None:
        """Pass on what a planner receives."""
        for event in self.events[self._seen :]:
            self.laws.take_event(event.what, event.tick, event.epoch)
        self._seen = len(self.events)
        for name, host in self.hosts.items():
            assert host.controller is not None
            text = settings_text(host.controller, self._laws[name][0], host.values, host.due)
            law = self._laws[name][0]
            self.laws.take_status(SimpleNamespace(controller=name, law=law, settings=text))
        bench = self.bench
        self.laws.take_state(bench.drive.active, bench.tick, bench.epoch)

    def flown(self, tick: int) -> LawAt | None:
        """Return the law that answers a tick; None: the brake acts."""
        self.fly(tick)
        name = self.bench.drive.active
        self.fly(tick + 1)  # settings are changed by the question of their tick
        law = ActiveLaw(self._laws[name][0], self.hosts[name].values) if name else None
        return LawAt(name, canonical(law)) if law is not None else None


def operate(bench: Planned, rng: np.random.Generator) -> str:
    """Do one of what an operator may, now or later; return what."""
    later = bench.bench.tick + int(rng.integers(1, 40))
    act = str(
        rng.choice(
            ["tune", "switch", "pause", "reset", "brake", "retarget"],
            p=[0.35, 0.35, 0.1, 0.05, 0.05, 0.1],
        )
    )
    names = [*bench.hosts]
    if act == "tune":
        name = str(rng.choice(names[:2]))
        gains = {"kp": [float(rng.uniform(40.0, 500.0))]}
        bench.hosts[name].tune(gains, int(rng.choice([0, later])))
    elif act == "switch":
        bench.session.switch(
            SwitchRequest(str(rng.choice(names)), int(rng.choice([0, later]))), 0.0
        )
    elif act == "retarget":
        target = {"appendage": "dish", "to": float(rng.uniform(0.0, 0.01)), "duration": 0.02}
        bench.bench.retarget(str(target), int(rng.choice([0, later])))
    elif act == "pause":
        bench.session.pause(bench.now)
    elif act == "reset":
        bench.session.reset()
        bench._waiting.clear()
        for host in bench.hosts.values():
            host.begin_epoch(bench.bench.epoch)
    elif not bench.bench.handover.latched:
        bench.session.brake(True)
        bench.session.brake(False)
    return act


def sequence(seed: int, steps: int, testbed: dict[str, Any] | None = None) -> Planned:
    """Compare the law that is expected at a tick to come with the law that answers it."""
    rng = np.random.default_rng([53, seed])
    schedule = [
        ScheduleEntry(
            at=float(at) / 100.0, switch=str(rng.choice([*CONTROLLERS][: 2 if testbed else 3]))
        )
        for at in np.sort(rng.choice(300, 2, replace=False))
    ]
    bench = Planned(schedule, testbed=testbed)
    done: list[str] = []
    for _ in range(steps):
        done += [operate(bench, rng) for _ in range(int(rng.integers(0, 3)))]
        bench._take()
        bench.report()
        if bench.session.run.state == "paused":
            assert bench.session.start().ok
        tick = bench.bench.tick + int(rng.integers(2, 60))
        expected = bench.laws.at(tick)
        flown = bench.flown(tick)
        assert expected is not None
        assert (None if expected.braked else expected) == flown, (seed, done)
        bench.report()
    return bench


@pytest.mark.parametrize("seed", range(6))
def test_the_law_at_a_tick_to_come_is_the_law_that_answers_it(seed: int) -> None:
    sequence(seed, 25)


@pytest.mark.parametrize("seed", range(2))
def test_the_law_at_a_tick_to_come_does_not_depend_on_new_targets(seed: int) -> None:
    bench = sequence(seed, 40, DISH)
    assert any(isinstance(event.what, TargetRequested) for event in bench.events)


@pytest.mark.campaign
@pytest.mark.parametrize("seed", range(100, 106))
def test_the_law_at_a_tick_to_come_is_the_law_that_answers_it_in_long_sequences(seed: int) -> None:
    sequence(seed, 80)


def test_of_switches_to_come_the_last_one_before_the_start_counts() -> None:
    switches = [PendingSwitch(40, "c"), PendingSwitch(20, "b"), PendingSwitch(40, "d")]
    at = [active_at("a", switches, tick) for tick in (0, 19, 20, 39, 40, 100)]
    assert at == ["a", "a", "b", "b", "d", "d"]


def test_two_ways_to_write_the_same_law_are_equal() -> None:
    as_given = ActiveLaw("pd_feedforward", {"kp": [60], "kd": [300.0], "handover_time": 1})
    other = ActiveLaw("pd_feedforward", {"kd": [300], "kp": [60.0], "gyroscopic": False})
    assert canonical(as_given) == canonical(other)
    assert canonical(other) != canonical(ActiveLaw("pd_feedforward", {"kp": [61.0]}))
    own = ActiveLaw("my_law.py:Law", {"x": 1.0, "handover_time": 1.0})
    assert canonical(own) == ActiveLaw("my_law.py:Law", {"x": 1.0})


def test_a_status_that_names_a_file_or_is_no_yaml_is_not_used() -> None:
    for text in ("{file: /dev/zero}", "{", "- 1"):
        laws = ActiveLaws()
        laws.take_status(SimpleNamespace(controller="a", law="linear", settings=text))
        laws.take_state("a", 0, 0)
        assert laws.at(0) is None


def test_before_any_status_the_law_that_the_planner_was_started_with_counts() -> None:
    law = ActiveLaw("pd_feedforward", {"kp": [60.0]})
    laws = ActiveLaws(law)
    found = laws.at(0)
    assert found is not None
    assert found.law == law
    assert ActiveLaws().at(0) is None


def test_a_trial_is_planned_for_the_law_at_the_start_of_its_plan() -> None:
    values: dict[str, Any] = {
        "controllers": CONTROLLERS,
        "active": "stiff",
        "duration": 60.0,
        "schedule": [{"at": 10.0, "switch": "soft"}, {"at": 30.0, "switch": "lqr"}],
        "plan": {"method": "reference_only", "goal": {"base_yaw": 0.1}, "duration": 5.0},
    }
    for start, name in ((0.0, "stiff"), (9.99, "stiff"), (10.0, "soft"), (31.0, "lqr")):
        trial = trial_of_values({**values, "plan": {**values["plan"], "start": start}}, "test")
        assert active_controller(trial, start) == name
        law = "lqr" if name == "lqr" else "pd_feedforward"
        assert law_in_charge(trial).law == law
        gains = feedback_of(trial)
        assert (gains is None) == (name == "lqr")
        if gains is not None:
            assert gains.kp[0] == CONTROLLERS[name]["kp"][0]
        plan = plan_of_trial(trial)
        assert plan is not None
        assert describe_plan_law(plan).startswith(f"planned for {name} ")
        later = plan.summary.get("warning", "")
        assert ("takes over at 10 s, before the plan ends" in later) == (start == 9.99)


def test_a_plan_that_is_made_for_another_law_says_so() -> None:
    bench = Planned()
    made_for = bench.laws.at(500)
    assert made_for is not None
    settings = plan_settings(
        {"method": "reference_only", "goal": {"base_yaw": 0.1}, "start": 5.0, "duration": 5.0}, "t"
    )
    gains = law_gains(made_for.law, bench.plant, "test")
    plan = with_law(make_plan(settings, bench.plant, gains, law=made_for.law), made_for)
    assert not other_law(plan, bench.laws.at(500))
    bench.hosts["stiff"].tune({"kp": [60.0], "kd": [300.0]}, 400)
    bench.report()
    words = other_law(plan, bench.laws.at(500))
    assert "is made for stiff (pd_feedforward, " in words
    assert "stiff (pd_feedforward, kd [300.0], kp [60.0]) is active at its start" in words
    bench.laws.take_event(SwitchRequested("soft", 700, False, 0.0), 0, 0)
    assert bench.laws.switches(500, 1000) == (PendingSwitch(700, "soft"),)
    stated = with_law(plan, made_for, bench.laws.switches(500, 1000))
    assert "soft takes over at 7 s, before the plan ends at 10 s" in stated.summary["warning"]
