"""A wrong name, number, unit or shape is refused in one line wherever a person gives one."""

from collections.abc import Callable, Iterator
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.io import savemat
from tests.plants import plant
from tests.wrong_inputs import Wrong, faults_of

from flexslew_control.controllers import CONTROLLERS, build_controller
from flexslew_control.controllers.host import ControllerHost
from flexslew_control.plan_service.planning import plan_request, read_request
from flexslew_control.planners import PLANNERS
from flexslew_control.planners.excitation.excitation import Excitation
from flexslew_lab.console.forms import FormKey, keys_of, value_of
from flexslew_lab.console.panels import tune as tune_panel
from flexslew_lab.studies.cases import sample_table
from flexslew_lab.studies.run import checked
from flexslew_lab.studies.study import example_names, load_study, study_path
from flexslew_lab.trial.sources import read_trial
from flexslew_plant.errors import BadInput
from flexslew_plant.faults import FAULTS
from flexslew_plant.own_code import ANY_CODE
from flexslew_plant.refusal import Refusal
from flexslew_plant.settings import plain, validated
from flexslew_plant.testbeds import default_testbed, with_changes, with_model_file
from flexslew_plant.testbeds.spacecraft.shapes.modal_file import modal_shape
from flexslew_plant.yaml_data import load_yaml, yaml_text

Read = Callable[[Any], object]
STUDY: dict[str, Any] = {
    "study": "wrong",
    "trial": "m1",
    "seed": 1,
    "sampling": {"method": "lhs", "n": 16, "replicates": 4},
    "vary": {
        "testbed.parameters.bending_stiffness": {"relative": {"uniform": [-0.2, 0.2]}},
        "payload": {"keys": ["testbed.parameters.hub_inertia_1"], "offset": {"normal": [0.0, 1.0]}},
    },
    "compare": {"active": ["pd_feedforward", "lqr"], "replan": [False, True]},
    "criteria": {"residual_tip_deflection": {"below": 1.0, "probability": 0.9, "confidence": 0.9}},
    "stop": {"metric": "peak_effort.base_yaw", "quantile": 0.9, "half_width": 1.0},
    "keep": {"bags": "worst 5"},
    "limit": 60.0,
    "batch": True,
}
LAW: dict[str, Any] = {
    "A": [[-1.0, 0.0], [0.0, -2.0]],
    "B": [[1.0, 0.0, 0.0, 0.0], [0.0, 1.0, 0.0, 0.0]],
    "C": [[1.0, 0.0], [0.0, 1.0]],
    "D": [[460.0, 0.0, 920.0, 0.0], [0.0, 460.0, 0.0, 920.0]],
    "Ts": 0.0,
    "inputs": [
        "error.base_yaw", "error.hub_pitch", "error_rate.base_yaw", "error_rate.hub_pitch",
    ],
    "outputs": ["effort.base_yaw", "effort.hub_pitch"],
}  # fmt: skip
MODEL = {"model": {"kind": "csa", "modes": 1, "parameters": {"length": 31.0}}, "source": "a.csv"}
RIGID = {
    "mass": 10.0,
    "first_moment": [0.0, 0.0, 0.0],
    "inertia": [[10.0, 0.0, 0.0], [0.0, 10.0, 0.0], [0.0, 0.0, 10.0]],
}
FACTORS = [[1.0, 0.2], [0.0, 0.0], [0.0, 0.0]]
MODAL: dict[str, Any] = {
    "units": "si",
    "frequencies_hz": [0.1, 0.2],
    "damping_ratios": [0.01, 0.02],
    "modal_mass": [1.0, 1.0],
    "translation": FACTORS,
    "rotation": FACTORS,
    "rigid": RIGID,
}
POINTS: dict[str, Any] = {
    "frequencies_hz": [0.1],
    "points": [[1.0, 0.0, 0.0], [2.0, 0.0, 0.0]],
    "masses": [1.0, 1.0],
    "shapes": [[[0.0, 0.0, 1.0], [0.0, 0.0, 2.0]]],
    "modal_mass": [5.0],
    "tip": 1,
}
GOAL = {"base_yaw": 0.5, "hub_pitch": 0.1}
REQUESTS: dict[str, dict[str, Any]] = {
    "optimized_feedforward": {"goal": GOAL, "duration": 25.0, "start": 1.0, "functions": 9,
                              "initial": GOAL, "model": {"modes": 1}},
    "time_optimal": {"goal": {"base_yaw": 0.5}, "start": 1.0, "reserve": 0.2},
    "input_shaping": {"goal": GOAL, "start": 1.0},
}  # fmt: skip


