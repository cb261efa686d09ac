from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from flexslew_control.planners.trajectories import PROFILES, rest_to_rest, rounded_up

START, GOAL = np.array([0.2, -0.1]), np.array([1.0, 0.5])


@pytest.mark.parametrize("profile", PROFILES)
def test_starts_and_ends_at_rest_and_stays_there(profile: Any) -> None:
    times = np.array([-1.0, 0.0, 25.0, 30.0])
    r = rest_to_rest(profile, START, GOAL, 25.0, times)
    np.testing.assert_allclose(r.position, [START, START, GOAL, GOAL], atol=1e-15)
    np.testing.assert_allclose(r.velocity, 0.0, atol=1e-15)


@pytest.mark.parametrize("profile", PROFILES)
def test_velocity_is_the_derivative(profile: Any) -> None:
    t, h = np.linspace(0.1, 24.9, 101), 1e-4
    after, before = (rest_to_rest(profile, START, GOAL, 25.0, t + d).position for d in (h, -h))
    velocity = rest_to_rest(profile, START, GOAL, 25.0, t).velocity
    np.testing.assert_allclose(velocity, (after - before) / (2 * h), atol=1e-9)


@pytest.mark.parametrize(("profile", "acceleration"), [("quintic", 0.0), ("cubic", 6.0)])
def test_only_the_quintic_starts_and_ends_without_acceleration(
    profile: Any, acceleration: float
) -> None:
    inside = np.array([1e-6, 1.0 - 1e-6])  # of a slew of 1 s
    slopes = rest_to_rest(profile, START, GOAL, 1.0, inside).velocity / 1e-6
    np.testing.assert_allclose(slopes, [acceleration * (GOAL - START)] * 2, atol=1e-4)


@given(st.floats(0.01, 100.0), st.sampled_from(sorted(PROFILES)))
def test_moves_monotonously_on_a_straight_line(duration: Any, profile: Any) -> None:
    r = rest_to_rest(profile, START, GOAL, duration, np.linspace(0.0, duration, 50))
    share = (r.position - START) / (GOAL - START)
    np.testing.assert_allclose(share[:, 0], share[:, 1], atol=1e-12)
    assert np.all(np.diff(share[:, 0]) >= -1e-12)


def test_a_number_is_rounded_up_to_what_a_message_prints() -> None:
    for value in 10.0 ** np.random.default_rng(4).uniform(-4.0, 6.0, 200):
        up = rounded_up(value)
        assert value <= up <= 1.01 * value
        assert float(f"{up:g}") == up
