"""After a reset every law, filter and allocation begins as one that was just started."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from tests.representatives import products, representatives
from tests.wire_bench import WireBench

from flexslew_control.controllers import CONTROLLERS, build_controller
from flexslew_control.controllers.host import ControllerHost
from flexslew_lab.trial.sources import read_trial
from flexslew_lab.trial.trial import Trial, bench_settings, parse_trial, plant_of
from flexslew_plant.bench.bench import Bench
from flexslew_plant.bench.records import SwitchRequest
from flexslew_plant.measurement import Measurement
from flexslew_plant.own_code import Trust
from flexslew_plant.yaml_data import yaml_text

GAINS = {"d": [[460.0, 0.0, 920.0, 0.0], [0.0, 460.0, 0.0, 920.0]]}
LAWS = [law for law in CONTROLLERS if law != "planned_gains"]  # which needs a plan
SHIPPED = ["three_axes", "control_moment_gyros", "observatory", "antenna_2", "designs"]


def with_law(law: str) -> Trial:
    """Return a trial of csa with a law and another one, pushed and with noise."""
    values: dict[str, Any] = {
        "duration": 5.0,
        "testbed": {"modes": 1, "initial": {"hub_pitch": 0.1}},
        "controllers": {law: {"system": GAINS} if law == "linear" else {}, "other": None},
        "active": law,
        "sensors": {"joint_position": {"noise": 1e-4}},
        "schedule": [{"at": 0.0, "disturbance": {"base_yaw": 12.0, "hub_pitch": -7.0}}],
    }
    values["controllers"]["other"] = {"law": "pd_feedforward", "kp": 200.0, "kd": 400.0}
    return parse_trial(yaml_text(values), "test")


def after_a_reset(trial: Trial, flown: int) -> list[Any]:
    """Return the truths of an epoch that begins after so many ticks; 0: with new controllers."""
    bench = WireBench(trial)
    names = list(bench.hosts)
    if flown:
        bench.fly(10)
        for tick, name in ((20, names[-1]), (40, names[0]), (60, names[-1]), (75, names[0])):
            bench.session.switch(SwitchRequest(name, tick), bench.now)
        bench.fly(flown)
    bench.session.reset()
    if not flown:
        for name in names:
            bench.start(name)
    assert bench.session.start().ok
    bench.fly(40)
    return [truth for truth in bench.truth_log if truth.epoch == 1]


@pytest.mark.parametrize(
    "name", representatives([*LAWS, *SHIPPED], *LAWS, "three_axes", "control_moment_gyros")
)
def test_what_was_flown_before_a_reset_leaves_nothing_behind(name: str) -> None:
    trial = read_trial(name)[0] if name in SHIPPED else with_law(name)
    fresh = after_a_reset(trial, 0)
    assert len(fresh) > 30
    for flown in (50, 80):  # with another one in charge, and while its effort is blended out
        again = after_a_reset(trial, flown)
        for one, other in zip(fresh, again, strict=True):
            np.testing.assert_array_equal(one.applied_effort, other.applied_effort)
            np.testing.assert_array_equal(one.position, other.position)


class Hasty:
    """A law that gives up for good once a joint is off."""

    def __init__(self, settings: dict[str, Any], period: float, limit: Any) -> None:
        self.terms: dict[str, Any] = {}
        self.over = False

    def reset(self, *told: Any) -> None:
        self.over = False

    def update(self, measurement: Any, estimate: Any, reference: Any) -> Any:
        self.over |= bool(np.abs(measurement.joint_position).max() > 0.05)
        if self.over:
            raise ArithmeticError("off")
        return np.zeros(2)


UNREADY: dict[str, tuple[str, dict[str, Any], str]] = {
    "its estimate is doubted": ("lqr", {"monitor": {}}, "innovation"),
    "its estimate is not finite": ("lqr", {}, "finite"),
    "its law has failed": (f"{Path(__file__)}:Hasty", {}, "off"),
}


@pytest.mark.parametrize(("why", "told"), products(UNREADY, [True, False]))
def test_a_reset_takes_back_who_could_not_go_on(why: str, told: bool) -> None:
    """The bench starts again, whether its state has told of the reset or the first question."""
    law, own, words = UNREADY[why]
    fault = {"kind": "sensor_nan" if "finite" in why else "sensor_bias"}
    values = {
        "testbed": {"modes": 1},
        "allow_faults": True,
        "controllers": {"one": {"law": law, **own}},
        "active": "one",
    }
    bench = WireBench(parse_trial(yaml_text(values), "test", Trust.of([law])))
    bench.fly(20)
    more = {} if "finite" in why else {"bias": 0.1}
    assert bench.bench.inject(yaml_text({**fault, "channel": "joint_position", **more})).ok
    bench.fly(40)
    assert words in str(bench.hosts["one"].reason)
    assert bench.bench.drive.active == ""
    bench.session.reset()
    if told:
        bench.hosts["one"].begin_epoch(1)
        assert bench.hosts["one"].reason is None
    else:  # a bench that waits for nobody
        bench.session.reasons["one"] = None
        bench._tell = lambda: None  # type: ignore[method-assign]
    assert bench.session.start().ok
    bench.fly(20)
    assert bench.bench.drive.active == "one"
    assert bench.hosts["one"].reason is None
    assert bench.bench.drive.missed == 0


# for a craft that turns in three axes; others need to know more of it
OF_THREE_AXES = ["collocated_pid", "pd_feedforward", "lqr", "output_feedback",
                 "proportional_integral", "model_predictive"]  # fmt: skip


@pytest.mark.parametrize("law", representatives(OF_THREE_AXES, "collocated_pid", "lqr"))
def test_a_craft_that_rests_anywhere_is_held_there_without_effort_from_the_first_tick_on(
    law: str,
) -> None:
    """Without a plan what is held is where it was measured first: nothing moves, nothing pushes."""
    trial, _ = read_trial("three_axes")
    plant, appendages = plant_of(trial), len(Bench(bench_settings(trial)).appendages.names)
    host = ControllerHost(law, {})
    host.notify(lambda own: build_controller(law, law, own, plant, "test"), appendages)
    place, still, none = np.array([0.3, -0.2, 0.1]), np.zeros(3), np.zeros(appendages)
    for epoch in range(2):
        for tick in range(5):
            at = tick * trial.period
            question = Measurement(tick, epoch, at, law, place, still, none, none, still)
            answer = host.observe(question)
            assert answer is not None
            assert np.abs(answer.command.effort).max() < 1e-9, (epoch, tick)
