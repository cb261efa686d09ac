"""When joints settle, and how far they go beyond their goal."""

from typing import Any

import numpy as np
import pytest

from flexslew_lab.metrics.metric import Block, Ending, ReferenceManoeuvre, RunSetup
from flexslew_lab.metrics.settling import Settling
from flexslew_plant.arrays import Matrix, Vector

TIME = np.arange(0.0, 20.0, 0.01)  # [s]
GOAL = np.array([1.5, 0.2])  # [rad]


def measured(position: Matrix, displacement: Vector, start: float = 0.0) -> dict[str, Any]:
    """Return the metrics of two joints that went so, measured in two blocks."""
    setup = RunSetup(
        ("yaw", "pitch"), ReferenceManoeuvre(start, start, GOAL, displacement), np.zeros(2), None
    )
    metric, none = Settling(setup), np.zeros((len(TIME), 2))
    for part in (slice(0, 7), slice(7, None)):
        metric.add(
            Block(
                np.arange(len(TIME))[part],
                TIME[part],
                np.full(len(TIME), 0.01)[part],
                position[part],
                none[part],
                none[part],
                none[part, :1],
                (position - GOAL)[part],
                TIME[part] >= start - 1e-9,
                TIME[part] >= start - 1e-9,
            )
        )
    return metric.result(Ending([], [], True))


def ringing(damping: float) -> Vector:
    """Return how a second-order system answers a unit step at 3 rad/s."""
    swing = 3.0 * np.sqrt(1.0 - damping**2)
    decay = np.exp(-3.0 * damping * TIME)
    return np.asarray(
        1.0 - decay * (np.cos(swing * TIME) + 3.0 * damping / swing * np.sin(swing * TIME))
    )


@pytest.mark.parametrize("damping", [0.2, 0.5])
def test_a_step_settles_and_overshoots_as_a_planned_move_does(damping: float) -> None:
    step = ringing(damping)
    position = np.column_stack((0.5 + step, np.full(len(TIME), 0.2)))  # the other one stays
    found = measured(position, np.zeros(2))  # the reference is at the goal from the start
    outside = TIME[np.abs(step - 1.0) > 0.02][-1]
    assert found["settling_time"] == {"yaw": pytest.approx(outside), "pitch": 0.0}
    beyond = np.exp(-damping * np.pi / np.sqrt(1.0 - damping**2))  # of a linear system
    assert found["overshoot"] == {"yaw": pytest.approx(beyond, abs=1e-3), "pitch": None}
    assert found == measured(position, np.array([1.0, 0.0]))


def test_a_step_that_does_not_come_to_rest_has_not_settled() -> None:
    position = np.column_stack((0.5 + ringing(1e-6), np.full(len(TIME), 0.2)))
    found = measured(position, np.zeros(2))
    assert found["settling_time"] == {"yaw": None, "pitch": 0.0}
    assert found["overshoot"]["yaw"] == pytest.approx(1.0, abs=1e-2)


def test_nothing_settles_or_overshoots_before_the_manoeuvre_has_begun() -> None:
    position = np.column_stack((0.5 + 2.0 * ringing(0.5), np.full(len(TIME), 0.2)))
    last = float(TIME[-1])
    for start in (last + 0.01, 30.0):
        found = measured(position, np.array([1.0, 0.0]), start)
        assert found["overshoot"] == {"yaw": None, "pitch": None}
        assert found["settling_time"] == {"yaw": None, "pitch": None}
    assert measured(position, np.array([1.0, 0.0]), last)["overshoot"]["yaw"] > 0.5


def test_who_stays_has_no_overshoot_of_its_rounding() -> None:
    position = np.tile(GOAL, (len(TIME), 1)) + np.outer(ringing(0.5), [1e-15, -1e-15])
    assert measured(position, np.array([2e-16, 0.0]))["overshoot"] == {"yaw": None, "pitch": None}
