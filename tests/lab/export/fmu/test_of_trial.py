"""Controllers of trials as FMUs, flown on the bench in lock-step by FMPy."""

import importlib
import shutil
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any, cast

import numpy as np
import pytest

from flexslew_lab.export.c_module import CModule, module_of
from flexslew_lab.export.compiled import CompiledController, CompiledModule
from flexslew_lab.export.fmu.description import Version
from flexslew_lab.export.fmu.of_trial import fmu_of_trial
from flexslew_lab.export.plant_module import plant_module
from flexslew_lab.run.flight_log import FlightLog
from flexslew_lab.run.in_process import run_bench
from flexslew_lab.trial.sources import read_trial
from flexslew_lab.trial.trial import plan_of_trial, set_plan, set_up
from flexslew_plant.arrays import Matrix, Vector

fmpy: Any = pytest.importorskip("fmpy")
pytestmark = pytest.mark.skipif(shutil.which("cc") is None, reason="no C compiler cc here")


TOLERANCE = 1e-9  # of states and efforts in closed loop [rad, rad/s, N m]


class Stepped:
    """An FMU in place of a compiled.CompiledModule."""

    def __init__(self, path: Path, module: CModule) -> None:
        self.module = module
        self.description = fmpy.read_model_description(str(path))
        self.folder = fmpy.extract(str(path))
        self.unit = fmpy.instantiate_fmu(self.folder, self.description, "CoSimulation")
        variables = self.description.modelVariables
        self.inputs = [v.valueReference for v in variables if v.causality == "input"]
        self.outputs = [v.valueReference for v in variables if v.causality == "output"]
        self.references = {v.name: v.valueReference for v in variables}
        self.tick = -1

    def init(self) -> None:
        if self.tick >= 0:
            self.unit.reset()
        self.unit.enterInitializationMode()
        self.unit.exitInitializationMode()
        self.tick = 0

    def step(self, inputs: Vector) -> Vector:
        self.set(self.inputs, inputs[1:].tolist())
        self.advance()
        return np.array(self.get(self.outputs))

    def advance(self) -> None:
        self.unit.doStep(self.tick * self.module.period, self.module.period)
        self.tick += 1

    def set(self, references: list[int], values: list[float]) -> None:
        two = self.description.fmiVersion == "2.0"
        (self.unit.setReal if two else self.unit.setFloat64)(references, values)

    def get(self, references: list[int]) -> list[float]:
        two = self.description.fmiVersion == "2.0"
        return list((self.unit.getReal if two else self.unit.getFloat64)(references))

    def named(self, *names: str) -> list[int]:
        return [self.references[name] for name in names]


@contextmanager
def stepped(path: Path, module: CModule) -> Iterator[Stepped]:
    made = Stepped(path, module)
    yield made
    made.unit.terminate()
    made.unit.freeInstance()
    shutil.rmtree(made.folder)


def states(log: FlightLog) -> Matrix:
    return np.array([np.append(truth.position, truth.velocity) for truth in log.truth_log])


@pytest.mark.parametrize("version", [2, 3])
def test_m1_with_its_controller_as_an_fmu_flies_as_on_the_bench(
    version: Version, tmp_path: Path
) -> None:
    trial, source = read_trial("m1", ["duration=30.0"])
    plan = plan_of_trial(trial, predict=False)
    _, written = set_up(trial, source)
    module = module_of(trial, written[trial.active], plan, source=source)
    path = tmp_path / "m1.fmu"
    path.write_bytes(fmu_of_trial(trial, module, version, ("linux64",)))
    assert importlib.import_module("fmpy.validation").validate_fmu(str(path)) == []
    logs = []
    with stepped(path, module) as unit:
        names = {v.name: v.unit for v in unit.description.modelVariables}
        assert names["effort.base_yaw"] == "N m"
        assert names["joint_velocity.hub_pitch"] == "rad/s"
        in_fmu: Any = CompiledController(trial.active, cast(CompiledModule, unit))
        for flown in (None, {trial.active: in_fmu}):
            bench, controllers = set_up(trial, source)
            set_plan(controllers, trial.active, plan)
            logs.append(FlightLog(bench, plan))
            run_bench(bench, flown or controllers, logs[-1])
    assert len(logs[0].truth_log) == 3001
    np.testing.assert_allclose(states(logs[1]), states(logs[0]), rtol=0.0, atol=TOLERANCE)


@pytest.mark.parametrize("version", [2, 3])
def test_m1_of_two_fmus_in_lock_step_is_the_bench(version: Version, tmp_path: Path) -> None:
    trial, source = read_trial("m1", ["duration=30.0"])
    plan = plan_of_trial(trial, predict=False)
    bench, controllers = set_up(trial, source)
    set_plan(controllers, trial.active, plan)
    log = FlightLog(bench, plan)
    run_bench(bench, controllers, log)
    _, written = set_up(trial, source)
    modules = plant_module(trial), module_of(trial, written[trial.active], plan, source=source)
    for module, name in zip(modules, ("plant", "controller"), strict=True):
        path = tmp_path / f"{name}.fmu"
        path.write_bytes(fmu_of_trial(trial, module, version, ("linux64",)))
        assert importlib.import_module("fmpy.validation").validate_fmu(str(path)) == []
    found = []
    joints = trial.testbed.model().joint_names
    with (
        stepped(tmp_path / "plant.fmu", modules[0]) as plant,
        stepped(tmp_path / "controller.fmu", modules[1]) as controller,
    ):
        shared = sorted(set(plant.references) & set(controller.references) - {"time"})
        shared = [name for name in shared if not name.startswith("effort.")]
        efforts = [f"effort.{name}" for name in joints]
        seen = [
            f"{kind}.{name}" for kind in ("joint_position", "joint_velocity") for name in joints
        ]
        assert len(shared) == 2 * len(joints) + len(joints) + 2 * 2
        plant.init()
        controller.init()
        for _ in log.truth_log:
            found.append(plant.get(plant.named(*seen)))
            values = plant.get(plant.named(*shared))
            controller.set(controller.named(*shared), values)
            controller.advance()
            effort = controller.get(controller.named(*efforts))
            plant.set(plant.named(*efforts), effort)
            plant.advance()
    truth = np.array([np.append(t.position[:2], t.velocity[:2]) for t in log.truth_log])
    np.testing.assert_allclose(np.array(found), truth, rtol=0.0, atol=TOLERANCE)
