"""CONTRIBUTING's exercises: a testbed, fault, law, planner, metric; each a file and a line."""

import json
import os
import re
import subprocess
import sys
from pathlib import Path
from typing import Any
from zlib import crc32

import pytest

from flexslew_lab.studies.ways import Way
from flexslew_plant.events import EVENTS

# a fault with a step, which batches fly as the bench does
DRIFT = """
from typing import Literal

from flexslew_plant.arrays import called
from flexslew_plant.faults.effects import FaultEntry, Subject
from flexslew_plant.faults.steps import FaultAction, Where, entries
from flexslew_plant.settings import section


@called
def drifting_reading(numbers, memory, since, value):
    memory[0] += numbers[0]
    return value + min(memory[0], numbers[1])


@section
class SensorDrift:
    kind: Literal["sensor_drift"] = "sensor_drift"
    joint: str
    rate: float
    most: float

    def subject(self, names):
        return Subject("joint", self.joint, names.joints)

    def action(self, names):
        chosen = entries(names.joints, self.joint)
        numbers = self.rate, self.most
        return FaultAction(Where.READING, *chosen, numbers, 1, "joint_position")


DRIFT = FaultEntry(SensorDrift, {"rate": 1e-3, "most": 0.1}, drifting_reading)
"""
OVERLAY = Path(__file__).with_name("overlay.py")
CONTRIBUTING = Path(__file__).parents[3] / "CONTRIBUTING.md"
EXERCISES = {
    "flexslew_plant.testbeds": (
        "soft_oscillator",
        "SOFT",
        """
from typing import Literal

from flexslew_plant.settings import section
from flexslew_plant.testbeds.entry import TestbedEntry
from flexslew_plant.testbeds.oscillators.floating_oscillator import FloatingOscillatorTestbed


@section
class SoftOscillator(FloatingOscillatorTestbed):
    kind: Literal["soft_oscillator"] = "soft_oscillator"
    damping_ratio: float = 0.1


SOFT = TestbedEntry(SoftOscillator)
""",
    ),
    "flexslew_plant.faults": (
        "offset",
        "OFFSET",
        """
from typing import Literal

from flexslew_plant.faults.effects import Effect, FaultEntry, OnAnyTestbed
from flexslew_plant.settings import section


@section
class ActuatorOffset(OnAnyTestbed):
    kind: Literal["actuator_offset"] = "actuator_offset"
    offset: float

    def begin(self, situation):
        return Effect(effort=lambda effort: effort + self.offset)


OFFSET = FaultEntry(ActuatorOffset, {"offset": 0.1})
""",
    ),
    "flexslew_control.controllers": (
        "damper",
        "DAMPER",
        """
import numpy as np

from flexslew_control.controllers.entry import LawEntry
from flexslew_control.controllers.by_joint.pd_feedforward import PdFeedforward
from flexslew_control.law import MeasuredJoints
from flexslew_plant.settings import Positive, section


@section
class Damper:
    gain: Positive = 1.0


def build(settings, plant):
    ones = np.ones(len(plant.joint_names))
    return MeasuredJoints(), PdFeedforward(settings.gain * ones, 2.0 * settings.gain * ones)


DAMPER = LawEntry("damper", Damper, build)
""",
    ),
    "flexslew_control.planners": (
        "half",
        "HALF",
        """
from dataclasses import replace
from typing import Literal

from flexslew_control.planners.entry import PlannerEntry
from flexslew_control.planners.reference import NoPlan, plan_none
from flexslew_control.planners.slewing import SlewPlanner
from flexslew_plant.settings import NonNegative, section


@section
class Half:
    method: Literal["half"] = "half"
    goal: dict[str, float] | None = None
    start: NonNegative = 0.0


def plan_half(settings, slew, progress):
    middle = replace(slew, goal=0.5 * (slew.start + slew.goal))
    return replace(plan_none(NoPlan(start=settings.start), middle, progress), method="half")


HALF = PlannerEntry(Half, SlewPlanner(plan_half), feedforward=False)
""",
    ),
    "flexslew_lab.metrics": (
        "farthest",
        "FARTHEST",
        """
from flexslew_lab.metrics.metric import Key, MetricEntry


class Farthest:
    KEYS = {"farthest": Key("rad or m", False, "largest |joint position|")}

    def __init__(self, setup):
        self._joints, self._most = len(setup.joint_names), 0.0

    def add(self, block):
        self._most = max(self._most, float(abs(block.position[:, : self._joints]).max()))

    def result(self, ending):
        return {"farthest": self._most}


FARTHEST = MetricEntry(Farthest)
""",
    ),
}
TRIAL = """
name: exercises
duration: 60.0
testbed: {kind: soft_oscillator}
plan: {method: half, goal: {mass: 0.8}}
controllers: {damper: {gain: 0.5}, pd_feedforward: {kp: [0.5], kd: [1.0]}}
active: damper
goal_tolerance: 0.9
allow_faults: true
schedule: [{at: 1.0, until: 2.0, fault: {kind: actuator_offset, offset: 0.1}}]
"""
# with the new law or one that batches know, and with one of the new faults or without
STUDY = """
study: exercises
trial: exercises
vary: {testbed.damping_ratio: {uniform: [0.05, 0.15]}}
sampling: {method: grid, n: 2}
compare:
  active: [damper, pd_feedforward]
  schedule:
    broken: [{at: 1.0, until: 2.0, fault: {kind: actuator_offset, offset: 0.1}}]
    drifting:
    - {at: 1.0, until: 3.0, fault: {kind: sensor_drift, joint: mass, rate: 0.002, most: 0.1}}
    whole: []
"""


