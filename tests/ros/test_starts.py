"""Nodes that crash before the start of their trial, or stand still in DDS."""

import os
import signal
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from threading import Event

import pytest
from std_srvs.srv import Trigger

from flexslew_lab.run.domain import locked_domain
from flexslew_lab.run.processes import NodeProcess, node_processes, parameter_file
from flexslew_lab.run.supervisor import Outcome, Supervisor

from .bystander import beside, held
from .flight import Flight, fork_server, slew

pytestmark = pytest.mark.ros


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
    with locked_domain() as domain, ThreadPoolExecutor() as pool:
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


@pytest.mark.parametrize("held_up", [False, True])
def test_a_run_ends_where_a_node_has_left_before_the_start(
    held_up: bool, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The plant would wait for it for ever. Whom DDS holds up while it leaves counts as gone."""
    monkeypatch.setattr("flexslew_lab.run.supervisor._GRACE", 3.0)
    processes = [
        node._replace(package="tests", executable="leaving") if node.name == "lqr" else node
        for node in node_processes(slew(duration=0.2, more=", lqr: {}"), tmp_path, True, {})
    ]
    processes = [NodeProcess("stuck", "tests", "stuck", {})] * held_up + processes
    parameters, log = tmp_path / "parameters.yaml", tmp_path / "nodes.log"
    parameters.write_text(parameter_file(processes))
    with locked_domain() as domain:
        bench = Supervisor(
            processes, parameters, log, domain, lambda tick, last: None, fork_server()
        )
        assert bench.run() == (3, "lqr ended before the start")


STUCK = """
from pathlib import Path
from threading import Event, Thread, get_native_id

MARK = Path(__file__).with_name("stuck_once")
LAW = "{root}/docs/examples/my_law.py"
exec(Path(LAW).read_text())

def stand_still():
    Path(f"/proc/self/task/{{get_native_id()}}/comm").write_text("dds.ev.0")
    Event().wait()

class Stuck(MyLaw):
    def __init__(self, *given):
        super().__init__(*given)
        if not MARK.exists():
            MARK.touch()
            Thread(target=stand_still, daemon=True).start()
            Event().wait()
"""


def test_a_node_that_stands_still_in_dds_is_started_again(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The law stands still as a node does whose construction waits for DDS for ever."""
    monkeypatch.setattr("flexslew_lab.run.standstill.PATIENCE", 4.0)  # those alive wake in 3 s
    law = tmp_path / "stuck.py"
    law.write_text(STUCK.format(root=Path(__file__).parents[2]))
    flight = Flight(slew(0.5, more=f", stuck: {{law: '{law}:Stuck'}}"), tmp_path / "run")
    assert flight.outcome.exit_code == 0, flight.log
    assert flight.log.count("[stuck] stands still in DDS") == 1
    assert flight.log.count("[stuck] killed: started again") == 1
    assert flight.log.count("stands still") == 1


@pytest.mark.parametrize(
    ("patience", "words"), [(4.0, "stands still in DDS"), (1e9, "does not leave: ended")]
)
def test_a_node_that_stands_still_when_the_plant_has_left_mars_no_run(
    patience: float, words: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("flexslew_lab.run.standstill.PATIENCE", patience)
    monkeypatch.setattr("flexslew_lab.run.supervisor._EXIT_TIMEOUT", 15.0)
    monkeypatch.setattr("flexslew_lab.run.supervisor._GRACE", 1.0)
    standing = NodeProcess("standing", "tests", "standing", {})

    def await_it(pids: dict[str, int], domain: int) -> None:
        """It is heard of by those who fly: else the last tick may pass before it is there."""
        with beside(domain) as bystander:
            assert bystander.ask(Trigger, "pause").success
            ends = bystander.node.get_subscriptions_info_by_topic
            bystander.until(lambda: "standing" in [end.node_name for end in ends("/measurement")])
            assert bystander.ask(Trigger, "start").success

    flight = Flight(slew(5.0, rate=1.0), tmp_path / "run", 10, await_it, extra=[standing])
    assert flight.outcome == (0, ""), flight.log
    assert flight.log.count(f"[standing] {words}") == 1
    assert flight.metrics["log_complete"]
