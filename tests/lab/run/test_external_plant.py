"""A flight whose plant is a program: its log, the flight again, its faults, and the examples."""

import json
import shlex
import subprocess
import sys
from pathlib import Path
from shutil import which

import numpy as np
import pytest
from scipy.linalg import expm

from flexslew_lab.cli.main import main
from flexslew_lab.log.bag_reader import BagReader
from flexslew_lab.replay.resim import resim
from flexslew_lab.run.run_trial import run_trial
from flexslew_lab.studies.batch.groups.batch_trial import way_of_testbed
from flexslew_lab.studies.ways import Way
from flexslew_lab.trial.trial import Trial, checked_trial, parse_trial
from flexslew_plant.errors import BadInput
from flexslew_plant.events import PlantLost
from flexslew_plant.external.plant_link import Hello, PlantLink
from flexslew_plant.external.plant_process import PlantProcess
from flexslew_plant.external.plant_rules import PlantRule, PlantRules
from flexslew_plant.own_code import ANY_CODE, Trust, Untrusted
from flexslew_plant.testbeds.black_box.plant_address import PlantAddress

ROOT = Path(__file__).parents[3]
EXAMPLES = ROOT / "docs" / "examples"
PLANT = [sys.executable, str(EXAMPLES / "external_plant.py")]
FAULTY = [sys.executable, str(ROOT / "tests" / "plant" / "external" / "faulty_plant.py")]
TRIAL = """
name: external
duration: 2.0
testbed: {{kind: external, command: {command}}}
plan: {{method: reference_only, goal: {{hub: 0.01}}, duration: 1.0, model: {model}}}
controllers: {{pd_feedforward: {{kp: 40.0, kd: 80.0}}}}
sensors: {{joint_position: {{noise: 1.0e-5}}}}
allow_faults: true
schedule:
  - at: 0.5
    until: 0.8
    fault: {{kind: sensor_bias, channel: joint_position, of: hub, bias: 0.001}}
"""
MODEL = "{kind: identified, modes: 0}"


def checked(command: list[str]) -> list[PlantRule]:
    """Return what became of each rule."""
    return PlantRules(PlantAddress(tuple(command), timeout=30.0).connect).check()


def wrong_words(command: list[str]) -> list[str]:
    """Return what is wrong with each rule; empty: it is kept."""
    return [result.wrong for result in checked(command)]


def trial_of(command: list[str], model: str = MODEL) -> Trial:
    text = TRIAL.format(command=command, model=model)
    return checked_trial(parse_trial(text, "test", ANY_CODE), "test")


def test_resim_flies_the_program_again_to_the_bit_once_it_is_trusted(tmp_path: Path) -> None:
    run_trial(trial_of(PLANT), "test", tmp_path / "run", in_process=True, report=False)
    bag = tmp_path / "run" / "bag"
    with pytest.raises(Untrusted, match=r"refused to run .*external_plant.py.*--trust"):
        resim(bag)
    again = resim(bag, trust=Trust.of([shlex.join(PLANT)]))
    assert (again.identical, again.ticks) == (True, 201)


def test_a_program_that_ends_in_flight_leaves_a_whole_log(tmp_path: Path) -> None:
    dying = trial_of([*FAULTY, "exit"])
    result = run_trial(dying, "test", tmp_path / "run", in_process=True, report=False)
    assert result.exit_code == 3
    assert "its process exited with 4" in result.message
    events = [event.what for event in BagReader(tmp_path / "run" / "bag").overview.events]
    assert any(isinstance(what, PlantLost) for what in events)


def test_a_plan_without_a_design_model_is_refused(tmp_path: Path) -> None:
    trial = trial_of(PLANT, model="{}")
    with pytest.raises(BadInput, match="black box without equations"):
        run_trial(trial, "test", tmp_path / "run", in_process=True, report=False)


def test_studies_fly_it_by_processes() -> None:
    assert way_of_testbed(trial_of(PLANT).testbed.model(), 0.01) is Way.BLACK_BOX


def test_the_python_example_keeps_the_rules() -> None:
    assert wrong_words(PLANT) == [""] * 7


