"""`analyse`: the numbers of a trial's loop, for built-in laws and a user's class, and the page."""

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from typer.testing import CliRunner

from flexslew_control.analysis.linear_plant import sampled_plant
from flexslew_control.analysis.loop import loop_of
from flexslew_control.analysis.loop_margins import channel_margins, frequency_response
from flexslew_control.analysis.rest import rest_of
from flexslew_control.controllers import build_controller
from flexslew_control.controllers.probing.running_law import running_law
from flexslew_lab.analysis.analysis import loop_analysis, residual_curve, responses
from flexslew_lab.analysis.page import analysis_page
from flexslew_lab.analysis.trial_models import point_of
from flexslew_lab.cli.main import app
from flexslew_lab.notebook import fly, trial
from flexslew_lab.trial.trial import plan_of_trial, plant_of
from flexslew_plant.errors import BadInput

OWN = f"{Path(__file__).parents[3] / 'docs/examples/my_law.py'}:MyLaw"
M1 = {"plan": None, "controllers": {"pd_feedforward": {}, "mine": {"law": OWN}}}


@pytest.mark.slow
def test_a_user_s_class_has_the_margins_of_the_built_in_law_that_it_is() -> None:
    ours, theirs = (
        loop_analysis(trial("m1", M1), "m1", name) for name in ("pd_feedforward", "mine")
    )
    for a, b in zip(ours.efforts, theirs.efforts, strict=True):
        assert a.gain_up == pytest.approx(b.gain_up, rel=1e-6)
        assert a.delay == pytest.approx(b.delay, rel=1e-6)
    assert ours.disks["input"].alpha == pytest.approx(theirs.disks["input"].alpha, rel=1e-6)


@pytest.mark.slow
def test_the_law_is_the_one_in_charge_then() -> None:
    pid = {"at": 0.2, "switch": "collocated_pid"}
    laws: dict[str, Any] = {"pd_feedforward": {}, "collocated_pid": {}}
    keys = {"plan": None, "duration": 1.0, "controllers": laws}
    what = trial("m1", {**keys, "schedule": [{"at": 0.57, "switch": "pd_feedforward"}, pid]})
    charged = {None: "pd_feedforward", 0.19: "pd_feedforward", 0.2: "collocated_pid",
               0.569: "collocated_pid", 0.57: "pd_feedforward"}  # fmt: skip
    for at, name in charged.items():
        assert loop_analysis(what, "m1", at=at).controller == name
    assert loop_analysis(what, "m1", "pd_feedforward", 0.3).controller == "pd_feedforward"


@pytest.mark.slow
def test_the_frequencies_are_the_plant_s_and_every_mode_is_moved_and_seen() -> None:
    what = trial("m1", M1)
    found = loop_analysis(what, "m1", joints={"hub_pitch": 0.5})
    model = what.testbed.model()
    linear = model.linearise(model.rest({"hub_pitch": 0.5}))
    np.testing.assert_allclose([m.frequency for m in found.modes], linear.frequencies, rtol=1e-9)
    for column in (*found.modes[0].moved, *found.modes[0].seen):
        values = [{**m.moved, **m.seen}[column] for m in found.modes]
        assert max(values) == pytest.approx(1.0) or not any(values)  # a joint that bends nothing
    assert all(max(map(abs, mode.shape.values())) == pytest.approx(1.0) for mode in found.modes)


@pytest.mark.slow
def test_a_step_of_the_reference_ends_there_and_a_disturbance_at_its_static_error() -> None:
    found = loop_analysis(trial("m1", {**M1, "testbed.modes": 1}), "m1")
    end = {name: answer[-1] for name, answer in responses(found, 40_000).items()}
    names = found.loop.sensor_names
    at = names.index("position.hub_pitch")
    assert end["reference.hub_pitch"][at] == pytest.approx(1.0, abs=1e-6)
    assert end["disturbance.hub_pitch"][at] == pytest.approx(1.0 / 460.0, rel=1e-6)


@pytest.mark.slow
def test_a_shaped_plan_leaves_nothing_at_its_frequency() -> None:
    what = trial("m1", {"plan": {"method": "input_shaping", "shaper": "zvd", "duration": 30.0,
                                 "goal": {"hub_pitch": 0.5}}})  # fmt: skip
    plan = plan_of_trial(what)
    assert plan is not None
    first = loop_analysis(trial("m1", M1), "m1").modes[0].frequency
    curves, _ = residual_curve(plan, np.array([1e-6, first]))
    for curve in curves.values():
        assert curve.max() <= 1.0 + 1e-9


