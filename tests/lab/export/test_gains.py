"""Gains that are replaced in the C code of a controller act as those of the bench."""

import ctypes
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from tests.lab.export.fmu.test_model_exchange import exchanged

from flexslew_lab.export.c_module import module_of
from flexslew_lab.export.compiled import CompiledModule, compilers
from flexslew_lab.export.flight_vector import controller_vector
from flexslew_lab.export.fmu.description import Version
from flexslew_lab.export.fmu.of_trial import fmu_of_trial
from flexslew_lab.trial.sources import read_trial
from flexslew_lab.trial.trial import build_controllers, plan_of_trial

needs_compiler = pytest.mark.skipif(not compilers(), reason="no C compiler is here: gcc or clang")
PD = ("m1", "pd_feedforward", {"kp": [500.0, 300.0], "kd": [800.0, 1000.0]})
PID = (
    "swap_demo",
    "collocated_pid",
    {"kp": [500.0, 300.0], "ki": [10.0, 20.0], "kd": [800.0, 1000.0]},
)
GAINS = {
    "kp": [[400.0, 0.0, 1.0], [0.0, 300.0, 0.0]],
    "kd": [[900.0, 0.0, 0.0], [0.0, 800.0, 2.0]],
    "ki": [[10.0, 0.0, 0.0], [0.0, 5.0, 0.0]],
}
INTEGRAL = ("swap_demo", "proportional_integral", GAINS)


SLIDING = (
    "swap_demo",
    "output_feedback",
    {"reaching_rate": 1.5, "attitude_gain": 0.2},
)


def set_parameters(compiled: CompiledModule, values: list[float]) -> None:
    numbers = (ctypes.c_double * len(values))(*values)
    compiled.function("set_parameters")(compiled.memory, numbers)


@needs_compiler
@pytest.mark.parametrize(("shipped", "law", "gains"), [PD, PID, INTEGRAL, SLIDING])
def test_gains_in_c_are_tuned_as_on_the_bench(
    shipped: str, law: str, gains: dict[str, Any], tmp_path: Path
) -> None:
    given, source = read_trial(shipped, ["duration=10.0", "schedule=[]"])
    own = given.controllers.get(law) or {}
    trial = replace(given, controllers={law: own}, active=law)
    plan = plan_of_trial(trial, predict=False)
    changed = {"gains": gains} if law == "proportional_integral" else gains
    tuned = replace(trial, controllers={law: {**own, **changed}})
    module = module_of(trial, build_controllers(trial, source)[law], plan, source=source)
    compiled, errors = CompiledModule(module, tmp_path), []
    start = [number for one in module.parameters for number in one.start]
    wanted = np.concatenate([np.ravel(gains[one.name]) for one in module.parameters])
    assert {one.name for one in module.parameters} == set(gains)
    vector = controller_vector(tuned, law, plan, source)
    for values in (start, wanted.tolist()):
        compiled.init()
        set_parameters(compiled, values)
        errors.append(vector.error(np.array([compiled.step(row) for row in vector.inputs])))
    assert errors[1] < 1e-10
    assert errors[0] > 1e-3


@needs_compiler
def test_init_takes_the_gains_of_the_trial(tmp_path: Path) -> None:
    trial, source = read_trial("m1", ["duration=5.0"])
    plan = plan_of_trial(trial, predict=False)
    module = module_of(trial, build_controllers(trial, source)[trial.active], plan)
    compiled = CompiledModule(module, tmp_path)
    vector = controller_vector(trial, trial.active, plan, source)
    set_parameters(compiled, [0.0] * 4)
    compiled.init()
    assert vector.error(np.array([compiled.step(row) for row in vector.inputs])) == 0.0


@needs_compiler
@pytest.mark.parametrize("version", [2, 3])
def test_gains_of_an_fmu_are_tuned_between_two_ticks(version: Version, tmp_path: Path) -> None:
    pytest.importorskip("fmpy")
    trial, source = read_trial("m1", ["plan=null"])
    module = module_of(trial, build_controllers(trial, source)[trial.active], None, source=source)
    path = tmp_path / "m1.fmu"
    path.write_bytes(fmu_of_trial(trial, module, version, ("linux64",)))
    efforts = ["effort.base_yaw", "effort.hub_pitch"]
    with exchanged(path, "CoSimulation") as law:
        found = {v.name: v for v in law.description.modelVariables if v.causality == "parameter"}
        assert {name: (v.variability, v.unit, float(v.start)) for name, v in found.items()} == {
            "kp.base_yaw": ("tunable", "N m/rad", 460.0),
            "kp.hub_pitch": ("tunable", "N m/rad", 460.0),
            "kd.base_yaw": ("tunable", "N m s/rad", 920.0),
            "kd.hub_pitch": ("tunable", "N m s/rad", 920.0),
        }
        law.begin()
        seen = []
        for k, gain in enumerate((460.0, 460.0, 300.0, 460.0)):
            law.set({"kp.base_yaw": gain, "joint_position.base_yaw": 0.01 * (k > 0)})
            law.unit.doStep(0.01 * k, 0.01)
            seen.append(law.get(efforts).tolist())
    wanted = np.array([[0.0, 0.0], [-4.6, 0.0], [-3.0, 0.0], [-4.6, 0.0]])
    np.testing.assert_allclose(np.array(seen), wanted, atol=1e-12)
