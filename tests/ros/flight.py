"""Runs over ROS 2 in which a test may interfere at a tick."""

import os
import signal
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from dataclasses import replace
from functools import cache
from pathlib import Path
from threading import Event
from types import MappingProxyType
from typing import Any

from flexslew_control.plans.plan_file import save_plan
from flexslew_lab.log.bag_reader import BagReader
from flexslew_lab.metrics.from_bag import metrics_of
from flexslew_lab.run.domain import locked_domain
from flexslew_lab.run.fork_server import BEFORE_FORK, ForkServer
from flexslew_lab.run.processes import NodeProcess, node_processes, parameter_file
from flexslew_lab.run.supervisor import Outcome, Supervisor
from flexslew_lab.trial.trial import parse_trial, plan_of_trial
from tests.present import present

LONG = 10_000.0  # simulated; such a flight is interrupted when all is seen [s]
SLEW = """
name: short
duration: {duration}
rate_factor: {rate}
answer_timeout: {patience}
plan:
  method: reference_only
  model: {{variant: complete, modes: 1}}
  goal: {{base_yaw: 0.1, hub_pitch: 0.05}}
  duration: 5.0
controllers: {{pd_feedforward: {{kp: [460.0, 460.0], kd: [920.0, 920.0]}}{more}}}
{extra}
"""


def slew(
    duration: float = 6.0,
    rate: float = 0.0,
    more: str = "",
    extra: str = "",
    patience: float = 20.0,
) -> Any:
    """Return a trial in which no answer is missed for the machine's sake.

    Args:
        duration, rate: as in a trial.
        more: controllers, after a comma.
        extra: keys.
        patience: with who is silent; half a second where somebody is killed [wall s].
    """
    words = {"duration": duration, "rate": rate, "more": more, "extra": extra}
    return parse_trial(SLEW.format(**words, patience=patience), "test")


def patient(trial: Any) -> Any:
    """Return any other trial in which no answer is missed for the machine's sake."""
    return replace(trial, answer_timeout=20.0)


NODES = (
    "flexslew_plant.ros.plant_node",
    "flexslew_control.ros.controller_node",
    "flexslew_control.ros.planner_node",
    "flexslew_lab.ros.recorder_node",
    "flexslew_lab.ros.play_node",
)


@cache
def fork_server() -> ForkServer:
    """Return the fork server of all flights of this process."""
    return ForkServer((BEFORE_FORK, *NODES))


class Flight:
    """Flies a trial; from the tick `at` on `act` is called once: pids by name, ROS_DOMAIN_ID.

    With `begin`, which gets the same, the bench waits for it to call the service `start`. Nodes
    other than the controllers get the `names` that are given for theirs; `change` returns what is
    started in place of a node.
    """

    def __init__(
        self,
        trial: Any,
        folder: Path,
        at: int = -1,
        act: Any = None,
        extra: Sequence[NodeProcess] = (),
        names: Mapping[str, str] = MappingProxyType({}),
        change: Callable[[NodeProcess], NodeProcess] = lambda node: node,
        begin: Callable[[dict[str, int], int], None] | None = None,
    ) -> None:
        self._at, self._act = at, act
        self.folder, self.bag = folder, folder / "bag"
        folder.mkdir(parents=True, exist_ok=True)
        plan = None
        if trial.plan is not None:
            plan = folder / "plan.yaml"
            save_plan(present(plan_of_trial(trial)), plan)
        nodes = node_processes(
            trial, folder, True, {"trial_file": "test"}, plan, autostart=begin is None
        )
        processes = [*extra, *(change(_renamed(node, names)) for node in nodes)]
        parameters = folder / "parameters.yaml"
        parameters.write_text(parameter_file(processes))
        with locked_domain() as domain:
            self._domain, log = domain, folder / "nodes.log"
            self._supervisor = Supervisor(
                processes, parameters, log, domain, self._progress, fork_server()
            )
            if begin is not None:
                try:
                    begin(self._supervisor.pids, domain)
                except BaseException:
                    self._supervisor._end()
                    raise
            self.outcome: Outcome = self._supervisor.run()

    def _progress(self, tick: int, last: int) -> None:
        if self._act is not None and tick >= self._at:
            act, self._act = self._act, None
            act(self._supervisor.pids, self._domain)

    @property
    def log(self) -> str:
        return (self.folder / "nodes.log").read_text()

    @property
    def exit_codes(self) -> dict[str, int]:
        """Those of the nodes that the flight started; of a killed one the signal, negative."""
        return dict(self._supervisor._codes)

    @property
    def metrics(self) -> dict[str, Any]:
        return metrics_of(self.bag)

    @property
    def events(self) -> list[str]:
        return [event.kind for event in BagReader(self.bag).overview.events]


def _renamed(node: NodeProcess, names: Mapping[str, str]) -> NodeProcess:
    parameters = dict(node.parameters)
    if "wait_for" in parameters:
        parameters["wait_for"] = [names.get(name, name) for name in parameters["wait_for"]]
    return node._replace(name=names.get(node.name, node.name), parameters=parameters)


def kill(name: str, strength: int = signal.SIGKILL) -> Any:
    def act(pids: dict[str, int], domain: int) -> None:
        os.kill(pids[name], strength)

    return act


def kill_in_flight(name: str, folder: Path) -> Any:
    """Return an act that kills a node of a flight once its log has grown by 200 kB.

    These are the plan and about a thousand ticks.
    """

    def act(pids: dict[str, int], domain: int) -> None:
        (log,) = (folder / "bag").glob("*.mcap")
        before = log.stat().st_size
        while log.stat().st_size < before + 200_000:
            os.kill(pids["plant"], 0)  # ProcessLookupError: the flight is over
            Event().wait(0.01)
        kill(name)(pids, domain)

    return act


def again(name: str, module: str, folder: Path, domain: int, *more: str) -> int:
    """Start a node of a flight again, with more arguments; return its pid."""
    words = ["--ros-args", "-r", f"__node:={name}"]
    words += ["--params-file", str(folder / "parameters.yaml"), *more]
    with (folder / "again.log").open("ab") as said:
        return fork_server().start(module, words, {"ROS_DOMAIN_ID": str(domain)}, said.fileno())


@contextmanager
def side_by_side(**flights: Callable[[], Flight]) -> Iterator[Callable[[str], Flight]]:
    """Fly several at once, each in its own domain; yield what waits for one by name."""
    with ThreadPoolExecutor(max_workers=3) as pool:
        begun = {name: pool.submit(fly) for name, fly in flights.items()}
        yield lambda name: begun[name].result()
