"""Lines of sight, platform errors and vibrations of antennas, against closed forms."""

import math
from typing import Any

import numpy as np
import pytest

from flexslew_lab.metrics.metric import Block, Ending, ReferenceManoeuvre, RunSetup
from flexslew_lab.metrics.platform.line_of_sight import LineOfSightMetric
from flexslew_lab.metrics.platform.platform_error import PlatformError
from flexslew_lab.metrics.vibration import Vibration
from flexslew_lab.reproduce.scole_flights import example_trial
from flexslew_plant.arrays import Matrix, Vector
from flexslew_plant.bench.retarget import with_requests
from flexslew_plant.testbeds import Testbed

END = Ending([], [], True)
TIME = np.linspace(0.0, 6.0, 1201)


def craft(**motion: Any) -> Testbed:
    """Return antenna_5_1, whose membrane has ten modes, with another turn about x."""
    whole = {"to": 0.6, "duration": 3.0, **motion}
    return example_trial(
        "antenna_5_1", {"testbed": {"appendages": {"membrane": {"hinge": {"motion": whole}}}}}
    ).testbed


def measured(
    kind: Any, testbed: Testbed, q: Matrix, goal: Vector | None = None, end: float = 3.0
) -> dict[str, Any]:
    """Return what a metric says of these positions, by the end of the manoeuvre [s]."""
    model = testbed.model()
    names, joints = tuple(model.joint_names), model.joints
    aim = ReferenceManoeuvre(0.0, end, np.zeros(joints) if goal is None else goal, np.zeros(joints))
    metric = kind(RunSetup(names, aim, np.ones(joints), testbed))
    metric.add(
        Block(
            np.arange(len(TIME)), TIME, np.diff(TIME, prepend=0.0), q,
            np.zeros((len(TIME), model.coordinates)), np.zeros((len(TIME), joints)),
            np.zeros((len(TIME), 1)), None, TIME >= 0.0, end <= TIME,
        )
    )  # fmt: skip
    found: dict[str, Any] = metric.result(END)
    return found


def still(testbed: Testbed) -> Matrix:
    return np.tile(testbed.model().rest({}), (len(TIME), 1))


@pytest.mark.parametrize("tilt", [0.0, 1e-3, -0.7, 2.0])
def test_a_platform_that_is_tilted_makes_its_antennas_miss_by_as_much(tilt: float) -> None:
    testbed = craft()
    q = still(testbed)
    q[:, 3], q[:, 6] = np.sin(tilt / 2), np.cos(tilt / 2)  # about x, as the hinge
    found = measured(LineOfSightMetric, testbed, q)
    assert found["line_of_sight_error"]["membrane"] == pytest.approx(abs(tilt), abs=1e-12)
    tip = measured(PlatformError, testbed, q)
    assert tip["residual_platform_attitude"] == pytest.approx([abs(tilt), 0.0, 0.0], abs=1e-12)
    assert tip["rms_platform_attitude"] == pytest.approx(abs(tilt), abs=1e-12)


def test_a_line_of_sight_counts_when_a_turn_has_ended_and_until_the_next_begins() -> None:
    testbed = craft()
    again = with_requests(testbed, [("{appendage: membrane, to: 0.1, duration: 1.0}", 4.0)])
    q = still(testbed)
    for (begin, end), expected in {(0.0, 2.9): 0.0, (3.0, 3.9): 0.4, (5.1, 6.0): 0.4}.items():
        tilted = q.copy()
        rows = (begin - 1e-9 <= TIME) & (end + 1e-9 >= TIME)
        tilted[rows, 4], tilted[rows, 6] = np.sin(0.2), np.cos(0.2)  # about y
        # the line of sight of a hinge at angle a lies cos a from the plane of that turn
        error = measured(LineOfSightMetric, again, tilted)["line_of_sight_error"]["membrane"]
        angle = 0.6 if end < 4.0 else 0.1
        if expected:
            chord = 2.0 * np.sin(0.2) * np.cos(angle)
            expected = 2.0 * math.asin(chord / 2.0)
        assert error == pytest.approx(expected, abs=1e-12)
    settled = measured(LineOfSightMetric, again, q)["line_of_sight_settled_at"]["membrane"]
    assert settled == pytest.approx(5.0)
    q[TIME > 5.5, 3] = 0.01
    assert measured(LineOfSightMetric, again, q)["line_of_sight_settled_at"]["membrane"] is None


def test_targets_count_from_the_attitude_of_the_goal() -> None:
    testbed = craft()
    names = testbed.model().joint_names
    goal = np.array([0.3 if name == "roll" else 0.0 for name in names])
    q = np.tile(testbed.model().rest({"roll": 0.3}), (len(TIME), 1))
    found = measured(LineOfSightMetric, testbed, q, goal)
    assert found["line_of_sight_error"]["membrane"] == pytest.approx(0.0, abs=1e-12)
    away = measured(PlatformError, testbed, q, goal)
    assert away["rms_platform_attitude"] == pytest.approx(0.0, abs=1e-12)
    x = q.copy()
    x[:, 0] = 0.2
    assert measured(PlatformError, testbed, x, goal)["residual_platform_position"][0] == 0.2


@pytest.mark.parametrize("decay", [0.8, 2.0, 7.0])
def test_a_vibration_settles_when_its_envelope_has_decayed_to_a_twentieth(decay: float) -> None:
    testbed = craft()
    q = still(testbed)
    q[:, -10] = np.exp(-decay * np.maximum(TIME - 3.0, 0.0))
    found = measured(Vibration, testbed, q)["vibration_settling_time"]["membrane"]
    expected = math.log(20.0) / decay
    assert (found is None) if expected > 3.0 else found == pytest.approx(expected, abs=0.005)
    q[:, -10] = 1.0
    assert measured(Vibration, testbed, q)["vibration_settling_time"]["membrane"] is None


@pytest.mark.parametrize("phase", np.linspace(0.0, np.pi, 24, endpoint=False))
@pytest.mark.parametrize("decay", [0.0, 0.3, 4.0])
def test_a_vibration_that_swings_through_zero_at_the_end_has_not_settled(
    decay: float, phase: float
) -> None:
    testbed = craft()
    q = still(testbed)
    swings = np.cos(6.0 * (TIME - 3.0) + phase) * np.exp(-decay * np.maximum(TIME - 3.0, 0.0))
    q[:, -10] = swings
    found = measured(Vibration, testbed, q)["vibration_settling_time"]["membrane"]
    assert (found is not None) == (decay > 1.0)
    assert found is None or math.log(20.0) / decay - np.pi / 6.0 < found < math.log(20.0) / decay


def test_a_vibration_that_nothing_is_before_settles_from_its_largest_deflection() -> None:
    testbed = example_trial("own_spacecraft").testbed  # its panels do not turn; a step, or no plan
    q = still(testbed)
    grows = np.minimum(TIME / 0.5, 1.0) * np.exp(-2.0 * np.maximum(TIME - 0.5, 0.0))
    q[:, -6:-3], q[:, -3:] = 0.01 * grows[:, None], 0.0
    settled = measured(Vibration, testbed, q, end=0.0)["vibration_settling_time"].values()
    assert max(settled) == pytest.approx(0.5 + math.log(20.0) / 2.0, abs=0.006)
    q[:, -6:] = 0.01
    ringing = measured(Vibration, testbed, q, end=0.0)["vibration_settling_time"]
    assert set(ringing.values()) == {None}


def test_a_testbed_without_antennas_has_none_of_these() -> None:
    assert (
        measured(LineOfSightMetric, example_trial("scole_s_open").testbed, np.zeros((1201, 0)))
        == {}
    )
