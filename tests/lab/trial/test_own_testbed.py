"""The documented testbed of one's own flies like those that come with the bench."""

import re
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from tests.present import present
from tests.representatives import representatives

from flexslew_control.controllers import CONTROLLERS
from flexslew_control.planners import PLANNERS
from flexslew_lab.cli.main import main
from flexslew_lab.replay.resim import resim
from flexslew_lab.run.run_trial import run_trial
from flexslew_lab.trial.trial import parse_trial, plan_of_trial
from flexslew_plant.errors import BadInput
from flexslew_plant.own_code import ANY_CODE, Trust

ROOT = Path(__file__).parents[3]
TEXT = (ROOT / "docs" / "own_testbed.md").read_text()
EXAMPLE = present(re.search(r"```yaml\n(.*?)```", TEXT, re.DOTALL))[1]
KIND = "docs/examples/three_joints.py:ThreeJoints"
GAINS = {"kp": [40.0], "kd": [60.0]}
LAWS = {
    "pd_feedforward": GAINS,
    "collocated_pid": {**GAINS, "ki": [1.0]},
    "linear": {"system": {"d": [[0.0] * 6] * 3}, "allow_unstable": True},
    "lqr": {"weights": {"deflection": 1.0, "time": 3.0}},
    "model_predictive": {"weights": {"deflection": 1.0, "time": 3.0}},
    "policy": {"base": GAINS},
    "output_feedback": {"effort_noise": 1e-5, "modal_noise": 1e-7},
    "proportional_integral": {"weights": {"deflection": 1.0, "time": 3.0}},
}
# for platforms whose antennas turn; tests/control/controllers/retargeting
RETARGETING = {
    "disturbance_minimisation",
    "disturbance_accommodating",
    "planned_gains",
    "modal_space",
}

# with equations that are compiled already
OSCILLATOR = """
from flexslew_plant.settings import section
from flexslew_plant.testbeds.oscillators.floating_oscillator import FloatingOscillatorTestbed

@section
class Own(FloatingOscillatorTestbed):
    kind: str = "{kind}"
"""


