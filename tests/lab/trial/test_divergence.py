"""A trial that diverges: exit 3, one line, a whole log up to there, and resim repeats it."""

from pathlib import Path
from typing import Any

import pytest
from tests.representatives import representatives

from flexslew_control.controllers import CONTROLLERS
from flexslew_lab.log.bag_reader import BagReader
from flexslew_lab.log.checks.check import check_log
from flexslew_lab.replay.resim import resim
from flexslew_lab.run.run_trial import run_trial
from flexslew_lab.trial.trial import parse_trial

TRIAL = """
name: lost
duration: 2.0
period: 0.01
active: {law}
controllers: {{{law}: {{}}}}
schedule: [{{at: 1.0, disturbance: {{base_yaw: 1.0e+250}}}}]
"""


# silent without a plan that has gains
NEVER_FLIES = {"disturbance_minimisation", "planned_gains"}
FLYING = [law for law in CONTROLLERS if law not in NEVER_FLIES]


@pytest.mark.parametrize("law", representatives(FLYING, "pd_feedforward", "lqr"))
def test_a_trial_that_diverges_has_its_log_and_metrics(tmp_path: Path, law: Any) -> None:
    trial = parse_trial(TRIAL.format(law=law), "test")
    result = run_trial(trial, "test", tmp_path / "run", in_process=True, report=False)
    assert result.exit_code == 3
    last = result.metrics["ticks"]
    assert result.message.startswith(f"the state is not finite after tick {last} ")
    assert "\n" not in result.message
    assert result.metrics["log_complete"]
    assert result.metrics["faults"] == 1
    bag = tmp_path / "run" / "bag"
    assert [finding for finding in check_log(bag) if not finding.ok] == []
    (event,) = (e for e in BagReader(bag).overview.events if e.kind == "not_finite")
    assert (event.tick, event.level, event.message) == (last, "fault", result.message)
    again = resim(bag)
    assert again.identical
    assert again.ticks == last + 1
