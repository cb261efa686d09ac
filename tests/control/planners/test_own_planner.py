"""The planner of one's own in the documentation plans, and is refused where it is not trusted."""

from pathlib import Path
from typing import Any

import pytest
from tests.plants import plant

from flexslew_control.planners import make_plan, plan_settings
from flexslew_control.planners.slew import Feedback
from flexslew_plant.errors import BadInput
from flexslew_plant.own_code import ANY_CODE
from flexslew_plant.testbeds.csa import CsaTestbed

EXAMPLES = Path(__file__).parents[3] / "docs" / "examples"
METHOD = f"{EXAMPLES / 'my_shaper.py'}:Shaper"
GOAL = {"base_yaw": 1.0}


def left(**section: Any) -> float:
    settings = plan_settings({"goal": GOAL, **section}, "trial.yaml", ANY_CODE)
    plan = make_plan(settings, plant(0.02, testbed=CsaTestbed(modes=1)), Feedback())
    return float(plan.summary["predicted_residual_tip_deflection"])


def test_the_shaper_leaves_less_than_the_same_command_without_it() -> None:
    shaped, plain = left(method=METHOD), left(method="reference_only", duration=20.0)
    assert shaped < 0.02 * plain


def test_it_stands_in_the_documentation() -> None:
    page = (EXAMPLES.parent / "own_planner.md").read_text()
    code = (EXAMPLES / "my_shaper.py").read_text()
    assert code in page
    body = code.split("def plan(self, slew, progress):")[1].strip().splitlines()
    assert len(body) <= 25


def test_nobody_loads_it_who_does_not_trust_it() -> None:
    with pytest.raises(BadInput, match=r"my_shaper\.py:Shaper"):
        plan_settings({"method": METHOD, "goal": GOAL}, "trial.yaml")