@pytest.fixture(autouse=True)
def in_the_checkout(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(ROOT)


def trial(**changes: Any) -> Any:
    lines = [line for line in EXAMPLE.splitlines() if line.split(":")[0] not in changes]
    lines = [line for line in lines if not (line.startswith("  ") and "controllers" in changes)]
    lines += [f"{key}: {value}" for key, value in changes.items()]
    return parse_trial("\n".join(lines), "own.yaml", ANY_CODE)


def flown(requested: Any, folder: Any, report: bool = False) -> Any:
    result = run_trial(requested, "own.yaml", folder, in_process=True, report=report)
    assert result.exit_code == 0, result.message
    return result.metrics


def test_the_laws_of_this_file_are_those_of_the_table() -> None:
    assert set(LAWS) | RETARGETING == set(CONTROLLERS)


@pytest.mark.slow
@pytest.mark.parametrize("law", representatives(LAWS, "pd_feedforward", "output_feedback"))
def test_every_law_flies_it_to_its_goal(law: Any, tmp_path: Path) -> None:
    damped = f"{{kind: {KIND}, modes: 1, damping_ratio: 0.02}}"
    requested = trial(controllers=f"{{{law}: {LAWS[law]}}}", active=law, testbed=damped)
    metrics = flown(requested, tmp_path / "run")
    assert set(metrics["final_error"]) == {"base", "arm", "wrist"}
    assert max(map(abs, metrics["final_error"].values())) < 0.01
    assert metrics["missed_ticks"] == 0


PLANS = {
    "none": "{method: none, goal: {base: 0.2}}",
    "reference_only": "{method: reference_only, duration: 12.0}",
    "optimized_feedforward": "{method: optimized_feedforward, duration: 12.0}",
    "robust_feedforward": "{method: robust_feedforward, duration: 12.0, payload_errors: [-.1, .1]}",
    "minimax_feedforward": (
        "{method: minimax_feedforward, duration: 12.0, pieces: 20, ensemble: {draw: corners}}"
    ),
    "input_shaping": "{method: input_shaping, duration: 10.0}",
    "start_coast_stop": "{method: start_coast_stop, amplitude: 10.0, pulse_frequency: 1.0}",
}
REFUSED = {
    "time_optimal": (
        "{method: time_optimal, goal: {base: 0.5}, amplitude: 15.0}",
        "does not give its energies in symbols",  # the drives push one another
    )
}


def test_the_plans_of_this_file_are_those_of_the_table() -> None:
    assert {*PLANS, *REFUSED} == {name for name, entry in PLANNERS.items() if entry.slews}


@pytest.mark.slow
@pytest.mark.parametrize("method", representatives(PLANS, "input_shaping", "optimized_feedforward"))
def test_every_planner_plans_it_and_the_plan_flies(method: Any, tmp_path: Path) -> None:
    requested = trial(plan=PLANS[method], testbed=f"{{kind: {KIND}, modes: 1}}", duration=60.0)
    plan = present(plan_of_trial(requested))
    assert plan.joint_names == ("base", "arm", "wrist")
    metrics = flown(requested, tmp_path / "run")
    if method not in ("none", "reference_only"):
        assert metrics["residual_tip_deflection"] < 0.02
    assert np.abs(list(metrics["final_error"].values())).max() < 0.02


@pytest.mark.parametrize("method", REFUSED)
def test_what_a_planner_cannot_do_with_it_is_refused_in_one_line(method: Any) -> None:
    section, words = REFUSED[method]
    with pytest.raises(BadInput, match=words) as caught:
        plan_of_trial(trial(plan=section))
    assert "\n" not in str(caught.value)


def test_its_run_is_recorded_reported_and_flown_again_from_the_log(tmp_path: Path) -> None:
    requested = trial(
        testbed=f"{{kind: {KIND}, modes: 1}}",
        controllers=f"{{pd_feedforward: {GAINS}, lqr: {LAWS['lqr']}}}",
        schedule="[{at: 6.0, switch: lqr}, {at: 20.0, until: 21.0, disturbance: {arm: 2.0}}]",
    )
    metrics = flown(requested, tmp_path / "run", report=True)
    again = resim(tmp_path / "run" / "bag", trust=Trust.of([KIND]))
    assert again.identical
    assert again.hash == metrics["trajectory_hash"]
    page = (tmp_path / "run" / "report.html").read_text()
    for word in ("wrist", "boom", "ThreeJoints"):
        assert word in page


def test_the_report_of_a_log_runs_no_code_that_is_not_trusted(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    marker, own = tmp_path / "was_run", tmp_path / "own_bed.py"
    kind = f"{own}:Own"
    code = OSCILLATOR.format(kind=kind)
    own.write_text(code)
    plan = "{method: reference_only, goal: {mass: 0.5}, duration: 2.0}"
    flown(trial(testbed=f'{{kind: "{kind}"}}', plan=plan, duration=3.0), tmp_path / "run")
    own.write_text(f"{code}\nopen({str(marker)!r}, 'w')\n")
    for trust, runs in (([], False), (["--trust", kind], True)):
        page = tmp_path / f"{runs}.html"
        words = ["flexslew", "report", str(tmp_path / "run"), "--out", str(page), *trust]
        monkeypatch.setattr(sys, "argv", words)
        with pytest.raises(SystemExit) as end:
            main()
        assert not end.value.code, capsys.readouterr().err
        assert page.exists()
        assert marker.exists() is runs


@pytest.mark.parametrize(
    ("line", "words"),
    [
        ("p[0] = p[0] * 1.0", "it writes into an argument that it may only read"),
        ("x[0] = 0.0", "it writes into an argument that it may only read"),
        ("bias[0] = nowhere", "NameError: name 'nowhere' is not defined"),
        ("bias[0] = p.nothing", "Unknown attribute 'nothing' of type readonly array"),
        ("bias[0] = 'much'", "setitem(array(float64, 1d, C), Literal[int](0)"),
        ("with open('notes') as f: f.read()", "'with (context manager) as (variable):'"),
    ],
)
def test_equations_that_cannot_be_compiled_are_named_in_one_line(
    line: str,
    words: str,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    written = (ROOT / "docs/examples/three_joints.py").read_text()
    before = "    n = (p.size - 3) // 4\n"
    file = tmp_path / "three_joints.py"
    file.write_text(
        written.replace(before, f"{before}    {line}\n", 1).replace(KIND, f"{file}:ThreeJoints")
    )
    path = tmp_path / "own.yaml"
    path.write_text(EXAMPLE.replace(KIND, f"{file}:ThreeJoints"))
    out = str(tmp_path / "run")
    monkeypatch.setattr(sys, "argv", ["flexslew", "trial", str(path), "--in-process", "--out", out])
    with pytest.raises(SystemExit) as left:
        main()
    assert left.value.code == 2
    said = capsys.readouterr().err.strip().splitlines()[-1]
    assert said.startswith(f"error: {file}: terms cannot be compiled by Numba, ")
    assert words in said
