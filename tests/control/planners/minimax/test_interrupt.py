"""A search is left at once when its listener raises, as Ctrl-C does."""

from typing import Any

import pytest
from tests.plants import plant

from flexslew_control.planners import make_plan, plan_settings
from flexslew_control.planners.progress import Update
from flexslew_plant.testbeds import read_testbed

FEEDBACK = {"kp": [0.5], "kd": [1.0]}
SECTIONS: dict[str, dict[str, Any]] = {
    "floating_oscillator": {"goal": {"mass": 1.0}, "duration": 10.0, "feedback": FEEDBACK},
    "csa": {"duration": 25.0, "pieces": 12, "ensemble": {"draw": "corners"}},
}


@pytest.mark.parametrize("kind", SECTIONS)
def test_an_interrupt_ends_the_search_with_the_program_that_is_solved(kind: str) -> None:
    told: list[Update] = []

    def interrupt(update: Update) -> None:
        told.append(update)
        if len(told) == 3:
            raise KeyboardInterrupt

    testbed = read_testbed({"kind": kind}, "t")
    section = plan_settings({"method": "minimax_feedforward", **SECTIONS[kind]}, "t")
    with pytest.raises(KeyboardInterrupt):
        make_plan(section, plant(0.05, testbed.effort_limit, testbed), None, interrupt)
    assert [update.number for update in told] == [1, 2, 3]
    assert all(update.objective > 0.0 for update in told)
