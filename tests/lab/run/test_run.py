from contextvars import copy_context
from pathlib import Path

import numpy as np
import pytest

from flexslew_lab.log.files.read_limits import MIB, read_at_most
from flexslew_lab.run.run_trial import RunFeedback, run_trial
from flexslew_lab.trial.trial import Trial, parse_trial, trial_of_values, trial_text
from flexslew_plant import yaml_data
from flexslew_plant.errors import BadInput
from flexslew_plant.own_code import ANY_CODE

LAW = """
class Tired:
    def __init__(self, settings, period, effort_limit):
        pass

    def update(self, measurement, estimate, reference):
        if measurement.tick == 20:
            raise RuntimeError("enough for today")
        return 0.0 * measurement.joint_position
"""
TRIAL = """
duration: 1.0
controllers: {{mine: {{law: "{law}:Tired"}}, pd_feedforward: {{}}}}
active: mine
fallback: [pd_feedforward]
allow_faults: true
schedule:
  - {{at: 0.1, until: 0.2, fault: {{kind: sensor_bias, channel: joint_position, bias: 0.1}}}}
  - {{at: 0.3, fault: {{kind: command_duplicated}}}}
"""


def test_a_law_that_raises_is_told_with_file_and_line_and_counted(tmp_path: Path) -> None:
    law = tmp_path / "tired.py"
    law.write_text(LAW)
    trial = parse_trial(TRIAL.format(law=law), "t.yaml", ANY_CODE)
    result = run_trial(trial, "t.yaml", tmp_path / "run", in_process=True, report=False)
    assert result.exit_code == 3
    assert "0.24 s: mine is silent: pd_feedforward takes over (" in result.message
    assert f"RuntimeError: enough for today ({law}, line 8)" in result.message
    assert result.metrics["fallbacks"] == 1
    assert result.metrics["faults"] == 3  # two injected, one fallback


@pytest.mark.parametrize(("duration", "warned"), [(1.0, True), (1.5, False)])
def test_a_plan_that_outlives_the_run_is_told(
    tmp_path: Path, duration: float, warned: bool
) -> None:
    text = f"duration: {duration}\nplan: {{method: none, duration: 1.5}}"
    said: list[str] = []
    run_trial(
        parse_trial(text, "t.yaml"),
        "t.yaml",
        tmp_path / "run",
        True,
        False,
        feedback=RunFeedback(notify=said.append),
    )
    warning = [line for line in said if line.startswith("warning: the plan ends at 1.5 s")]
    assert bool(warning) == warned


_MODES = """
frequencies_hz: [0.6]
rigid: {mass: 2.0, first_moment: [3.0, 0.0, 0.0], inertia: [[0, 0, 0], [0, 5.0, 0], [0, 0, 5.0]]}
"""
_FACTORS = "translation: [[0], [0], [1.4]]\nrotation: [[0], [-2.4], [0]]\nmodal_mass: [[1.16]]\n"
_SHAPES = """
points: [[1.0, 0.0, 0.0], [2.0, 0.0, 0.0]]
masses: [1.0, 1.0]
shapes: [[[0.0, 0.0, 0.4], [0.0, 0.0, 1.0]]]
"""
_PANEL = """
duration: 0.02
testbed:
  kind: spacecraft
  platform: {{mass: 100.0, inertia: {{xx: 30.0, yy: 40.0, zz: 50.0}}}}
  appendages: {{panel: {{shape: {{kind: modal_data, file: {file}}}}}}}
  actuators: {{pitch: {{kind: torque, direction: [0, 1, 0], limit: 2.0}}}}
"""


@pytest.mark.parametrize(("form", "blind"), [(_FACTORS, True), (_SHAPES, False)])
def test_modes_that_no_tip_shows_are_told(tmp_path: Path, form: str, blind: bool) -> None:
    file = tmp_path / "panel.yaml"
    file.write_text(_MODES + form)
    said: list[str] = []
    trial = parse_trial(_PANEL.format(file=file), "t.yaml")
    run_trial(
        trial, "t.yaml", tmp_path / "run", True, False, feedback=RunFeedback(notify=said.append)
    )
    assert any("no tip shows any mode, of 1" in line for line in said) == blind


def dense(points: int) -> Trial:
    times = np.linspace(0.0, 1.0, points + 1)[1:].tolist()
    place = {"base_yaw": 1.0 / 9.0, "hub_pitch": 1.0 / 7.0}
    course = [{"at": t, "position": place, "effort": place} for t in times]
    values = {"name": "dense", "duration": 0.02, "controllers": {"pd_feedforward": {}}}
    plan = {"method": "joint_trajectory", "points": course}
    return trial_of_values({**values, "plan": plan}, "dense")


@pytest.mark.slow
def test_a_log_holds_a_trajectory_of_many_points(tmp_path: Path) -> None:
    trial = dense(1800)
    assert len(trial_text(trial)) > 1 << 18
    result = run_trial(trial, "dense", tmp_path, in_process=True, report=False)
    assert result.metrics["ticks"] == 2


def test_what_no_log_can_hold_is_not_flown(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(yaml_data, "MAX_LENGTH", 1000)
    with pytest.raises(BadInput, match=r"plan: has 4,\d{3} characters; a log holds at most 1,000"):
        run_trial(dense(20), "dense", tmp_path / "run", in_process=True, report=False)
    trial = parse_trial("name: " + 1000 * "x", "long")
    with pytest.raises(
        BadInput,
        match=r"trial x+\.\.\.\(\d+ characters\)\.\.\.x+: has \d,\d{3} characters; a log holds",
    ):
        run_trial(trial, "long", tmp_path / "run", in_process=True, report=False)
    assert not (tmp_path / "run").exists()


def test_a_plan_that_is_too_large_for_a_reader_of_its_log_is_not_flown(tmp_path: Path) -> None:
    plan = "plan: {method: reference_only, goal: {base_yaw: 0.1}, duration: 4.0}"
    trial = parse_trial(plan, "t.yaml")

    def fly() -> None:
        read_at_most(MIB)
        run_trial(trial, "t.yaml", tmp_path / "run", in_process=True, report=False)

    with pytest.raises(BadInput, match=r"t\.yaml: plan: takes 1 MiB of the log, which is read"):
        copy_context().run(fly)
    assert not (tmp_path / "run").exists()
