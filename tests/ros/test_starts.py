"""Six nodes that start at once, and signals at any moment of a start.

A few starts here; FLEXSLEW_STARTS=500 makes the whole campaign, FLEXSLEW_COLD=1 with a cache of
machine code that is empty at the first start.
"""

import os
import signal
import subprocess
import sys
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from threading import Event, Timer

import numpy as np
import pytest

from flexslew_lab.trial.domain import own_domain
from flexslew_lab.trial.fork_server import ForkServer
from flexslew_lab.trial.processes import node_processes, parameter_file
from flexslew_lab.trial.supervisor import Outcome, Supervisor

from .bystander import held
from .flight import NODES, fork_server, slew

STARTS = int(os.environ.get("FLEXSLEW_STARTS", "2"))
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


@pytest.mark.parametrize("number", range(STARTS))
def test_six_nodes_start_at_once_without_a_fault(
    number: int, own_server: ForkServer, tmp_path: Path
) -> None:
    processes = node_processes(slew(duration=0.2, more=OTHERS), tmp_path, True, {})
    assert len(processes) == 6
    parameters = tmp_path / "parameters.yaml"
    parameters.write_text(parameter_file(processes))
    with own_domain() as domain:
        log = tmp_path / "nodes.log"
        outcome = Supervisor(
            processes, parameters, log, domain, lambda tick, last: None, own_server
        ).run()
    assert outcome == (0, ""), log.read_text()
    assert "started again" not in log.read_text()


def test_a_node_that_crashes_before_the_start_is_started_again_once(tmp_path: Path) -> None:
    crashes = [
        ("planner", 1, 0.0), ("lqr", 1, 0.5), ("lqr", 2, 0.0), ("recorder", 1, 0.5),
    ]  # fmt: skip
    with ThreadPoolExecutor() as pool:
        flown = {
            (name, times, after): pool.submit(
                crashing, name, after, times, tmp_path / f"{name}{times}"
            )
            for name, times, after in crashes
        }
    for (name, times, _), flight in flown.items():
        outcome, log = flight.result()
        again = name != "recorder"
        assert log.count(f"[{name}] crashed (SIGSEGV) before the start: started again") == again
        ended = f"{name} ended before the start (exit codes {name}: -11)"
        assert outcome == ((0, "") if again and times == 1 else (3, ended)), log


def crashing(name: str, after: float, times: int, folder: Path) -> tuple[Outcome, str]:
    """Fly with a node that crashes so long after each of its births [wall s].

    Returns:
        Outcome and what the nodes have said.
    """
    folder.mkdir()
    processes = node_processes(slew(duration=0.2, more=", lqr: {}"), folder, True, {})
    parameters, log = folder / "parameters.yaml", folder / "nodes.log"
    parameters.write_text(parameter_file(processes))
    with own_domain() as domain, ThreadPoolExecutor() as pool:
        bench = Supervisor(
            processes, parameters, log, domain, lambda tick, last: None, fork_server()
        )
        with held(bench.pids["plant"]):  # nothing starts meanwhile
            outcome, last = pool.submit(bench.run), 0
            for _ in range(times):
                while (pid := bench.pids.get(name, last)) == last:
                    Event().wait(0.01)
                Event().wait(after)
                os.kill(pid, signal.SIGSEGV)
                last = pid
            Event().wait(0.5)
        return outcome.result(), log.read_text()


@pytest.mark.parametrize("number", range(STARTS))
@pytest.mark.parametrize("module", MODULES)
def test_a_signal_at_any_moment_of_the_start_ends_the_node(number: int, module: str) -> None:
    rng = np.random.default_rng([number, MODULES.index(module)])
    strength = (signal.SIGINT, signal.SIGTERM)[number % 2]
    with own_domain() as domain:
        child = subprocess.Popen(
            [sys.executable, "-m", module], env=os.environ | {"ROS_DOMAIN_ID": str(domain)},
            stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True,
        )  # fmt: skip
        timer = Timer(float(rng.uniform(0.0, 3.0)), child.send_signal, (strength,))
        timer.start()
        _, said = child.communicate(timeout=120.0)
    assert child.returncode in (130, -strength), said
