import signal
import sys
from typing import Any

import casadi
import numpy as np
import pytest
from tests.plants import plant

from flexslew_control.planners import make_plan, plan_settings
from flexslew_control.planners.time_optimal import all_drives
from flexslew_control.planners.time_optimal.interruptible import Interrupt, interruptible
from flexslew_plant.errors import BadInput, PlanFailed
from flexslew_plant.testbeds.csa import CsaTestbed, CsaVariant
from flexslew_plant.testbeds.oscillators.floating_oscillator import FloatingOscillatorTestbed


@pytest.fixture
def one_start(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(all_drives, "_STARTS", 1)


def planned(goal: Any, variant: CsaVariant = "complete", heard: Any = None, **more: Any) -> Any:
    values = {
        "method": "time_optimal",
        "model": {"kind": "csa", "modes": 1, "variant": variant},
        "goal": goal,
        "amplitude": 100.0,
        **more,
    }
    settings = plan_settings(values, "trial.yaml")
    own = more.get("model", {}).get("kind") == "floating_oscillator"
    bench = plant(testbed=FloatingOscillatorTestbed(), limit=(150.0,)) if own else plant()
    return make_plan(settings, bench, progress=None if heard is None else heard.append)


@pytest.mark.slow
def test_pitching_on_the_way_turns_faster_than_yaw_alone() -> None:
    heard: list[Any] = []
    plan = planned({"base_yaw": 1.0}, "printed", heard, drives="all")
    assert plan.duration == pytest.approx(19.050509, abs=1e-6)  # physics/time_optimal
    assert plan.duration < 19.190624  # yaw alone
    assert plan.summary["optimality"] == "extremal with 5 switches: Pontryagin's condition holds"
    assert np.abs(plan.position[:, 1]).max() > 0.3
    assert plan.state[-1] == pytest.approx([1, 0, 0, 0, 0, 0], abs=1e-9)
    assert np.abs(plan.effort).max() <= 100.0 + 1e-9
    assert [update.number for update in heard] == [1, 2, 3, 4]
    assert heard[-1].objective == pytest.approx(plan.duration, rel=1e-3)


def test_both_joints_of_m1_arrive_at_once(one_start: None) -> None:
    plan = planned({"base_yaw": 1.0, "hub_pitch": 0.5})
    assert plan.summary["optimal"]
    assert plan.duration > plan.summary["rigid_duration"]
    assert plan.state[-1] == pytest.approx([1, 0.5, 0, 0, 0, 0], abs=1e-9)
    signs = np.array(plan.summary["arc_efforts"]) / 100.0
    assert np.abs(signs) == pytest.approx(1.0)
    assert (np.abs(np.diff(signs, axis=0)).sum(axis=1) == 2.0).all()  # one drive at a time


@pytest.mark.slow
def test_efforts_that_hardly_matter_are_kept_as_the_programme_found_them(one_start: None) -> None:
    plan = planned({"hub_pitch": 0.5})
    assert not plan.summary["optimal"]
    assert plan.summary["optimality"].startswith("the optimum of a transcription on 100 intervals")
    assert plan.state[-1] == pytest.approx([0, 0.5, 0, 0, 0, 0], abs=1e-9)


@pytest.mark.parametrize("variant", ["printed", "complete"])
@pytest.mark.parametrize("modes", [1, 3])
def test_the_symbolic_model_is_the_testbed(variant: CsaVariant, modes: int) -> None:
    testbed = CsaTestbed(variant=variant, modes=modes, damping_ratio=0.02)
    model = testbed.model()
    rng = np.random.default_rng(5)
    rate = all_drives._rate(casadi, testbed, model.coordinates, 2)
    for _ in range(5):
        x, effort = rng.standard_normal(2 * model.coordinates), 100.0 * rng.standard_normal(2)
        ours = np.asarray(rate(x, effort)).ravel()
        assert ours == pytest.approx(model.derivative(x, effort), rel=1e-10, abs=1e-12)


def test_what_cannot_be_done_is_said_in_one_line(
    monkeypatch: pytest.MonkeyPatch, one_start: None
) -> None:
    with pytest.raises(
        BadInput,
        match="robust: True is not allowed: a slew that more than one",
    ):
        planned({"base_yaw": 1.0, "hub_pitch": 0.5}, robust=True)
    with pytest.raises(BadInput, match="drives: 'all' is not allowed: there is one"):
        planned({"mass": 1.0}, model={"kind": "floating_oscillator"}, amplitude=1.0, drives="all")
    with pytest.raises(PlanFailed, match=r"takes 18\.49\d+ s with 100 N m, 15 s allowed"):
        planned({"base_yaw": 1.0, "hub_pitch": 0.5}, longest=15.0)
    monkeypatch.setitem(sys.modules, "casadi", None)
    with pytest.raises(BadInput, match=r"need the package casadi: \./flexslew extras casadi$"):
        planned({"base_yaw": 1.0, "hub_pitch": 0.5})


def test_an_interrupt_inside_the_solver_ends_the_planning(monkeypatch: pytest.MonkeyPatch) -> None:
    iterations, check = [], Interrupt.check

    def interrupted_at_the_third(self: Any, iteration: int = 0) -> None:
        iterations.append(iteration)
        if len(iterations) == 3:
            signal.raise_signal(signal.SIGINT)
        check(self, iteration)

    monkeypatch.setattr(Interrupt, "check", interrupted_at_the_third)
    heard: list[Any] = []
    before = signal.getsignal(signal.SIGINT)
    with pytest.raises(KeyboardInterrupt):
        planned({"base_yaw": 1.0, "hub_pitch": 0.5}, heard=heard)
    assert heard == []  # no other start was tried
    assert len(iterations) <= 4
    assert signal.getsignal(signal.SIGINT) is before


def test_an_interrupt_reaches_the_handler_that_was_there_before() -> None:
    heard: list[Any] = []
    before = signal.signal(signal.SIGINT, lambda number, frame: heard.append(number))
    try:
        with pytest.raises(KeyboardInterrupt), interruptible(Interrupt()):
            signal.raise_signal(signal.SIGINT)
        assert heard == [signal.SIGINT]
    finally:
        signal.signal(signal.SIGINT, before)
