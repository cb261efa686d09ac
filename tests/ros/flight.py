"""A run over ROS 2 in which a test may interfere at a tick."""

import os
import signal
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from flexslew_lab.log.bag_reader import BagReader
from flexslew_lab.metrics.from_bag import metrics_of
from flexslew_lab.trial.domain import own_domain
from flexslew_lab.trial.processes import NodeProcess, node_processes, parameter_file
from flexslew_lab.trial.supervisor import Outcome, Supervisor
from flexslew_lab.trial.trial import parse_trial

SLEW = """
name: short
duration: {duration}
rate_factor: {rate}
answer_timeout: 0.5
plan:
  method: reference_only
  model: {{variant: complete, modes: 1}}
  goal: {{base_yaw: 0.1, hub_pitch: 0.05}}
  duration: 5.0
controllers: {{pd_feedforward: {{kp: [460.0, 460.0], kd: [920.0, 920.0]}}{more}}}
{extra}
"""


def slew(duration: float = 6.0, rate: float = 0.0, more: str = "", extra: str = "") -> Any:
    return parse_trial(SLEW.format(duration=duration, rate=rate, more=more, extra=extra), "test")


class Flight:
    """Flies a trial; at the tick `at` the method `act` is called once with the pids by name."""

    def __init__(
        self,
        trial: Any,
        folder: Path,
        at: int = -1,
        act: Any = None,
        extra: Sequence[NodeProcess] = (),
    ) -> None:
        self._at, self._act = at, act
        self.folder, self.bag = folder, folder / "bag"
        folder.mkdir(parents=True, exist_ok=True)
        processes = [*extra, *node_processes(trial, folder, True, {"trial_file": "test"})]
        parameters = folder / "parameters.yaml"
        parameters.write_text(parameter_file(processes))
        with own_domain() as domain:
            os.environ["ROS_DOMAIN_ID"] = str(domain)
            try:
                self._supervisor = Supervisor(
                    processes, parameters, folder / "nodes.log", domain, self._progress
                )
                self.outcome: Outcome = self._supervisor.run()
            finally:
                del os.environ["ROS_DOMAIN_ID"]

    def _progress(self, tick: int, last: int) -> None:
        if self._act is not None and tick >= self._at:
            act, self._act = self._act, None
            act(self._supervisor.pids)

    @property
    def log(self) -> str:
        return (self.folder / "nodes.log").read_text()

    @property
    def metrics(self) -> dict[str, Any]:
        return metrics_of(self.bag)

    @property
    def events(self) -> list[str]:
        return [event.kind for event in BagReader(self.bag).overview.events]


def kill(name: str, strength: int = signal.SIGKILL) -> Any:
    def act(pids: dict[str, int]) -> None:
        os.kill(pids[name], strength)

    return act
