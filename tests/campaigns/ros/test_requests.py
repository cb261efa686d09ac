"""Requests to a bench that flies: any service, any content. Done or refused in one line."""

import os
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from flexslew_msgs import srv
from std_srvs.srv import Trigger

from flexslew_lab.log.bag_reader import BagReader
from flexslew_lab.log.checks.check import check_log
from flexslew_lab.replay.resim import resim
from flexslew_plant.graph import topics
from flexslew_plant.yaml_data import yaml_text
from tests.campaigns.test_texts import FAULTS, ODD, changed
from tests.ros.bystander import Bystander, beside
from tests.ros.flight import Flight, slew

pytestmark = pytest.mark.ros

REQUESTS = 60  # of a case
SERVICES: dict[str, Any] = {
    topics.OPERATE: srv.Operate, topics.STEP: srv.Step, topics.SET_RATE: srv.SetRate,
    topics.NOTE: srv.Note, topics.SWITCH_CONTROLLER: srv.SwitchController,
    topics.INJECT_FAULT: srv.InjectFault, topics.END_FAULT: srv.EndFault,
    topics.RETARGET: srv.Retarget, topics.LIST_CONTROLLERS: srv.ListControllers,
    "start": Trigger, "pause": Trigger, "brake": Trigger, "release_brake": Trigger,
    "lqr/tune": srv.Tune, "pd_feedforward/tune": srv.Tune,
}  # fmt: skip
WORDS = [
    *(word for word in ODD if isinstance(word, str) and "\x00" not in word),
    "start", "pause", "brake", "release_brake", "adopt", "pd_feedforward", "kp: [300.0, 300.0]",
    "control_weight: 2.0", "handover_time: .nan", "{appendage: left, to: 0.3, duration: 2.0}",
]  # fmt: skip
NUMBERS = [0.0, 1.0, -1.0, 7.5, 1e-300, 1e300, float("nan"), float("inf")]
SMALL = {"uint32": 2**32 - 1, "int32": 2**31 - 1}


def anything(kind: str, case: np.random.Generator) -> Any:
    """Return what a field of this kind can carry."""
    if kind == "string" and case.random() < 0.4:
        return yaml_text(changed(FAULTS[case.integers(len(FAULTS))], case), flow=True)[:3000]
    if kind == "string":
        return WORDS[case.integers(len(WORDS))]
    if kind == "boolean":
        return bool(case.integers(2))
    if kind == "double":
        return NUMBERS[case.integers(len(NUMBERS))]
    return int(case.choice([0, 1, 5, SMALL[kind]]))


def request(name: str, case: np.random.Generator) -> dict[str, Any]:
    fields = SERVICES[name].Request.get_fields_and_field_types()
    found = {field: anything(kind, case) for field, kind in fields.items() if kind in SMALL | KINDS}
    if name == topics.SWITCH_CONTROLLER:
        found["timeout"] = 0.05  # else an answer may come when the switch is due, in 60 years
    return found


KINDS = {"string": 0, "boolean": 0, "double": 0}


class Asking:
    """Asks a bench for anything, then ends it as Ctrl-C does."""

    def __init__(self, case: np.random.Generator) -> None:
        self._case = case
        self.responses: list[tuple[str, dict[str, Any], str]] = []

    def __call__(self, pids: dict[str, int], domain: int) -> None:
        with beside(domain) as bench:
            for _ in range(REQUESTS):
                self._ask(bench, str(self._case.choice([*SERVICES])))
            bench.ask(Trigger, "start")
            assert bench.ask(srv.ListControllers, topics.LIST_CONTROLLERS).controllers
        for pid in pids.values():
            os.kill(pid, 0)  # ProcessLookupError: one is gone
        raise KeyboardInterrupt

    def _ask(self, bench: Bystander, name: str) -> None:
        content = request(name, self._case)
        answer = bench.ask(SERVICES[name], name, **content)
        self.responses.append((name, content, getattr(answer, "message", "")))


@pytest.mark.share(0.2)
def test_a_bench_flies_on_and_flies_again_whatever_it_was_asked(
    tmp_path: Path, case: np.random.Generator
) -> None:
    asking = Asking(case)
    trial = slew(3600.0, 10.0, more=", lqr: {}", extra="allow_faults: true")
    flight = Flight(trial, tmp_path, 20, asking)
    assert flight.outcome.exit_code == 130, flight.log
    assert len(asking.responses) == REQUESTS
    for name, content, message in asking.responses:
        assert message.isprintable(), (name, content, message)
    assert "Traceback" not in flight.log
    assert [finding for finding in check_log(flight.bag) if not finding.ok] == []
    reader = BagReader(flight.bag)
    limit = reader.columns("/testbed")["effort_limit"][0]
    assert (np.abs(reader.columns("/truth")["applied_effort"]) <= limit).all()
    again = resim(flight.bag)
    assert again.identical, again.first_difference