def test_the_page_and_the_json_hold_everything(tmp_path: Any) -> None:
    out = tmp_path / "page.html"
    arguments = ["analyse", "time_optimal_hub", "--set", "plan.method=reference_only", "--set",
                 "plan.robust=null", "--out", str(out)]  # fmt: skip
    found = loop_analysis(trial("time_optimal_hub", {"plan": None}), "hub")
    page = analysis_page(found, "hub")
    assert page.index("Stable; the smallest margin is ") < page.index("<h2>")
    smallest = min(c.phase for c in found.efforts)
    assert f"{np.degrees(smallest):.3g} deg" in found.verdict or "gain margin" in found.verdict
    assert "limited by " in found.verdict
    assert " at stiffness x " in found.verdict
    for words in ("Natural modes", "Poles of the closed loop", "Disk margins", "Peaks of S and T",
                  "Bode", "Nyquist", "Nichols", "Singular values", "Steps"):  # fmt: skip
        assert f"<h2>{words}</h2>" in page
    done = CliRunner().invoke(
        app, ["analyse", "time_optimal_hub", "--set", "plan=null", "--json", "--out", str(out)]
    )
    assert done.exit_code == 0, (done.output, arguments)
    numbers = json.loads(done.stdout[: done.stdout.rindex("}") + 1])
    assert set(numbers["disks"]) == {"input", "output", "both"}
    assert numbers["stable"] is True
    assert numbers["efforts"][0]["gain_up"] == pytest.approx(found.efforts[0].gain_up)
    assert out.exists()


def test_a_loop_that_is_not_stable_says_so_and_has_no_margins() -> None:
    wild = {"collocated_pid": {"kp": [460.0], "kd": [920.0], "ki": [15.0]}}
    what = trial("time_optimal_oscillator",
                 {"plan": None, "controllers": wild, "active": "collocated_pid"})  # fmt: skip
    found = loop_analysis(what, "it")
    assert not found.stable
    assert found.efforts == ()
    assert min(pole.damping for pole in found.poles) < 0.0
    assert "NOT STABLE" in analysis_page(found, "it")
    assert found.verdict.startswith("not stable, so there are no margins; it grows at ")


def test_an_unknown_controller_is_refused() -> None:
    with pytest.raises(BadInput, match="--controller: nobody is not in controllers"):
        loop_analysis(trial("m1", M1), "m1", "nobody")


@pytest.mark.slow
@pytest.mark.parametrize("law", ["pd_feedforward", "linear"])
def test_a_free_craft_has_the_margins_of_its_law_in_every_attitude(law: str) -> None:
    gains = np.hstack((12.0 * np.eye(3), 60.0 * np.eye(3))).tolist()
    laws: dict[str, dict[str, Any]] = {
        "pd_feedforward": {"kp": [12.0], "kd": [60.0]},
        "linear": {"system": {"d": gains}},
    }
    what = trial("three_axes", {"plan": None, "controllers": {law: laws[law]}, "active": law})
    point, plant = point_of(what), plant_of(what)
    limit, found = plant.effort_limit, []
    for turn in ({}, {"roll": 0.5, "pitch": -0.3, "yaw": 1.0}, {"yaw": 2.5}):
        rest = rest_of(plant.testbed, turn)
        built = build_controller("it", law, laws[law], plant, "here")
        form = running_law(built, rest, limit).form
        loop = loop_of(sampled_plant(rest, point.path, applied=True), form)
        sweep = frequency_response(loop)
        margins = [channel_margins(sweep, name) for name in loop.effort_names]
        found.append([(m.gain_up, m.phase, m.delay) for m in margins])
        # a step of the reference is the same rotation
        at = [form.inputs.index(f"reference.{joint}") for joint in plant.joint_names]
        np.testing.assert_allclose(form.d[:, at], 12.0 * np.eye(3), atol=1e-8)
    np.testing.assert_allclose(found[1:], [found[0]] * 2, rtol=1e-6)


@pytest.mark.slow
def test_a_disturbance_moves_a_motor_with_friction_as_on_the_bench() -> None:
    rubbing, push = {"viscous_friction": 2e4, "lag": 0.05}, {"base_yaw": 0.1}
    what = trial("m1", {**M1, "actuator": rubbing, "duration": 1.0,
                        "schedule": [{"at": 0.0, "disturbance": push}]})  # fmt: skip
    found = loop_analysis(what, "it")
    answer = responses(found, 101)["disturbance.base_yaw"]
    ours = 0.1 * answer[:, found.loop.sensor_names.index("position.base_yaw")]
    measured = fly(what)["position.base_yaw"][:101]
    np.testing.assert_allclose(ours, measured, atol=1e-6 * abs(measured).max())
