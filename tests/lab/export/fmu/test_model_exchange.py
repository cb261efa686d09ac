"""FMUs of plants for model exchange: integrated by others, they move as on the bench."""

import importlib
import shutil
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from flexslew_lab.export.flight_vector import FlightVector, plant_vector
from flexslew_lab.export.fmu.description import Version
from flexslew_lab.export.fmu.of_trial import fmu_of_trial
from flexslew_lab.export.plant_module import plant_module
from flexslew_lab.trial.sources import read_trial
from flexslew_lab.trial.trial import Trial, plan_of_trial
from flexslew_plant.arrays import Matrix, Vector

fmpy: Any = pytest.importorskip("fmpy")
pytestmark = pytest.mark.skipif(shutil.which("cc") is None, reason="no C compiler cc here")
VERSIONS: list[Version] = [2, 3]
JOINTS = ("base_yaw", "hub_pitch")


def write_plant(folder: Path, version: Version, name: str, *sets: str) -> tuple[Path, Trial]:
    trial, source = read_trial(name, list(sets))
    path = folder / f"{trial.name}_{version}.fmu"
    module = plant_module(trial, source=source)
    path.write_bytes(fmu_of_trial(trial, module, version, ("linux64",)))
    return path, trial


class Exchanged:
    """An instance for model exchange, of either version."""

    def __init__(self, path: Path, kind: str = "ModelExchange") -> None:
        self.description = fmpy.read_model_description(str(path))
        self.folder = fmpy.extract(str(path))
        self.unit = fmpy.instantiate_fmu(self.folder, self.description, kind)
        self.two = self.description.fmiVersion == "2.0"
        self.references = {v.name: v.valueReference for v in self.description.modelVariables}
        self.states = [one.variable.derivative for one in self.description.derivatives]
        self.slopes = [one.variable for one in self.description.derivatives]
        self.continuous = kind == "ModelExchange"

    def begin(self, time: float = 0.0) -> None:
        if self.two:
            self.unit.setupExperiment(startTime=time)
            self.unit.enterInitializationMode()
        else:
            self.unit.enterInitializationMode(startTime=time)
        self.unit.exitInitializationMode()
        if self.continuous:
            self.unit.enterContinuousTimeMode()

    def get(self, names: list[str]) -> Vector:
        read = self.unit.getReal if self.two else self.unit.getFloat64
        return np.array(read([self.references[name] for name in names]))

    def set(self, values: dict[str, float]) -> None:
        write = self.unit.setReal if self.two else self.unit.setFloat64
        write([self.references[name] for name in values], list(values.values()))

    def slopes_at(self, time: float, x: Vector, effort: dict[str, float]) -> Vector:
        doubles = fmpy.fmi1.c_double * x.size if self.two else fmpy.fmi3.c_double * x.size
        given, found = doubles(*x), doubles()
        self.unit.setTime(time)
        self.unit.setContinuousStates(given, x.size)
        self.set(effort)
        if self.two:
            self.unit.getDerivatives(found, x.size)
        else:
            self.unit.getContinuousStateDerivatives(found, x.size)
        return np.array(found)

    def after_tick(self, time: float, x: Vector, effort: dict[str, float]) -> Vector:
        """Return the state a tick later by SciPy, with an error of about 1e-12."""
        span = time, time + 0.01

        def slopes(t: float, at: Vector) -> Vector:
            return self.slopes_at(t, at, effort)

        after: Vector = solve_ivp(slopes, span, x, method="DOP853", rtol=1e-12, atol=1e-13).y[:, -1]
        return after


@contextmanager
def exchanged(path: Path, kind: str = "ModelExchange") -> Iterator[Exchanged]:
    made = Exchanged(path, kind)
    yield made
    made.unit.terminate()
    made.unit.freeInstance()
    shutil.rmtree(made.folder)


