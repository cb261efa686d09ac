"""What an identification wrote is believed by plans and laws, and its content goes into the log."""

from pathlib import Path
from typing import Any

import pytest
from tests.present import present

from flexslew_control.planners.feedforward.optimized_feedforward import OptimizedFeedforward
from flexslew_lab.trial.sources import read_trial
from flexslew_lab.trial.trial import parse_trial, plan_of_trial, trial_of_values, trial_text
from flexslew_plant.errors import BadInput
from flexslew_plant.settings import plain
from flexslew_plant.testbeds import read_testbed
from flexslew_plant.testbeds.identified import FreeMode, IdentifiedTestbed
from flexslew_plant.yaml_data import yaml_text

# both masses 1 kg, k 1 N/m: free mode sqrt(2), joint feels 2 kg, spring 2/sqrt(2) per unit
FOUND: Any = IdentifiedTestbed(
    joints=("mass",),
    joint_units=("m",),
    inertia=((2.0,),),
    free_modes=(FreeMode(frequency=2.0**0.5, joints=(0.5**0.5,), tips=(-(2.0**0.5),)),),
    appendages=("spring",),
    effort_limit=(1.0,),
)


def written(folder: Path, testbed: Any = FOUND) -> str:
    path = folder / "identified.yaml"
    path.write_text(yaml_text({"source": "a run", "model": plain(testbed)}))
    return str(path)


def trial(file: str, **plan: Any) -> Any:
    return trial_of_values(
        {
            "testbed": {"kind": "floating_oscillator"},
            "plan": {"method": "optimized_feedforward", "duration": 8.0,
                     "feedback": {"kp": [0.5], "kd": [1.0]}, "goal": {"mass": 0.5},
                     "model": {"file": file}, **plan},
            "controllers": {"lqr": {"model": {"file": file}}},
            "active": "lqr",
        },
        "here",
    )  # fmt: skip


@pytest.mark.slow
def test_a_plan_on_the_identified_model_is_the_plan_on_the_equations(tmp_path: Path) -> None:
    by_file = present(plan_of_trial(trial(written(tmp_path))))
    by_equations = present(plan_of_trial(trial(written(tmp_path), model={})))
    assert by_file.effort == pytest.approx(by_equations.effort, abs=1e-6)
    assert "kind identified instead of floating_oscillator" in by_file.summary["believes"]
    assert "\n" not in by_file.summary["believes"]


def test_a_log_holds_the_content_and_flies_again_without_the_file(tmp_path: Path) -> None:
    file = written(tmp_path)
    first = trial(file)
    Path(file).unlink()
    again = parse_trial(trial_text(first), "log")
    assert again.plan == first.plan
    assert isinstance(again.plan, OptimizedFeedforward)
    assert again.plan.model == again.controllers["lqr"]["model"]
    assert read_testbed(again.plan.model, "log") == FOUND


@pytest.mark.parametrize("name", ["m1", "swap_demo"])
def test_the_plan_of_a_shipped_trial_believes_what_its_bench_was_found_to_be(
    name: str, tmp_path: Path
) -> None:
    two: Any = IdentifiedTestbed(
        joints=("base_yaw", "hub_pitch"), joint_units=("rad", "rad"),
        inertia=((6000.0, 0.0), (0.0, 5900.0)),
        free_modes=(FreeMode(frequency=1.3, joints=(0.01, 0.0), tips=(1.0, -1.0)),),
        appendages=("beam_positive", "beam_negative"), effort_limit=(150.0, 150.0),
    )  # fmt: skip
    read, _ = read_trial(name, [f"plan.model.file={written(tmp_path, two)}"])
    assert isinstance(read.plan, OptimizedFeedforward)
    assert read.plan.model is not None
    assert read_testbed(read.plan.model, "the plan") == two


def test_keys_beside_the_file_win(tmp_path: Path) -> None:
    heavier = trial(written(tmp_path), model={"file": written(tmp_path), "damping_ratio": 0.1})
    assert heavier.plan.model["damping_ratio"] == 0.1


def test_what_is_no_model_is_refused_in_one_line(tmp_path: Path) -> None:
    with pytest.raises(BadInput, match=r"lqr.model: file: nowhere.yaml: cannot be read: No such"):
        trial("nowhere.yaml")
    path = tmp_path / "empty.yaml"
    path.write_text("modes: []\n")
    with pytest.raises(BadInput, match="yaml: holds no model; `flexslew identify` writes one"):
        trial(str(path))
    other = written(tmp_path, read_testbed({"kind": "hub_with_appendages"}, "here"))
    with pytest.raises(BadInput, match="joints of the bench, mass; hub_with_appendages has hub"):
        plan_of_trial(trial(other))