def read_study(values: Any, folder: Path) -> None:
    (folder / "study.yaml").write_text(yaml_text(values))
    study = load_study(folder / "study.yaml", ANY_CODE)
    checked(study, sample_table(study))


def read_law(values: Any, folder: Path, ending: str = ".yaml") -> None:
    path = folder / f"law{ending}"
    if ending == ".yaml":
        path.write_text(yaml_text(values))
    elif ending == ".npz":
        arrays: dict[str, Any] = {key: np.array(value) for key, value in values.items()}
        np.savez(path, **arrays)
    else:
        cells = {key: np.array(values[key], dtype=object) for key in ("inputs", "outputs")}
        savemat(path, values | cells)
    build_controller("it", "linear", {"file": str(path)}, plant(), "here")


def read_model(values: Any, folder: Path) -> None:
    (folder / "identified.yaml").write_text(yaml_text(values))
    given = with_model_file({"file": str(folder / "identified.yaml")}, "here", ANY_CODE)
    with_changes(default_testbed(), given, "here", ANY_CODE)


def read_modal(values: Any, folder: Path) -> None:
    (folder / "modal.yaml").write_text(yaml_text(values))
    modal_shape(folder / "modal.yaml")


def plan(values: Any) -> None:
    request = plan_request(yaml_text(values), "", 0.01, (150.0, 150.0))
    if isinstance(request, Refusal):
        raise BadInput(request)
    read_request(request)


def tune(law: str) -> Read:
    host = ControllerHost("it", {})
    host.notify(lambda values: build_controller("it", law, values, plant(), "here"), 2)
    assert host.controller is not None

    def read(values: Any) -> None:
        before = host.values
        done = host.tune(values)
        if done.refused is not None:
            assert host.values is before
            raise BadInput(done.refused)

    return read


FILES: dict[str, tuple[dict[str, Any], Callable[[Any, Path], None]]] = {
    "study": (STUDY, read_study),
    "law": (LAW, read_law),
    "model": (MODEL, read_model),
    "modal data": (MODAL, read_modal),
    "modal points": (POINTS, read_modal),
}


def unread(wrong: Wrong) -> bool:
    """Return whether an input is no fault: Ts in rows, as MATLAB writes it; what names a run.

    Names of what varies, and of the values that a study compares, are the user's own.
    """
    rows = wrong.path == ("Ts",) and wrong.values.get("Ts") == [[0.0]]
    match wrong.path:
        case ("vary", str()) | ("ensemble", "vary", str()) | ("compare", str(), str()):
            own = wrong.kind == "misspelt"
        case ("source", *_):
            own = wrong.kind != "misspelt"
        case _:
            own = False
    return rows or own


def faults_of_file(name: str, folder: Path, every: bool) -> dict[str, str]:
    values, read = FILES[name]
    return faults_of(values, lambda given: read(given, folder), every, "", unread)


@pytest.mark.parametrize("name", FILES)
def test_a_file_with_one_fault_is_refused(name: str, tmp_path: Path) -> None:
    assert faults_of_file(name, tmp_path, every=False) == {}


@pytest.mark.matrix
@pytest.mark.parametrize("name", FILES)
def test_a_file_with_any_fault_is_refused(name: str, tmp_path: Path) -> None:
    assert faults_of_file(name, tmp_path, every=True) == {}


@pytest.mark.matrix
@pytest.mark.parametrize("name", [name for name in example_names() if "identify" not in name])
def test_a_shipped_study_with_any_fault_is_refused(name: str, tmp_path: Path) -> None:
    values = load_yaml(study_path(name).read_text(), name)
    faults = faults_of(values, lambda given: read_study(given, tmp_path), True, "", unread)
    assert faults == {}


