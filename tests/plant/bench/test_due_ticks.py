"""The tick that a requested simulated time stands for."""

import pytest

from flexslew_plant.bench.due_ticks import requested_tick


@pytest.mark.parametrize(
    ("at", "tick", "requested"),
    [
        (0.0, 0, 0),
        (0.0, 200, 0),  # the next one
        (0.004, 0, 0),
        (0.004, 200, -1),  # tick 0 is over
        (-5.0, 0, -500),
        (-5.0, 200, -500),
        (1.006, 200, 101),
    ],
)
def test_only_a_time_of_zero_stands_for_the_next_tick(at: float, tick: int, requested: int) -> None:
    assert requested_tick(at, 0.01, tick) == requested
