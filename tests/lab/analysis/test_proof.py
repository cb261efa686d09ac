"""`analyse --prove`: what is predicted is what the non-linear bench flies."""

import json
from dataclasses import replace
from typing import Any

import control
import numpy as np
import pytest
from tests.representatives import representatives
from typer.testing import CliRunner

import flexslew as fs
from flexslew_control.analysis.ring_down import fit_decay
from flexslew_lab.analysis.analysis import Analysis, loop_analysis
from flexslew_lab.analysis.page import analysis_page
from flexslew_lab.analysis.proof import verify_margins
from flexslew_lab.cli.main import app
from flexslew_lab.notebook import trial
from flexslew_lab.trial.trial import Trial
from flexslew_plant.errors import BadInput

OSCILLATOR = {"plan": None, "testbed.damping_ratio": 0.01, "period": 0.02}


@pytest.fixture(scope="module")
def oscillator() -> tuple[Trial, Analysis]:
    what = trial("time_optimal_oscillator", OSCILLATOR)
    return what, loop_analysis(what, "here")


def test_poles_and_margins_are_those_of_the_flown_bench(
    oscillator: tuple[Trial, Analysis],
) -> None:
    proof = verify_margins(*oscillator)
    assert proof.holds
    assert len(proof.poles) >= 2
    for pole in proof.poles:
        assert pole.flown_frequency == pytest.approx(pole.frequency, rel=1e-9)
        assert pole.flown_damping == pytest.approx(pole.damping, rel=1e-6)
    assert {margin.kind for margin in proof.margins} >= {"gain up", "delay"}
    for margin in proof.margins:
        assert margin.inside < 0.0 < margin.outside
        assert margin.flown == pytest.approx(margin.predicted, rel=1e-3)  # curvature of its growth
    page = analysis_page(oscillator[1], "it", proof)
    assert "Margins proved" in page
    assert "Poles proved" in page


def test_a_wrong_prediction_is_found(oscillator: tuple[Trial, Analysis]) -> None:
    what, right = oscillator
    wrong = replace(right.efforts[0], delay=1.1 * right.efforts[0].delay)
    proof = verify_margins(what, replace(right, efforts=(wrong,)))
    assert not proof.holds
    assert [m.kind for m in proof.margins if not m.agrees] == ["delay"]


def test_a_plant_that_the_analysis_did_not_have_is_found(
    oscillator: tuple[Trial, Analysis],
) -> None:
    stiffer = trial("time_optimal_oscillator", {**OSCILLATOR, "testbed.parameters.stiffness": 1.05})
    assert not verify_margins(stiffer, oscillator[1]).holds


@pytest.mark.parametrize("other", ["m1", "own_spacecraft"])
def test_the_analysis_of_another_bench_is_refused(
    oscillator: tuple[Trial, Analysis], other: str
) -> None:
    with pytest.raises(BadInput, match="the analysis is of another bench"):
        verify_margins(trial(other), oscillator[1])


def test_the_command_shows_it_as_json() -> None:
    done = CliRunner().invoke(
        app,
        ["analyse", "time_optimal_oscillator", "--set", "plan=null", "--set",
         "testbed.damping_ratio=0.01", "--set", "period=0.02", "--prove", "--json"],
    )  # fmt: skip
    assert done.exit_code == 0, done.output
    assert json.loads(done.output)["proof"]["holds"] is True


def test_a_loop_that_is_not_stable_has_nothing_to_prove(
    oscillator: tuple[Trial, Analysis],
) -> None:
    what, found = oscillator
    with pytest.raises(BadInput, match="not stable"):
        verify_margins(what, replace(found, stable=False))


@pytest.mark.parametrize("seed", range(3))
def test_a_sum_of_waves_has_the_poles_that_it_was_made_of(seed: int) -> None:
    rng = np.random.default_rng(seed)
    s: Any = np.array([-0.3 + 0j, -0.02 + 1.1j, 0.05 + 3.0j]) * rng.uniform(0.8, 1.2)
    time = 0.01 * np.arange(2000)
    waves = np.exp(np.outer(time, s)) @ (rng.standard_normal((3, 2)) + 1j)
    found = fit_decay(waves.real, 0.01, s * rng.uniform(0.98, 1.02, 3))
    np.testing.assert_allclose(found.s, s, rtol=1e-8)
    assert (found.deviation < 1e-8).all()


LAWS: dict[str, dict[str, Any]] = {
    "pd_feedforward": {"kp": [0.3], "kd": [1.0]},
    "collocated_pid": {"kp": [0.3], "ki": [0.02], "kd": [1.0]},
    "proportional_integral": {},
    "output_feedback": {},
    "lqr": {},
    "model_predictive": {"steps": 5},
    "linear": {"system": {"a": [[-20.0]], "b": [[0.3, 1.0]], "c": [[20.0]], "d": [[0.0, 0.0]]}},
}