def integrated(path: Path, vector: FlightVector, tolerance: float) -> tuple[Matrix, Matrix]:
    """Return joints and tips by CVode with the efforts of a flight held, and those of the bench."""
    times, effort = vector.inputs[:, 0], vector.inputs[:, 1:3]
    held = [(times[0], *effort[0])]
    for k in range(1, len(times)):  # an instant with two values is a jump
        held += [(times[k], *effort[k - 1]), (times[k], *effort[k])]
    columns = [("time", float), *((f"effort.{name}", float) for name in JOINTS)]
    kinds = ("joint_position", "joint_velocity")
    outputs = [f"{kind}.{name}" for kind in kinds for name in JOINTS]
    found = fmpy.simulate_fmu(
        str(path),
        fmi_type="ModelExchange",
        solver="CVode",
        stop_time=float(vector.outputs[-1, 0]),
        output_interval=0.01,
        relative_tolerance=tolerance,
        input=np.array(held, dtype=columns),
        output=[*outputs, "tip_deflection.beam_positive"],
    )
    bench = {round(100.0 * row[0]): row[1:6] for row in vector.outputs}
    pairs = [(list(row)[1:], bench.get(round(100.0 * row[0]))) for row in found]
    return (
        np.array([row for row, right in pairs if right is not None]),
        np.array([right for _, right in pairs if right is not None]),
    )


@pytest.fixture(scope="module")
def m1_vector() -> FlightVector:
    trial, source = read_trial("m1", ["duration=30.0"])
    return plant_vector(trial, plant_module(trial), plan_of_trial(trial, predict=False), source)


@pytest.mark.parametrize("version", VERSIONS)
def test_fmpy_finds_no_problem(version: Version, tmp_path: Path) -> None:
    path, _ = write_plant(tmp_path, version, "m1")
    assert importlib.import_module("fmpy.validation").validate_fmu(str(path)) == []
    description = fmpy.read_model_description(str(path))
    assert description.modelExchange is not None
    assert description.coSimulation is not None
    depends = {
        one.variable.name: {known.name for known in one.dependencies} for one in description.outputs
    }
    states = {v.name for v in description.modelVariables if v.name.startswith(("q.", "v."))}
    assert depends["joint_position.base_yaw"] == states
    assert depends["applied_effort.hub_pitch"] == {f"effort.{name}" for name in JOINTS}
    units = {v.name: v.unit for v in description.modelVariables}
    assert units["q.hub_pitch"] == "rad"
    assert units["der(v.mode_2)"] == "m/s^2"


@pytest.mark.parametrize("version", VERSIONS)
def test_m1_by_another_integrator_is_the_bench_to_its_tolerance(
    version: Version, m1_vector: FlightVector, tmp_path: Path
) -> None:
    path, _ = write_plant(tmp_path, version, "m1", "duration=30.0")
    errors = []
    for tolerance in (1e-8, 1e-11):
        found, bench = integrated(path, m1_vector, tolerance)
        assert len(bench) > 1900
        errors.append(float((np.abs(found - bench) / np.abs(bench).max(axis=0)).max()))
    # CVode's local errors add up over 2000 restarts, one at every tick; the bench's are far less
    assert errors[1] < 1e-6
    assert errors[0] > 50.0 * errors[1]


def test_m1_by_an_integrator_of_high_order_is_the_bench(
    m1_vector: FlightVector, tmp_path: Path
) -> None:
    path, _ = write_plant(tmp_path, 3, "m1", "duration=30.0")
    ticks, x, found = 1000, np.zeros(10), list[Vector]()
    with exchanged(path) as plant:
        plant.begin()
        for time, *effort in m1_vector.inputs[:ticks, :3]:
            held = dict(zip((f"effort.{name}" for name in JOINTS), effort, strict=True))
            x = plant.after_tick(time, x, held)
            found.append(x[[0, 1, 5, 6]])
    bench = m1_vector.outputs[:ticks, 1:5]
    assert np.abs(bench).max() > 0.1
    np.testing.assert_allclose(np.array(found), bench, rtol=0.0, atol=1e-10)


