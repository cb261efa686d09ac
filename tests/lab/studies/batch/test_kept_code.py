"""Machine code of members is compiled once on a machine, not by every process that flies them."""

import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from tests.lab.studies.batch.both_ways import CRAFT
from tests.representatives import representatives

from flexslew_lab.studies.study import Study

FLIGHT = """
import sys
from pathlib import Path
from flexslew_lab.studies.cases import case_of
from flexslew_lab.studies.batch.fleet import BatchRunner
from flexslew_lab.studies.run import prepare
from flexslew_lab.studies.study import load_study
from flexslew_plant.machine_code.compile_news import add_compile_listener

ready = prepare(load_study(Path(sys.argv[1])))
compiled = []
add_compile_listener(compiled.append)
flown = BatchRunner(ready.study, ready.plans).fly([case_of(ready.study, ready.samples, 0)])
print(len([result for some, _ in flown for result in some]), compiled)
"""
KP = {"controllers.pd_feedforward.kp": {"uniform": [100.0, 200.0]}}
CONTROL = {"pd_feedforward": {"kp": [150.0], "kd": [300.0]}}
TURN = {"method": "reference_only", "goal": {"roll": 0.01}, "duration": 0.5}

STAGES = {"testbed": CRAFT, "plan": TURN, "controllers": CONTROL}


@pytest.mark.slow
@pytest.mark.parametrize(
    "flown",
    representatives([{}, STAGES], STAGES),
    ids=["steps as a whole", "stage by stage"],
)
def test_the_second_process_compiles_nothing(
    study_of: Callable[..., Study], tmp_path: Path, flown: dict[str, Any]
) -> None:
    study_of(flown=flown, batch=True, vary=KP)
    command = [sys.executable, "-P", "-c", FLIGHT, str(tmp_path / "study.yaml")]
    said = [subprocess.run(command, capture_output=True, text=True, check=True) for _ in range(2)]
    assert said[1].stdout == "1 []\n"
