"""Nothing is compiled or loaded after tick 0, whatever flies: what the wire gives is warmed."""

import gc
import os
import subprocess
import sys
from copy import deepcopy
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
from numba.core.registry import CPUDispatcher
from tests.representatives import representatives
from tests.wire_bench import WireBench

from flexslew_control.controllers import CONTROLLERS, build_controller
from flexslew_lab.trial.sources import read_trial
from flexslew_lab.trial.trial import Trial, plant_of
from flexslew_plant.bench.records import SwitchRequest
from flexslew_plant.errors import BadInput
from flexslew_plant.hardware.actuator import ActuatorSettings
from flexslew_plant.settings import validated
from flexslew_plant.testbeds import WITH_EQUATIONS, read_testbed
from flexslew_plant.testbeds.compiled.bound import Bound, bound
from flexslew_plant.testbeds.model import Model

TICKS = 4  # in charge, each law
MODES = {
    "csa": [1, 2, 3, 4],
    "floating_oscillator": [1],
    "varying_oscillator": [0],
    "hub_with_appendages": [1],
    "identified": [1],
    "linear": [1],
}
NEED_A_PLAN = {"planned_gains"}  # which call no machine code
SPACECRAFT = ["own_spacecraft", "scole_full", "observatory"]


def test_every_kind_of_testbed_flies_here() -> None:
    assert {*MODES, "spacecraft"} == {*WITH_EQUATIONS}


def laws_of(trial: Trial, settings: dict[str, dict[str, Any]]) -> dict[str, Any]:
    """Return those of the table, with these settings, that can be designed for a testbed."""
    plant, fitting = plant_of(trial), {}
    for law in CONTROLLERS:
        values = settings.get(law, {})
        try:
            build_controller(law, law, values, plant, law)
        except BadInput:
            continue
        fitting[law] = values
    return fitting


def specialisations() -> dict[CPUDispatcher, int]:
    """Return how many each function of this process has, and so keep all of them alive."""
    # by its type: isinstance asks what a weak proxy stands for, which may be gone
    functions = [one for one in gc.get_objects() if issubclass(type(one), CPUDispatcher)]
    return {function: len(function.overloads) for function in functions}


def flown(trial: Trial) -> list[str]:
    """Fly every controller of a trial in turn; return what was compiled or loaded meanwhile."""
    bench = WireBench(replace(trial, active=next(iter(trial.controllers))))
    names = [name for name, host in bench.hosts.items() if not host.reason]
    assert {*bench.hosts} - {*names} <= NEED_A_PLAN
    before = specialisations()
    for number, name in enumerate(names):
        bench.fly(number * TICKS)
        if number:
            request = SwitchRequest(name, number * TICKS + 1)
            assert bench.session.switch(request, bench.now) is None
    bench.fly((len(names) + 1) * TICKS)
    assert len(bench.of_kind("switched")) == len(names) - 1, bench.events
    after = specialisations()
    return [
        f"{function.py_func.__module__}.{function.py_func.__qualname__}{function.signatures}"
        for function, count in after.items()
        if count != before.get(function, 0)
    ]


@pytest.mark.slow
@pytest.mark.parametrize(
    ("kind", "modes"),
    representatives(
        [(kind, count) for kind, counts in MODES.items() for count in counts],
        *((kind, counts[0]) for kind, counts in MODES.items()),
    ),
)
def test_no_law_compiles_or_loads_in_flight(kind: str, modes: int) -> None:
    values = {"kind": kind}
    testbed: Any = read_testbed(values, "test")
    if testbed.modes != modes:
        testbed = read_testbed(values | {"modes": modes}, "test")
    trial = Trial(testbed=testbed, duration=1.0)
    own: dict[str, dict[str, Any]] = {
        "output_feedback": {"model": {"modes": modes}} if "modes" in vars(testbed) else {},
        "lqr": {"filter": {"tip_sigma": 5e-3}},
    }
    laws = laws_of(trial, own)
    assert len(laws) >= 3, laws
    assert flown(replace(trial, controllers=laws)) == []


@pytest.mark.slow
@pytest.mark.parametrize("name", representatives(SPACECRAFT, "own_spacecraft"))
def test_no_law_of_a_spacecraft_compiles_or_loads_in_flight(name: str) -> None:
    trial, _ = read_trial(name, None)
    trial = replace(trial, schedule=(), fallback=(), duration=1.0)
    assert flown(replace(trial, controllers={**laws_of(trial, {}), **trial.controllers})) == []


@pytest.mark.parametrize("kind", sorted(MODES))
def test_a_copy_calls_the_functions_of_its_original_whatever_else_was_built(kind: str) -> None:
    """A controller is warmed as a copy; so it is the copy's functions that are loaded."""
    sizes = [read_testbed({"kind": kind}, "test").model()]
    if kind == "csa":
        sizes += [read_testbed({"kind": kind, "modes": k}, "test").model() for k in MODES[kind]]
    for model in sizes:
        bound_of(model)
        bound(model.kernels, model.coordinates + 1, model.before_modes + 1)  # with more joints
        assert [n for n, one in bound_of(model)._asdict().items() if deepcopy(one) is not one] == []


def bound_of(model: Model) -> Bound:
    return bound(model.kernels, model.coordinates, model.before_modes)


def test_friction_compiles_nothing_in_flight() -> None:
    trial = Trial(
        controllers={"pd_feedforward": {}},
        actuator=validated(ActuatorSettings, {"coulomb_friction": 0.1}, "test"),
        duration=1.0,
    )
    assert flown(trial) == []


FROM_NOTHING = """
from pathlib import Path
import sys
from tests.flight.test_machine_code import flown, specialisations
from flexslew_lab.trial.trial import Trial
from flexslew_plant.testbeds import read_testbed
testbed = read_testbed({"kind": "floating_oscillator"}, "test")
print(flown(Trial(testbed=testbed, controllers={"lqr": {}}, active="lqr", duration=1.0)))
print(len(list(Path(sys.argv[1]).rglob("*.nbc"))) > 0)
"""


@pytest.mark.slow  # everything is compiled
def test_the_first_flight_of_a_fresh_machine_compiles_before_tick_0(tmp_path: Path) -> None:
    done = subprocess.run(
        [sys.executable, "-c", FROM_NOTHING, str(tmp_path)],
        env=os.environ | {"NUMBA_CACHE_DIR": str(tmp_path)},
        cwd=Path(__file__).parents[2],
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.stdout.splitlines() == ["[]", "True"], done.stderr
