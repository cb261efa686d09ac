"""A trial's parts in C do what they do on the bench, tick by tick and in a closed loop."""

import ctypes
from pathlib import Path
from typing import Any, cast

import numpy as np
import pytest
from tests.present import present

from flexslew_control.controllers.controller import Controller
from flexslew_control.plan import Plan
from flexslew_lab.export.c_module import CModule, module_of
from flexslew_lab.export.compiled import CompiledController, CompiledModule, compilers
from flexslew_lab.export.flight_vector import FlightVector, controller_vector, plant_vector
from flexslew_lab.export.plant_module import plant_module
from flexslew_lab.run.in_process import Observer, run_bench
from flexslew_lab.trial.sources import read_trial
from flexslew_lab.trial.trial import (
    Trial,
    build_controllers,
    plan_of_trial,
    set_plan,
    set_up,
)
from flexslew_plant.arrays import Matrix
from flexslew_plant.bench.bench import Truth
from flexslew_plant.errors import BadInput

needs_compiler = pytest.mark.skipif(not compilers(), reason="no C compiler is here: gcc or clang")


def written(trial: Trial) -> CModule:
    """Return the active controller of a trial with its plan."""
    controller = build_controllers(trial, "here")[trial.active]
    return module_of(trial, controller, plan_of_trial(trial, predict=False), source="here")


M1 = ("m1", "", ())
OFC = (
    "swap_demo",
    "output_feedback",
    ("duration=16", "schedule=[{at: 5.0, switch: output_feedback}]"),
)
INTEGRAL = (
    "swap_demo",
    "proportional_integral",
    ("duration=16", "schedule=[{at: 5.0, switch: proportional_integral}]"),
)
OBSERVATORY = ("observatory", "pointing", ())


class _States(Observer):
    def __init__(self) -> None:
        self.states: list[Matrix] = []

    def truth(self, truth: Truth) -> None:
        self.states.append(np.concatenate((truth.position, truth.velocity)))


def _given(what: tuple[str, str, tuple[str, ...]]) -> tuple[Trial, str, Plan | None]:
    trial, _ = read_trial(what[0], list(what[2]))
    return trial, what[1] or trial.active, plan_of_trial(trial, predict=False)


def _compiled(
    trial: Trial, name: str, plan: Plan | None, folder: Path, **options: Any
) -> CompiledModule:
    module = module_of(trial, build_controllers(trial, "here")[name], plan, **options)
    return CompiledModule(module, folder, **options)


def _outputs(compiled: CompiledModule, vector: FlightVector) -> Matrix:
    return np.array([compiled.step(row) for row in vector.inputs])


@needs_compiler
@pytest.mark.parametrize(
    ("what", "allowed"),
    [
        (M1, 0.0),
        (OFC, 1e-12),
        (INTEGRAL, 1e-9),
        pytest.param(OBSERVATORY, 1e-9, marks=pytest.mark.slow),
    ],
)
def test_efforts_in_c_are_those_of_the_bench(
    what: tuple[str, str, tuple[str, ...]], allowed: float, tmp_path: Path
) -> None:
    trial, name, plan = _given(what)
    vector = controller_vector(trial, name, plan, "here")
    outputs = _outputs(_compiled(trial, name, plan, tmp_path), vector)
    assert vector.error(outputs) <= allowed
    assert vector.counted.sum() > 1000


@needs_compiler
@pytest.mark.parametrize("what", [M1, OFC, pytest.param(OBSERVATORY, marks=pytest.mark.slow)])
def test_closed_loop_with_a_controller_in_c_is_that_of_the_bench(
    what: tuple[str, str, tuple[str, ...]], tmp_path: Path
) -> None:
    trial, name, plan = _given(what)
    flights = []
    for in_c in (False, True):
        bench, controllers = set_up(trial, "here")
        set_plan(controllers, trial.active, plan)
        if in_c:
            compiled = CompiledController(name, _compiled(trial, name, plan, tmp_path))
            controllers[name] = cast(Controller, compiled)
        seen = _States()
        run_bench(bench, controllers, seen)
        flights.append(np.array(seen.states))
    sizes = np.abs(flights[0]).max(axis=0)
    assert (np.abs(flights[1] - flights[0]) <= 1e-9 * (1.0 + sizes)).all()


