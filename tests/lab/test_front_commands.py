"""The commands plan, analyse --prove and identify as functions of `import flexslew`."""

import json
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import numpy as np
import pytest

import flexslew as fs
from flexslew_lab.identification.model_file import file_text
from flexslew_plant.yaml_data import load_yaml

SLEW: dict[str, Any] = {
    "name": "slew",
    "period": 0.01,
    "duration": 4.0,
    "testbed": {"kind": "floating_oscillator"},
    "plan": {"method": "reference_only", "goal": {"mass": 0.05}, "duration": 3.0},
    "controllers": {"pd_feedforward": {"kp": [2.0], "kd": [2.0]}},
}
SHAKE = {
    "plan.method": "excitation",
    "plan.band": [0.3, 6.0],
    "plan.largest_excursion": [0.2],
    "plan.duration": 60.0,
    "duration": 64.0,
}
HEAVY = {"testbed.parameters.free_mass": 1.3}


def cells(result: Any) -> list[list[str]]:
    """Return the table that a notebook shows of a result, below whose repr it stands."""
    page = ElementTree.fromstring(f"<div>{result._repr_html_()}</div>")
    assert page.text == repr(result)
    return [[cell.text or "" for cell in row] for row in page.iter("tr")]


@pytest.fixture(scope="module")
def shaken(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("identify") / "shaken"
    keys = {**SLEW, "plan": {}}
    fs.fly(fs.trial(keys, {**HEAVY, **SHAKE}), folder)
    return folder


def test_a_plan_without_a_flight_is_the_one_that_flies() -> None:
    plan = fs.plan(SLEW)
    assert repr(plan) == "<Plan reference_only of mass: 3 s from 0 s on>"
    planned, given = fs.fly(SLEW), fs.fly(fs.trial(SLEW, plan=plan))
    assert np.array_equal(plan.position, planned["reference"][: len(plan.position)])
    assert planned.metrics["trajectory_hash"] == given.metrics["trajectory_hash"]


def test_a_trial_without_a_plan_says_so() -> None:
    with pytest.raises(fs.BadInput, match="plan: is missing"):
        fs.plan({key: value for key, value in SLEW.items() if key != "plan"})


def test_the_margins_that_are_analysed_are_flown() -> None:
    found = fs.analyse(SLEW)
    proof = fs.prove(SLEW, found)
    assert proof.holds
    poles, margins = len(proof.poles), len(proof.margins)
    words = f"{poles} of {poles} poles and {margins} of {margins} margins flown as predicted"
    assert repr(proof) == f"<Proof: {words}>"
    assert [m.predicted for m in proof.margins if m.kind == "delay"] == [found.efforts[0].delay]
    assert cells(found)[1][3] == f"{found.efforts[0].delay:.6g}"
    assert len(cells(proof)) == 1 + margins + 2 * poles
    assert {row[3] for row in cells(proof)[1:]} == {"yes"}
    loose = fs.analyse(fs.trial(SLEW, {"controllers.pd_feedforward.kd": [300.0]}))
    assert not loose.stable
    assert len(cells(loose)) == 1 + len(loose.poles)


@pytest.mark.slow
def test_gains_that_were_found_are_flown() -> None:
    found = fs.gains(SLEW, keys=["kp"], trials=8, octaves=1.0)
    assert repr(found) == f"<FoundGains of pd_feedforward: {found.verdict}>"
    (kp,) = found.changes["controllers.pd_feedforward.kp"]
    assert 1.0 <= kp <= 4.0
    assert [row[:2] for row in cells(found)[1:]] == [["in the trial", "2"], ["found", f"{kp:.6g}"]]
    flown = fs.fly(fs.trial(SLEW, found.changes))
    assert flown.metrics["residual_tip_deflection"] <= found.best.outcome.residual
    with pytest.raises(fs.BadInput, match=r"^trials: 0 is not allowed: a whole number"):
        fs.gains(SLEW, trials=0)


@pytest.mark.slow
def test_planners_and_laws_are_compared_as_by_the_command() -> None:
    by_law = fs.compare(SLEW, laws=True)
    assert repr(by_law).startswith("<Comparison by law: pd_feedforward, ")
    rows = {row["law"]: row for row in by_law.rows()}
    assert [row[0] for row in cells(by_law)[1:]] == [
        entry.name for entry in by_law.simulated_entries
    ]
    flown = fs.fly(SLEW).metrics
    assert rows["pd_feedforward"]["residual_tip"] == flown["residual_tip_deflection"]
    pushed = fs.trial(SLEW, law=lambda measurement, reference: -measurement.joint_velocity)
    with pytest.raises(fs.BadInput, match="other processes need it in a file"):
        fs.compare(pushed, workers=2)


@pytest.mark.slow
def test_runs_tell_of_their_bench_what_the_command_prints(shaken: Path) -> None:
    found = fs.identify(shaken, str(shaken))
    truth = np.sqrt(1.0 + 1.0 / 1.3)
    (mode,) = found.model.modes
    assert mode.frequency.low < truth < mode.frequency.high
    assert f"modes at {mode.frequency.value:.4g} rad/s" in repr(found)
    assert cells(found)[1][:2] == ["mode 1, frequency [rad/s]", f"{mode.frequency.value:.6g}"]
    plain = json.loads(json.dumps(found.plain()))
    assert plain["modes"][0]["frequency"]["value"] == mode.frequency.value
    assert [one["source"] for one in plain["validation"]] == [found.model.record.source]
    assert found.model_section == load_yaml(file_text(found.model)[0], "text")["model"]


@pytest.mark.slow
def test_a_plan_that_believes_what_was_found_leaves_less(shaken: Path) -> None:
    slew = HEAVY | {"plan.method": "optimized_feedforward", "plan.duration": 6.0, "duration": 12.0}
    modes, stiffness = fs.identify(shaken), fs.identify(shaken, fit=["parameters.free_mass"])
    left = [
        fs.fly(fs.trial(SLEW, slew | model)).metrics["residual_tip_deflection"]
        for model in (
            {},
            {"plan.model": modes.model_section},
            {"plan.model": stiffness.model_section},
        )
    ]
    believed_nominal = fs.trial(SLEW, slew | {"plan.model": fs.trial(SLEW).testbed})
    nominal = fs.fly(believed_nominal).metrics["residual_tip_deflection"]
    assert max(left) < 0.1 * nominal


def test_identify_wants_a_run() -> None:
    with pytest.raises(fs.BadInput, match="give the folder of a run"):
        fs.identify()


def test_a_section_of_another_trial_is_a_value() -> None:
    heavy = fs.trial(SLEW, HEAVY)
    again = fs.trial(SLEW, {"testbed": heavy.testbed, "plan.model": fs.trial(SLEW).testbed})
    assert again.testbed == heavy.testbed
    assert fs.plan(again).request["model"]["parameters"]["free_mass"] == 1.0
