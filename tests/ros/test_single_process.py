"""Plant and controller in one process ask and answer by calls; everybody else hears copies."""

from pathlib import Path
from typing import Any

import pytest

from flexslew_control.plans.plan_file import save_plan
from flexslew_lab.log.bag_reader import BagReader
from flexslew_lab.metrics.from_bag import metrics_of
from flexslew_lab.run.domain import locked_domain
from flexslew_lab.run.processes import NodeProcess, node_processes, parameter_file
from flexslew_lab.run.supervisor import Supervisor
from flexslew_lab.trial.trial import plan_of_trial
from tests.present import present

from .flight import fork_server, slew
from .lines import alone, every_tick

pytestmark = pytest.mark.ros

TOGETHER = ("pd_feedforward", "plant")
SWAPS = "schedule: [{at: 1.5, switch: lqr}, {at: 3.0, switch: pd_feedforward}]"


def flown(trial: Any, folder: Path) -> dict[str, Any]:
    """Return the metrics of a run of which plant and PD share a process."""
    save_plan(present(plan_of_trial(trial)), folder / "plan.yaml")
    nodes = node_processes(trial, folder, True, {"trial_file": "test"}, folder / "plan.yaml")
    parameters = folder / "parameters.yaml"
    parameters.write_text(parameter_file(nodes))
    one = NodeProcess("", "flexslew_lab", "single_process", {})
    processes = [*(node for node in nodes if node.name not in TOGETHER), one]
    with locked_domain() as domain:
        log = folder / "nodes.log"
        outcome = Supervisor(
            processes, parameters, log, domain, lambda tick, last: None, fork_server()
        ).run()
    assert outcome == (0, ""), log.read_text()
    return metrics_of(folder / "bag")


def test_plant_and_first_controller_in_one_process_fly_the_same_bits_across_swaps(
    tmp_path: Path,
) -> None:
    trial = slew(more=", lqr: {}", extra=SWAPS)
    metrics = flown(trial, tmp_path)
    assert metrics["trajectory_hash"] == alone(trial, tmp_path)
    assert (metrics["switches"], metrics["missed_ticks"]) == (2, 0)
    every_tick(tmp_path / "bag", 600)
    assert "stray" not in [event.kind for event in BagReader(tmp_path / "bag").overview.events]