@pytest.mark.first(2)
@pytest.mark.parametrize("ending", [".npz", ".mat"])
@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"TS": 0.01}, "TS: unknown key; did you mean Ts"),
        ({"Dd": [[1.0]]}, "Dd: unknown key; did you mean D"),
        ({"dt": 0.01}, "dt: call the period Ts"),
        ({"Ts": [0.01, 0.02]}, "Ts: give one number"),
        ({"D": np.nan}, "D: give finite numbers"),
    ],
)
def test_a_binary_law_file_with_a_fault_is_refused(
    ending: str, changes: dict[str, Any], words: str, tmp_path: Path
) -> None:
    read_law(LAW, tmp_path, ending)
    with pytest.raises(BadInput, match=words):
        read_law(LAW | changes, tmp_path, ending)


@pytest.mark.parametrize("law", CONTROLLERS)
def test_settings_with_one_fault_tune_nothing(law: str) -> None:
    values = plain(CONTROLLERS[law].settings())
    assert faults_of(values, tune(law), every=False) == {}


@pytest.mark.parametrize("method", REQUESTS)
def test_a_request_of_a_plan_with_any_fault_is_refused(method: str) -> None:
    assert faults_of({"method": method, **REQUESTS[method]}, plan, every=True) == {}


@pytest.mark.matrix
@pytest.mark.parametrize("method", PLANNERS)
def test_a_request_of_any_planner_with_any_fault_is_refused(method: str) -> None:
    needed: dict[str, Any] = {"goal": {"base_yaw": 1.0}} if method == "time_optimal" else {}
    values = plain(PLANNERS[method].settings(**needed))
    assert faults_of({**values, "method": method}, plan, True, "", unread) == {}


def wrong_texts(key: FormKey) -> Iterator[str]:
    """Yield what a field of numbers must not accept; nothing for another field."""
    value = load_yaml(key.text, "field") if key.text and not key.options else None
    first = value[0] if isinstance(value, list) and value else value
    if isinstance(first, int | float) and not isinstance(first, bool):
        yield from (f"{first} kg", f"{first} furlong", ".nan", "[[1.0]]", "{no_such_name: 1.0}")


def require_refused(keys: list[FormKey], check: Callable[[dict[str, Any]], object]) -> None:
    for key in keys:
        for text in wrong_texts(key):
            with pytest.raises(BadInput) as refused:
                check({key.name: value_of(key, text)})
            assert key.name.rpartition(".")[2] in str(refused.value), text
            assert "\n" not in str(refused.value), text


@pytest.mark.parametrize("law", CONTROLLERS)
def test_a_field_of_a_law_with_a_wrong_unit_or_number_is_refused(law: str) -> None:
    """What a field of a form does not refuse itself, the section that it fills does."""
    text = yaml_text({**plain(CONTROLLERS[law].settings()), "handover_time": 1.0})
    require_refused(tune_panel._keys("it", text, law), partial(tune_panel._check, law, text))


@pytest.mark.parametrize("fault", FAULTS)
def test_a_field_of_a_fault_with_a_wrong_unit_or_number_is_refused(fault: str) -> None:
    kind = FAULTS[fault].settings
    require_refused(keys_of(kind, ("kind",)), lambda values: validated(kind, values, "form"))


def test_a_field_of_an_experiment_with_a_wrong_unit_or_number_is_refused() -> None:
    keys = keys_of(Excitation, ("method",))
    require_refused(keys, lambda values: validated(Excitation, values, "form"))


def set_on_the_command_line(key: str) -> Read:
    return lambda value: read_trial("m1", [f"{key}={yaml_text(value, flow=True).strip()}"])


SETS = ("duration", "testbed", "plan", "controllers.pd_feedforward", "sensors", "actuator")


@pytest.mark.first(2)
@pytest.mark.parametrize("key", SETS)
def test_a_section_with_one_fault_on_the_command_line_is_refused(key: str) -> None:
    values = plain(read_trial("m1")[0])
    for part in key.split("."):
        values = values[part]
    assert faults_of(values, set_on_the_command_line(key), every=False) == {}
