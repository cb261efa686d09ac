"""The nodes of the compose file fly the trial that it names, to the last bit."""

import os
import shlex
import subprocess
import sys
from pathlib import Path

import pytest
import yaml

from flexslew_lab.metrics.from_bag import metrics_of
from flexslew_lab.run.domain import locked_domain
from flexslew_lab.run.run_trial import run_trial
from flexslew_lab.trial.trial import trial_text

from .flight import slew

FILE = Path(__file__).parents[2] / "docker" / "compose.yaml"
SERVICES = yaml.safe_load(FILE.read_text())["services"]


def test_each_node_has_the_right_to_real_time_and_waits_for_its_parameters() -> None:
    nodes = {**SERVICES}
    assert shlex.split(nodes.pop("parameters")["command"])[-2:] == ["m1", "/runs/compose"]
    assert len(nodes) == 4
    for service in nodes.values():
        assert service["cap_add"] == ["SYS_NICE"]
        assert service["depends_on"]["parameters"]["condition"] == "service_completed_successfully"


@pytest.mark.ros
def test_the_commands_fly_the_bits_of_the_trial(tmp_path: Path) -> None:
    trial = slew(duration=3.0)
    path = tmp_path / "short.yaml"
    path.write_text(trial_text(trial))
    alone = run_trial(trial, "test", tmp_path / "alone", in_process=True, report=False)
    words = {"python": sys.executable, "m1": str(path)}
    with locked_domain() as domain:
        environment = os.environ | {"ROS_DOMAIN_ID": str(domain)}

        def begun(service: str) -> subprocess.Popen[bytes]:
            command = SERVICES[service]["command"].replace("/runs/", f"{tmp_path}/")
            return subprocess.Popen(
                [words.get(word, word) for word in shlex.split(command)], env=environment
            )

        assert begun("parameters").wait() == 0
        nodes = [begun(name) for name in ("recorder", "planner", "pd_feedforward", "plant")]
        assert [node.wait() for node in nodes] == [0, 0, 0, 0]
    flown = metrics_of(tmp_path / "compose" / "bag")
    assert flown["trajectory_hash"] == alone.metrics["trajectory_hash"]
