"""Six nodes that start at once, and signals at any moment of a start.

FLEXSLEW_COLD=1: with a cache of machine code that is empty at the first start.
"""

import os
import signal
import subprocess
import sys
from pathlib import Path
from threading import Timer
from time import sleep

import numpy as np
import pytest

from flexslew_lab.run.domain import locked_domain
from flexslew_lab.run.fork_server import ForkServer
from flexslew_lab.run.processes import node_processes, parameter_file
from flexslew_lab.run.supervisor import Supervisor
from tests.ros.flight import NODES, fork_server, slew

pytestmark = pytest.mark.ros

OTHERS = ", lqr: {}, output_feedback: {}"  # with recorder, planner and plant: six
MODULES = ("flexslew_plant.ros.plant_node", "flexslew_control.ros.controller_node")


@pytest.fixture(scope="module")
def own_server(tmp_path_factory: pytest.TempPathFactory) -> ForkServer:
    if "FLEXSLEW_COLD" not in os.environ:
        return fork_server()
    cache = str(tmp_path_factory.mktemp("cache"))
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("NUMBA_CACHE_DIR", cache)
        return ForkServer(NODES)


@pytest.mark.share(0.2)
@pytest.mark.usefixtures("case")
def test_six_nodes_start_at_once_without_a_fault(own_server: ForkServer, tmp_path: Path) -> None:
    processes = node_processes(slew(duration=0.2, more=OTHERS), tmp_path, True, {})
    assert len(processes) == 6
    parameters = tmp_path / "parameters.yaml"
    parameters.write_text(parameter_file(processes))
    with locked_domain() as domain:
        log = tmp_path / "nodes.log"
        outcome = Supervisor(
            processes, parameters, log, domain, lambda tick, last: None, own_server
        ).run()
    assert outcome == (0, ""), log.read_text()
    assert "started again" not in log.read_text()


@pytest.mark.share(0.2)
@pytest.mark.parametrize("module", MODULES)
def test_a_signal_at_any_moment_of_the_start_ends_the_node(
    case: np.random.Generator, module: str
) -> None:
    strength = (signal.SIGINT, signal.SIGTERM)[case.integers(2)]
    with locked_domain() as domain:
        child = subprocess.Popen(
            [sys.executable, "-m", module], env=os.environ | {"ROS_DOMAIN_ID": str(domain)},
            stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True,
        )  # fmt: skip
        timer = Timer(float(case.uniform(0.0, 3.0)), child.send_signal, (strength,))
        timer.start()
        try:
            _, said = child.communicate(timeout=120.0)
        except subprocess.TimeoutExpired:
            child.send_signal(signal.SIGUSR1)  # it writes its stacks without Python
            sleep(2.0)
            child.kill()
            pytest.fail(f"{strength!r} has not ended it: {child.communicate()[1]}")
    assert child.returncode in (130, -strength), said