@pytest.mark.slow
@pytest.mark.parametrize("law", representatives(LAWS, "lqr", "linear"))
def test_what_a_law_predicts_is_flown_with_lag_and_delay(law: str) -> None:
    """Every pole that efforts move and sensors see, and every margin of an effort."""
    delay = {"at": 0.0, "fault": {"kind": "command_delay", "ticks": 1.5}}
    keys: Any = {"plan": None, "controllers": {law: LAWS[law]}, "active": law, "period": 0.02,
                 "testbed.damping_ratio": 0.01, "actuator.lag": 0.01, "schedule": [delay],
                 "allow_faults": True}  # fmt: skip
    what = trial("time_optimal_oscillator", keys)
    proof = verify_margins(what, loop_analysis(what, "here"))
    assert proof.holds
    assert len(proof.poles) >= 2
    for pole in proof.poles:
        assert pole.flown_frequency == pytest.approx(pole.frequency, rel=1e-8)


@pytest.mark.parametrize(
    ("law", "settings"),
    [
        ("disturbance_minimisation", {"design": "sampled"}),
        ("disturbance_accommodating", {}),
    ],
)
def test_a_law_that_holds_a_rest_and_takes_no_reference_is_flown_too(
    law: str, settings: dict[str, Any]
) -> None:
    keys: Any = {**OSCILLATOR, "controllers": {law: settings}, "active": law}
    what = trial("time_optimal_oscillator", keys)
    found = loop_analysis(what, "here")
    form = found.running.form
    assert not form.d[:, form.inputs.index("reference.mass")].any()
    proof = verify_margins(what, found)
    assert proof.holds
    assert len(proof.poles) >= 2
    assert proof.margins


def test_a_law_of_the_flexible_mode_alone_leaves_the_rigid_motion_uncontrolled() -> None:
    keys: Any = {**OSCILLATOR, "controllers": {"modal_space": {}}, "active": "modal_space"}
    found = loop_analysis(trial("time_optimal_oscillator", keys), "here")
    assert found.statement == "marginal: mass is not controlled"


@pytest.mark.slow
@pytest.mark.parametrize(
    "sensor",
    [
        {"kind": "gyro", "angle_random_walk": 2e-6, "bias": [1e-3, 0.0, 0.0]},
        {"kind": "star_tracker", "across": 5e-6, "interval": 0.2, "delay": 0.1},
    ],
)
def test_instruments_that_no_law_hears_refute_no_margin(sensor: dict[str, Any]) -> None:
    what = trial("three_axes", {"testbed.sensors": {"one": sensor}})
    assert verify_margins(what, loop_analysis(what, "here")).holds


@pytest.mark.slow
def test_a_sensor_of_a_craft_that_reads_in_steps_refutes_no_margin() -> None:
    """Flights of a proof move by far less than a step."""
    along = {"appendage": "left", "direction": [0.0, 0.0, 1.0]}
    steps = {"kind": "displacement", **along, "noise": 1e-5, "bias": 1e-3, "quantisation": 1e-4}
    heard = ["position:roll", "rate:roll", "tip:left"]
    law = control.ss([], [], [], [[-12.0, -60.0, 20.0]], inputs=heard, outputs=["effort:roll"])
    what = fs.trial("own_spacecraft", {"testbed.sensors": {"left": steps}, "plan": None}, law=law)
    assert verify_margins(what, loop_analysis(what, "here")).holds


@pytest.mark.slow
def test_flights_stay_where_dry_friction_has_its_slope_at_rest() -> None:
    what = trial("time_optimal_hub", {"plan": None, "actuator.coulomb_friction": 0.01})
    proof = verify_margins(what, loop_analysis(what, "here"))
    assert proof.holds
    assert max(pole.left for pole in proof.poles) < 1e-4


@pytest.mark.slow
def test_a_delay_beyond_what_a_fault_can_do_is_told_and_not_flown() -> None:
    friction = {**OSCILLATOR, "actuator.coulomb_friction": 0.03}
    what = trial("time_optimal_oscillator", friction)
    found = loop_analysis(what, "here")
    assert found.efforts[0].delay > 10_000 * what.period
    proof = verify_margins(what, found)
    assert [margin.kind for margin in proof.margins] == ["gain up"]
    told = f"effort.mass: delay of {found.efforts[0].delay:.4g} s, above 10000 ticks"
    assert proof.skipped == (told,)
    assert told in repr(proof)
    # a long name may break on the page, a number and its unit not
    page = analysis_page(found, "it", proof).replace("<wbr>", "").replace("\xa0", " ")
    assert f"Not flown: {told}" in page
    assert proof.plain()["not_flown"] == [told]


def test_a_law_that_listens_to_nothing_closes_no_loop() -> None:
    keys: Any = {"plan": None, "controllers": {"linear": {}}, "active": "linear"}
    with pytest.raises(BadInput, match="closes no loop"):
        loop_analysis(trial("time_optimal_oscillator", keys), "here")