def _line(package: str, name: str, entry: str) -> str:
    return f"from {package}.{name} import {entry} as {entry}\n"


def _write(path: Path, text: str) -> None:
    """Write a file whose time goes by its text: the cache of machine code finds it again."""
    path.write_text(text)
    os.utime(path, (0, crc32(text.encode())))


@pytest.fixture(scope="module")
def flown(tmp_path_factory: pytest.TempPathFactory) -> Any:
    folder = tmp_path_factory.mktemp("overlay")
    for package, (name, entry, text) in EXERCISES.items():
        (folder / package).mkdir()
        _write(folder / package / f"{name}.py", text)
        (folder / f"{package}.line").write_text(_line(package, name, entry))
    faults = "flexslew_plant.faults"
    _write(folder / faults / "drift.py", DRIFT)
    with (folder / f"{faults}.line").open("a") as lines:
        lines.write(_line(faults, "drift", "DRIFT"))
    trial = folder / "trial.yaml"
    trial.write_text(TRIAL)
    study = folder / "study.yaml"
    study.write_text(STUDY)
    done = subprocess.run(
        [sys.executable, str(OVERLAY), str(folder), str(trial), str(study)],
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    return json.loads(done.stdout)


@pytest.mark.slow
def test_each_is_one_file_and_one_line_and_flies(flown: Any) -> None:
    metrics = flown["metrics"]
    assert list(metrics["final_error"]) == ["mass"]  # the testbed
    assert metrics["goal_error"] is not None
    assert abs(metrics["final_error"]["mass"]) < 0.05  # the planner's goal, flown by the law
    assert 0.35 < metrics["farthest"] < 0.9  # the metric
    assert metrics["faults"] == 1
    assert set(flown["events"]) <= set(EVENTS)


@pytest.mark.slow
def test_a_batch_flies_what_it_knows_as_the_bench_does_and_leaves_it_the_rest(flown: Any) -> None:
    cases = flown["cases"]
    assert [case["way"] for case in cases] == 2 * [
        *3 * [Way.LAW],
        Way.FAULT,
        Way.BATCH,
        Way.BATCH,
    ]
    assert not any(case["reason"] for case in cases)
    for case in cases:
        assert case["bench"]["farthest"] > 0.35
        if case["way"] == Way.BATCH:
            for key, value in case["bench"].items():
                batch = case["batch"][key]
                assert batch == value or batch == pytest.approx(value, rel=1e-9, abs=1e-9), key
    broken, drifting, known = (case["bench"] for case in cases[3:6])
    for one in (broken, drifting):  # the new faults act
        assert abs(known["farthest"] - one["farthest"]) > 1e-4


def test_the_exercises_are_those_of_the_guide() -> None:
    text = CONTRIBUTING.read_text()
    for package in EXERCISES:
        family = package.split(".")[-1]
        assert re.search(rf"^\| .*\| a line in `{family}/__init__\.py`", text, re.MULTILINE), family
