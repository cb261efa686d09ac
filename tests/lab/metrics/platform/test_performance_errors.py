"""Performance errors of a known motion, however the run is cut into blocks."""

from typing import Any

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from flexslew_lab.metrics.metric import Block, Ending, ReferenceManoeuvre, RunSetup
from flexslew_lab.metrics.platform.performance_errors import PerformanceErrors
from flexslew_plant.arrays import Vector
from flexslew_plant.testbeds import read_testbed

WINDOW, END, LAST = 5.0, 3.0, 24.0  # [s]
TIME = np.linspace(0.0, LAST, 2401)
CRAFT = read_testbed({"kind": "spacecraft", "appendages": {}, "pointing_window": WINDOW}, "here")


def measured(error: Vector, goal: Rotation, cuts: list[int]) -> dict[str, Any]:
    """Return what the metric says of errors about x from a goal."""
    model = CRAFT.model()
    position = np.zeros((len(TIME), model.positions))
    position[:, 3:7] = (goal * Rotation.from_rotvec(np.outer(error, [1.0, 0.0, 0.0]))).as_quat()
    aim = ReferenceManoeuvre(0.0, END, goal.as_rotvec(), np.zeros(3))
    metric = PerformanceErrors(RunSetup(tuple(model.joint_names), aim, np.ones(3), CRAFT))
    for first, last in zip([0, *cuts], [*cuts, len(TIME)], strict=True):
        time, none = TIME[first:last], np.zeros((last - first, 3))
        metric.add(
            Block(
                np.arange(first, last), time, np.full(time.size, 0.01), position[first:last],
                np.zeros((time.size, model.coordinates)), none, none[:, :0], none,
                time >= 0.0, time >= END - 1e-9,
            )
        )  # fmt: skip
    return metric.result(Ending([], [], True))


@pytest.mark.parametrize("seed", range(3))
def test_of_a_swing_about_an_offset_they_are_sum_offset_and_amplitude(seed: int) -> None:
    rng = np.random.default_rng(seed)
    offset, swing = rng.uniform(0.01, 0.1, 2)
    error = offset + swing * np.sin(2.0 * np.pi * (TIME - END) / WINDOW)
    error[TIME < END - 1e-9] = 1.0  # of the slew, which does not count
    cuts = sorted(rng.choice(np.arange(1, len(TIME)), 7, replace=False).tolist())
    found = measured(error, Rotation.random(random_state=seed), cuts)
    for key, expected in (("absolute", offset + swing), ("mean", offset), ("relative", swing)):
        x, *across = found[f"{key}_performance_error"]
        assert x == pytest.approx(expected, rel=1e-3)  # at the ticks
        assert max(map(abs, across)) < 1e-12


def test_the_worst_window_counts_and_one_that_is_cut_short_does_not() -> None:
    error = np.where((TIME >= END + WINDOW) & (TIME < END + 2.0 * WINDOW), 0.2, 0.1)
    error[TIME >= END + 4.0 * WINDOW] = 9e-1
    found = measured(error, Rotation.identity(), [])
    assert found["absolute_performance_error"][0] == pytest.approx(0.9)
    assert found["mean_performance_error"][0] == pytest.approx(0.2)
    assert found["relative_performance_error"][0] == pytest.approx(0.0, abs=1e-12)


def test_without_a_whole_window_there_is_neither_mean_nor_relative_error() -> None:
    few = {"kind": "spacecraft", "appendages": {}, "pointing_window": 100.0}
    model = read_testbed(few, "here").model()
    aim = ReferenceManoeuvre(0.0, END, np.zeros(3), np.zeros(3))
    metric = PerformanceErrors(
        RunSetup(tuple(model.joint_names), aim, np.ones(3), read_testbed(few, "here"))
    )
    found = metric.result(Ending([], [], True))
    assert set(found.values()) == {None}
