"""Stiffness and payload that are set in the C code of a plant act as on the bench."""

import ctypes
from pathlib import Path

import numpy as np
import pytest
from tests.lab.export.fmu.test_model_exchange import exchanged, write_plant

from flexslew_lab.export.compiled import CompiledModule, compilers
from flexslew_lab.export.flight_vector import plant_vector
from flexslew_lab.export.fmu.description import Version
from flexslew_lab.export.plant_module import plant_module
from flexslew_lab.trial.sources import read_trial
from flexslew_lab.trial.trial import plan_of_trial

needs_compiler = pytest.mark.skipif(not compilers(), reason="no C compiler is here: gcc or clang")
DAMPED = "testbed.damping_ratio=0.01"
CHANGED = [  # stiffness times 1.3, payload times 1.2
    "testbed.parameters.bending_stiffness=1950.0",
    "testbed.parameters.hub_inertia_1=2400.0",
    "testbed.parameters.hub_inertia_2=2400.0",
]


@needs_compiler
def test_m1_with_other_beams_and_another_hub_moves_as_on_the_bench(tmp_path: Path) -> None:
    trial, source = read_trial("m1", ["duration=20.0", DAMPED])
    other, _ = read_trial("m1", ["duration=20.0", DAMPED, *CHANGED])
    module = plant_module(trial)
    assert [(one.name, one.start) for one in module.parameters] == [
        ("stiffness", (1.0,)),
        ("payload", (1.0,)),
    ]
    vector = plant_vector(other, module, plan_of_trial(trial, predict=False), source)
    compiled, errors = CompiledModule(module, tmp_path), []
    for factors in ((1.0, 1.0), (1.3, 1.2)):
        compiled.init()
        compiled.function("set_parameters")(compiled.memory, (ctypes.c_double * 2)(*factors))
        errors.append(vector.error(np.array([compiled.step(row) for row in vector.inputs])))
    assert errors[1] < 1e-12
    assert errors[0] > 1e-2


@needs_compiler
def test_factors_of_one_change_no_bit(tmp_path: Path) -> None:
    trial, source = read_trial("m1", ["duration=10.0", DAMPED])
    module = plant_module(trial)
    vector = plant_vector(trial, module, plan_of_trial(trial, predict=False), source)
    compiled = CompiledModule(module, tmp_path)
    plain = np.array([compiled.step(row) for row in vector.inputs])
    compiled.init()
    compiled.function("set_parameters")(compiled.memory, (ctypes.c_double * 2)(1.0, 1.0))
    np.testing.assert_array_equal([compiled.step(row) for row in vector.inputs], plain)


@needs_compiler
@pytest.mark.parametrize(
    ("name", "version"),
    [("acc_benchmark", 2), ("time_optimal_hub", 3), ("antenna_3", 3), ("scole_s_open", 3)],
)
def test_an_fmu_has_the_derivatives_of_the_scaled_testbed(
    name: str, version: Version, tmp_path: Path
) -> None:
    pytest.importorskip("fmpy")
    path, trial = write_plant(tmp_path, version, name)
    with exchanged(path) as plant:
        variables = {v.name: v for v in plant.description.modelVariables}
        assert (variables["stiffness"].variability, variables["stiffness"].start) == (
            "fixed",
            "1.0",
        )
        assert "payload" not in variables
        with pytest.raises(Exception, match="Set"):
            plant.set({"stiffness": 0.0})
        plant.set({"stiffness": 1.7})
        plant.begin()
        x = np.random.default_rng(6).normal(size=len(plant.states))
        joints = len(trial.testbed.model().joint_names)
        right = trial.testbed.scaled(1.7).model().derivative(x, np.zeros(joints), 0.5)
        slopes = plant.slopes_at(0.5, x, {})
        assert np.abs(slopes - right).max() < 1e-11 * np.abs(right).max()
        assert plant.get(["stiffness"]).tolist() == [1.7]
        with pytest.raises(Exception, match="Set"):
            plant.set({"stiffness": 1.0})