@pytest.mark.parametrize(
    ("way", "rule", "words"),
    [("memory", "reset", "tick 0: another answer"), ("nan", "ticks", "number 0 is nan")],
)
def test_a_broken_rule_is_named(way: str, rule: str, words: str) -> None:
    (broken,) = [result for result in checked([*FAULTY, way]) if not result.ok]
    assert broken.rule.startswith(rule)
    assert words in broken.wrong


def test_conform_examines_a_plant_by_its_command(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    command = ["conform", "--plant", "--json", "--", *FAULTY, "memory"]
    monkeypatch.setattr(sys, "argv", ["flexslew", *command])
    with pytest.raises(SystemExit) as end:
        main()
    wrong = [one["rule"] for one in json.loads(capsys.readouterr().out) if one["wrong"]]
    assert end.value.code == 1
    assert [rule.partition(":")[0] for rule in wrong] == ["reset"]


def test_the_mujoco_example_keeps_the_rules() -> None:
    pytest.importorskip("mujoco")
    command = [sys.executable, str(EXAMPLES / "external_plant_mujoco.py")]
    assert wrong_words(command) == [""] * 7


def test_the_basilisk_example_keeps_the_rules_and_solves_its_equations() -> None:
    """Two hinged panels and a hub, in the closed form of their linear equations."""
    pytest.importorskip("Basilisk")
    command = [sys.executable, str(EXAMPLES / "external_plant_basilisk.py")]
    assert wrong_words(command) == [""] * 7
    link = PlantLink(PlantProcess(command, 30.0), Hello(0.01, {}, {}))
    state = link.reset()
    for _ in range(300):
        state = link.advance(np.array([0.02]))
    link.close()
    whole, coupling, panel = 100.0 + 2.0 * (10.0 / 3.0 + 22.5), 15.0 + 10.0 / 3.0, 10.0 / 3.0 + 10.0
    mass = np.array([[whole, 2.0 * coupling], [2.0 * coupling, 2.0 * panel]])
    a = np.zeros((5, 5))  # of [q, v, 1]
    a[:2, 2:4] = np.eye(2)
    a[2:4, :2] = -np.linalg.solve(mass, np.diag([0.0, 120.0]))
    a[2:4, 2:4] = -np.linalg.solve(mass, np.diag([0.0, 1.2]))
    a[2:4, 4] = np.linalg.solve(mass, [0.02, 0.0])
    yaw, angle, rate, _ = expm(3.0 * a)[:4, 4]
    assert state[:4] == pytest.approx([yaw, 2.0 * angle, 2.0 * angle, rate], rel=1e-7, abs=0.0)


@pytest.mark.skipif(which("cc") is None, reason="no C compiler cc")
def test_the_c_example_keeps_the_rules_and_solves_its_equations(tmp_path: Path) -> None:
    program = str(tmp_path / "plant")
    flags = ["-std=c99", "-Wall", "-Wextra", "-pedantic", "-Werror", "-O2"]
    source = str(EXAMPLES / "external_plant.c")
    subprocess.run(["cc", *flags, source, "-o", program], check=True)
    assert wrong_words([program]) == [""] * 7
    link = PlantLink(PlantProcess([program], 10.0), Hello(0.02, {}, {}))
    effort, state = np.array([3.0, -1.0]), link.reset()
    for _ in range(100):
        state = link.advance(effort)
    link.close()
    mass = np.array([[200.0, 0.0, 8.0], [0.0, 80.0, 3.0], [8.0, 3.0, 1.0]])
    stiffness, damping = np.diag([0.0, 0.0, 9.0]), np.diag([0.0, 0.0, 0.06])
    a = np.zeros((7, 7))  # of [q, v, 1]
    a[:3, 3:6] = np.eye(3)
    a[3:6, :3] = -np.linalg.solve(mass, stiffness)
    a[3:6, 3:6] = -np.linalg.solve(mass, damping)
    a[3:6, 6] = np.linalg.solve(mass, [*effort, 0.0])
    exact = expm(2.0 * a)[:6, 6]
    scale = np.array([1.0, 1.0, 0.3, 1.0, 1.0, 0.3])  # the tip reads 0.3 p
    assert state == pytest.approx(scale * exact, rel=1e-8)
