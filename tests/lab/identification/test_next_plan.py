"""A bench whose payload has changed learns from a manoeuvre what the next one gains."""

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from tests.lab.conftest import Call
from tests.representatives import representatives

from flexslew_lab.run.run_trial import run_trial
from flexslew_lab.trial.overrides import override_values
from flexslew_lab.trial.sources import read_trial
from flexslew_lab.trial.trial import Trial, trial_of_values
from flexslew_plant.settings import plain


def slew(folder: Path, free_mass: float, believed: dict[str, Any] | None = None) -> Any:
    """Return the run of a slew with another payload; its plan believes the nominal one."""
    nominal: Trial = read_trial("replan_oscillator", None)[0]
    changes = {
        "testbed.parameters.free_mass": free_mass,
        "plan.model": believed or plain(nominal.testbed),
    }
    trial = trial_of_values(override_values(plain(nominal), changes), "test")
    return run_trial(trial, "test", folder, in_process=True, report=False)


@pytest.mark.slow
@pytest.mark.parametrize("free_mass", representatives([0.7, 1.4], 1.4))
def test_the_next_plan_is_better_as_foretold(tmp_path: Path, call: Call, free_mass: float) -> None:
    first = slew(tmp_path / "first", free_mass)
    code, out, _ = call("identify", tmp_path / "first", "--replan", "--json")
    assert code == 0
    told = json.loads(out[out.index("{\n") : out.rindex("}") + 1])
    (mode,) = told["modes"]
    w = np.sqrt(1.0 + 1.0 / free_mass)
    assert mode["frequency"]["value"] == pytest.approx(w, rel=2e-3)
    better = told["next_plan"]
    # the first was flown: the bench that was found leaves what the bench left
    assert better["flown"] == pytest.approx(first.metrics["residual_tip_deflection"], rel=0.1)
    model = {"file": str(tmp_path / "first" / "identified.yaml")}
    second = slew(tmp_path / "second", free_mass, model)
    left = second.metrics["residual_tip_deflection"]
    assert left < 0.1 * first.metrics["residual_tip_deflection"]
    assert better["again"] == pytest.approx(left, rel=0.5)  # both are the sensors' noise


def test_without_a_slew_there_is_no_next_one(tmp_path: Path, call: Call) -> None:
    nominal: Trial = read_trial("replan_oscillator", None)[0]
    plan = {"method": "excitation", "band": [0.3, 6.0], "duration": 60.0, "model": {}}
    shaken = trial_of_values(plain(nominal) | {"plan": plan, "duration": 65.0}, "test")
    run_trial(shaken, "test", tmp_path / "shake", in_process=True, report=False)
    code, _, err = call("identify", tmp_path / "shake", "--replan")
    assert code == 2
    assert "--replan needs the log of a slew" in err
