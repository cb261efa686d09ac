"""What charts show of a spacecraft is where its joints are, not the coordinates of its state."""

from pathlib import Path

import numpy as np
import pytest

from flexslew_lab.console.quantities import ERROR, ESTIMATE, POSITION, TIPS, VELOCITY, curves_of
from flexslew_lab.console.replay import Replay
from flexslew_lab.console.view import BenchView, Joints
from flexslew_lab.log.bag_reader import BagReader
from flexslew_lab.run.run_trial import run_trial
from flexslew_lab.trial.sources import read_trial
from flexslew_plant.arrays import Matrix


@pytest.fixture(scope="module", params=["three_axes", "antenna_1", "control_moment_gyros", "m1"])
def bag(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return the log of a trial whose sensors do not err."""
    folder = tmp_path_factory.mktemp("flown") / "run"
    trial, source = read_trial(request.param)
    run_trial(trial, source, folder, in_process=True, report=False)
    return folder / "bag"


@pytest.mark.slow
def test_charts_of_positions_and_rates_show_what_the_joints_read(bag: Path) -> None:
    log = Replay(bag)
    log.seek(log.last)
    read = BagReader(bag).columns("/measurement", {"joint_position", "joint_velocity"})
    for quantity, field in ((POSITION, "joint_position"), (VELOCITY, "joint_velocity")):
        curves = [curve for curve in curves_of(log.view, quantity) if not curve.dashed]
        shown: Matrix = np.array([curve.value for curve in curves]).T
        ticks = len(read[field])
        assert shown[:ticks] == pytest.approx(read[field], abs=1e-12), quantity


@pytest.mark.slow
def test_charts_of_errors_and_estimates_show_how_far_the_joints_are_off(bag: Path) -> None:
    log = Replay(bag)
    log.seek(log.last)
    tips = [curve.label for curve in curves_of(log.view, TIPS)]
    assert tips  # of rates and instruments the truth holds nothing
    assert not [label for label in tips if "rate" in label or not label.endswith(" [m]")]
    for quantity, most in ((ERROR, 0.06), (ESTIMATE, 0.002)):  # m1 bends away from its plan
        worst = max(np.nanmax(np.abs(curve.value)) for curve in curves_of(log.view, quantity))
        assert worst < most, quantity  # the coordinates of an attitude are up to 1 away


def test_limits_of_motors_have_the_units_of_their_efforts() -> None:
    view = BenchView()
    view.joints = Joints("two", ("a", "b"), ("rad", "m"), (), (150.0, 20.0), 0.01)
    view.truth.add(np.array([0.0, 0.01]), {"applied_effort": np.ones((2, 2))})
    labels = [curve.label for curve in curves_of(view, "effort")]
    limits = ["limit 20 N", "limit -20 N", "limit 150 N m", "limit -150 N m"]
    assert labels == ["a [N m]", "b [N]", *limits]