@pytest.mark.parametrize(
    ("name", "sets"),
    [
        ("m1", ["testbed.damping_ratio=0.01"]),
        ("acc_benchmark", []),
        ("time_optimal_hub", []),
        ("scole_s_open", []),  # whose platform has a quaternion
    ],
)  # fmt: skip
def test_derivatives_are_those_of_the_model(name: str, sets: list[str], tmp_path: Path) -> None:
    path, trial = write_plant(tmp_path, 3, name, *sets)
    model, rng = trial.testbed.model(), np.random.default_rng(2)
    with exchanged(path) as plant:
        plant.begin()
        size = model.positions + model.coordinates
        assert [v.name for v in plant.states] == [
            f"q.{one.name}" for one in model.state_columns[0]
        ] + [f"v.{one.name}" for one in model.state_columns[1]]
        for time in (0.0, 1.5):
            x, u = rng.normal(size=size), rng.normal(size=model.joints)
            effort = {f"effort.{joint}": v for joint, v in zip(model.joint_names, u, strict=True)}
            right = model.derivative(x, u, time)
            wrong = plant.slopes_at(time, x, effort) - right
            assert np.abs(wrong).max() < 1e-11 * np.abs(right).max()
            same = plant.get([one.name for one in plant.slopes])
            np.testing.assert_array_equal(same, plant.slopes_at(time, x, effort))


@pytest.mark.parametrize("version", VERSIONS)
def test_a_start_of_states_is_that_of_both_kinds(version: Version, tmp_path: Path) -> None:
    path, trial = write_plant(tmp_path, version, "m1")
    start, model = {"q.base_yaw": 0.3, "q.mode_1": 0.2, "v.hub_pitch": 0.1}, trial.testbed.model()
    for kind in ("ModelExchange", "CoSimulation"):
        with exchanged(path, kind) as plant:
            plant.set(start)
            plant.begin()
            assert plant.get(list(start)).tolist() == list(start.values())
            read = ["joint_position.base_yaw", "joint_velocity.hub_pitch"]
            assert plant.get(read).tolist() == [0.3, 0.1]
            tip = plant.get(["tip_deflection.beam_negative"])[0]
            assert tip == pytest.approx(-0.2)
            plant.set({"effort.base_yaw": 1.0})  # which has acted at once in one of them
            acting = plant.get(["applied_effort.base_yaw"]).tolist()
            assert acting == [float(kind == "ModelExchange")]
            plant.set({"effort.base_yaw": 0.0})
            if kind == "CoSimulation":
                plant.unit.doStep(0.0, 0.01)
                x = np.zeros(10)
                x[[0, 2, 6]] = 0.3, 0.2, 0.1
                after = model.advance(x, np.zeros(2), 0.01)
                found = plant.get([v.name for v in plant.states])
                np.testing.assert_allclose(found, after, rtol=0.0, atol=1e-14)
                with pytest.raises(Exception, match="Set"):
                    plant.set(start)


@pytest.mark.parametrize("version", VERSIONS)
def test_the_calls_of_the_other_kind_are_refused(version: Version, tmp_path: Path) -> None:
    path, _ = write_plant(tmp_path, version, "m1")
    with exchanged(path) as plant:
        plant.begin()
        with pytest.raises(Exception, match="DoStep"):
            fmpy.fmi2.FMU2Slave.doStep(plant.unit, 0.0, 0.01) if plant.two else (
                fmpy.fmi3.FMU3Slave.doStep(plant.unit, 0.0, 0.01)
            )
    with exchanged(path, "CoSimulation") as plant:
        plant.begin()
        with pytest.raises(Exception, match="SetTime"):
            (fmpy.fmi2.FMU2Model if plant.two else fmpy.fmi3.FMU3Model).setTime(plant.unit, 1.0)


def test_a_testbed_whose_accelerations_jump_has_ticks_alone(tmp_path: Path) -> None:
    path, _ = write_plant(tmp_path, 3, "antenna_4")
    assert fmpy.read_model_description(str(path)).modelExchange is None
