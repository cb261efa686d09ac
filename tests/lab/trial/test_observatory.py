"""The observatory: thrusters and wheels one after another, flown again to the same bits."""

from pathlib import Path
from typing import Any

import numpy as np

from flexslew_lab.log.bag_reader import BagReader
from flexslew_lab.replay.check import check
from flexslew_lab.replay.resim import resim
from flexslew_lab.reproduce.scole_flights import example_values
from flexslew_lab.run.run_trial import run_trial
from flexslew_lab.trial.trial import trial_of_values

GOAL = {"axis": [1.0, -2.0, 0.5], "angle": 2e-3}
SHORT: dict[str, Any] = {
    "duration": 60.0,
    "goal_tolerance": 0.1,
    "plan": {"method": "reference_only", "goal": GOAL, "duration": 12.0},
    "schedule": [{"at": 20.0, "switch": "settling"}, {"at": 40.0, "switch": "pointing"}],
}


def test_thrusters_then_wheels_then_fine_pointing(tmp_path: Path) -> None:
    own = {"testbed": {"pointing_from": 45.0, "pointing_window": 5.0}}
    trial = trial_of_values(example_values("observatory", own) | SHORT, "here")
    result = run_trial(trial, "here", tmp_path / "run", in_process=True)
    assert result.exit_code == 0, result.message
    bag = tmp_path / "run/bag"
    truth = BagReader(bag).columns("/truth", {"applied_effort"})["applied_effort"]
    jets, wheels = truth[:, :12], truth[:, 12:]
    first, later = truth[:201], slice(320, None)  # the handover takes 10 s
    assert (jets >= 0.0).all()
    assert first[:, :12].any()
    assert not first[:, 12:].any()
    assert not jets[later].any()
    assert wheels[later].any()
    pulses = jets[jets > 0.0]
    assert pulses.min() > 0.2 * (1.0 - 1e-9)  # 20 ms of a tick of 100 ms, at 1 N
    metrics = result.metrics
    assert metrics["switches"] == 2
    assert metrics["absolute_performance_error"] is not None
    assert np.shape(metrics["jitter"]) == (3, len(metrics["jitter_frequency"]))
    assert resim(bag).identical
    for name in ("slewing", "settling", "pointing"):
        assert check(bag, name).ok
    page = (tmp_path / "run/report.html").read_text()
    for words in ("speed of the wheels", "stored momentum", "attitude error by octave"):
        assert words in page
