"""Slews by control moment gyros: to any attitude, and only who steers them flies them."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from tests.representatives import seeds

from flexslew_lab.replay.resim import resim
from flexslew_lab.reproduce.scole_flights import example_values
from flexslew_lab.run.run_trial import run_trial
from flexslew_lab.trial.trial import trial_of_values
from flexslew_plant.errors import BadInput


def flown(folder: Path, **changes: Any) -> Any:
    """Return the run of the shipped trial with some values changed."""
    trial = trial_of_values(example_values("control_moment_gyros", {}) | changes, "here")
    return run_trial(trial, "here", folder, in_process=True)


@pytest.mark.slow
@pytest.mark.parametrize("seed", seeds(2))
def test_slews_about_any_axis_end_at_their_goal(seed: int, tmp_path: Path) -> None:
    """Within a milliradian: what the law has regained since gimbals passed a singularity."""
    turn = Rotation.random(random_state=np.random.default_rng(seed)).as_rotvec()
    goal = {"axis": turn.tolist(), "angle": float(np.linalg.norm(turn))}
    plan = {"method": "reference_only", "goal": goal, "duration": 40.0}
    found = flown(tmp_path / "run", plan=plan, duration=70.0, goal_tolerance=0.1)
    assert found.exit_code == 0, found.message
    assert max(map(abs, found.metrics["final_error"].values())) < 1e-3
    assert found.metrics["peak_gimbal_angle"].keys() == {"one", "two", "three", "four"}
    assert 0.0 <= found.metrics["least_gyro_authority"] < 1.0
    assert resim(tmp_path / "run/bag").identical
    page = (tmp_path / "run/report.html").read_text()
    assert "angle of the gimbals" in page
    assert "speed of the wheels" not in page


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"controllers": {"a": {"law": "lqr"}}, "active": "a"}, "one is a control moment gyro"),
        ({"controllers": {"a": {"law": "pd_feedforward"}}, "active": "a"}, "allocation: {kind:"),
        ({"plan": {"method": "time_optimal", "drives": "all",
                   "goal": {"axis": [1.0, 0.0, 0.0], "angle": 0.5}}}, "take moving"),
    ],
)  # fmt: skip
def test_who_counts_on_fixed_directions_is_refused_with_the_remedy(
    changes: dict[str, Any], words: str, tmp_path: Path
) -> None:
    with pytest.raises(BadInput, match=words):
        flown(tmp_path / "run", **changes)


def test_an_allocation_without_a_resolver_is_refused_with_the_remedy(tmp_path: Path) -> None:
    testbed = {**example_values("control_moment_gyros", {})["testbed"], "sensors": {}}
    with pytest.raises(BadInput, match="give the testbed a sensor of kind resolver"):
        flown(tmp_path / "run", testbed=testbed)