@needs_compiler
def test_single_precision_is_within_its_error(tmp_path: Path) -> None:
    trial, name, plan = _given(OFC)
    vector = controller_vector(trial, name, plan, "here")
    compiled = _compiled(trial, name, plan, tmp_path, single=True)
    error = vector.error(_outputs(compiled, vector))
    assert 1e-9 < error < 1e-3


@needs_compiler
@pytest.mark.parametrize(
    ("name", "sets"),
    [
        ("m1", ["duration=30"]),
        ("m1", [
            "duration=10", "actuator.lag=0.05", "actuator.slew_rate=20",
            "sensors.joint_position.quantisation=1e-4", "testbed.effort_limit=[100.0, 90.0]",
        ]),
        ("time_optimal_hub", ["duration=10"]),
        ("acc_benchmark", ["duration=10"]),  # with a disturbance
        pytest.param("scole_s_open", ["duration=10"], marks=pytest.mark.slow),  # a spacecraft
    ],
)  # fmt: skip
def test_a_plant_in_c_measures_what_the_bench_does(
    name: str, sets: list[str], tmp_path: Path
) -> None:
    trial, source = read_trial(name, sets)
    module = plant_module(trial)
    vector = plant_vector(trial, module, plan_of_trial(trial, predict=False), source)
    assert vector.error(_outputs(CompiledModule(module, tmp_path), vector)) < 1e-12


@needs_compiler
def test_the_derivative_in_c_is_that_of_the_model(tmp_path: Path) -> None:
    trial, _ = read_trial("m1", [])
    module, model = plant_module(trial), trial.testbed.model()
    compiled = CompiledModule(module, tmp_path)
    rng = np.random.default_rng(1)
    x, u = rng.normal(size=2 * model.coordinates), rng.normal(size=4)
    dx = (ctypes.c_double * x.size)()
    given = (ctypes.c_double * x.size)(*x), (ctypes.c_double * 5)(0.0, *u), dx
    compiled.function("derivatives")(compiled.memory, *given)
    np.testing.assert_allclose(np.array(dx), model.derivative(x, u[:2] + u[2:]), rtol=1e-12)


def test_what_cannot_be_written_out_is_refused_in_one_line(tmp_path: Path) -> None:
    own = tmp_path / "own.py"
    own.write_text(
        "import numpy as np\n\n\nclass Own:\n    def __init__(self, settings, period, limit):\n"
        "        pass\n\n    def update(self, measurement, estimate, reference):\n"
        "        return np.zeros(2)\n"
    )
    law = f"{own}:Own"
    trial, _ = read_trial(
        "m1", [f"controllers={{mine: {{law: '{law}'}}}}", "active=mine", "plan=null"]
    )
    with pytest.raises(BadInput, match="Python of your own; fly it as a process"):
        written(trial)
    predictive, _ = read_trial("predictive_m1", ["plan=null"])
    with pytest.raises(
        BadInput, match=r"^here: controllers\.model_predictive: .* cannot be written"
    ):
        written(predictive)


def test_signals_are_members_of_the_structs() -> None:
    trial, _ = read_trial("m1", ["plan=null"])
    for module in (written(trial), plant_module(trial)):
        header = module.sources[f"{module.name}.h"]
        for signal in (*module.inputs, *module.outputs):
            size = "" if signal.name == "time" else f"[{signal.size}]"
            assert f"double {signal.name}{size};" in header
    measured = {one.name: one for one in module.outputs}
    assert len(present(measured.get("joint_position")).start) == 2
