"""Random slews of a spacecraft by minimax_feedforward keep their promise on the whole bench."""

from typing import Any, cast

import numpy as np
import pytest
from tests.representatives import seeds

from flexslew_control.planners import make_plan
from flexslew_control.planners.residual.whole_bench import by_feedback, simulate_on_bench
from flexslew_lab.notebook import trial
from flexslew_lab.trial.trial import feedback_of, plant_of

QUICK = {"pieces": 20, "ensemble": {"count": 3}, "max_steps": 8}


@pytest.mark.slow
@pytest.mark.parametrize("seed", seeds(2))
def test_random_slews_of_a_craft_keep_their_promise_on_members_and_between(seed: int) -> None:
    rng = np.random.default_rng([30, seed])
    plan = {
        "method": "minimax_feedforward",
        "goal": {"roll": float(rng.uniform(0.2, 0.6))},
        "duration": round(float(rng.uniform(27.0, 34.0)), 1),
        "model": {"modes": 2},
        **QUICK,
    }
    what = trial("own_spacecraft", {"period": 0.05, "plan": plan})
    plant, feedback = plant_of(what), feedback_of(what)
    assert feedback is not None
    found = make_plan(cast(Any, what.plan), plant, feedback)
    left = []
    for error in (-0.2, -0.1, 0.0, 0.1, 0.2):
        testbed = plant.testbed.scaled(stiffness=1.0 + error)
        flown = simulate_on_bench(found, plant, by_feedback(feedback), testbed)
        assert flown is not None
        left.append(flown.tip_deflection)
    assert max(left) > 1e-6
    assert 0.9 < max(left) / found.summary["worst_residual"] < 1.1
