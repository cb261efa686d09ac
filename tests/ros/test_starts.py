"""Nodes that crash before the start of their trial."""

import os
import signal
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from threading import Event

from flexslew_lab.run.domain import own_domain
from flexslew_lab.run.processes import node_processes, parameter_file
from flexslew_lab.run.supervisor import Outcome, Supervisor

from .bystander import held
from .flight import fork_server, slew


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
