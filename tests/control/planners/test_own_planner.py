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


ROBUST = """
from dataclasses import replace
from pathlib import Path

from flexslew_control.planners.minimax.members import Ensemble, members_of
from flexslew_plant.own_code import module_at
from flexslew_plant.settings import section


@section
class Robust:
    method: str
    goal: dict[str, float]
    start: float = 0.0
    ensemble: Ensemble = Ensemble()

    def plan(self, slew, progress):
        slowest = min(members_of(self.ensemble, slew), key=frequency)
        made = module_at(Path({shaper!r})).Shaper(method=self.method, goal=self.goal)
        softest = slew.testbed.scaled(stiffness=1.0 + slowest.errors["stiffness"])
        plan = made.plan(replace(slew, testbed=softest), progress)
        return replace(plan, summary={{"slowest": slowest.errors}})


def frequency(member):
    return member.model.linearise(member.model.rest({{}})).frequencies[0]
"""


def test_it_has_an_ensemble_by_a_key_of_its_own(tmp_path: Path) -> None:
    file = tmp_path / "robust_shaper.py"
    code = ROBUST.format(shaper=str(EXAMPLES / "my_shaper.py"))
    file.write_text(code)
    ensemble = {"vary": {"stiffness": [-0.3, 0.1]}, "draw": "corners"}
    section = {"method": f"{file}:Robust", "goal": GOAL, "ensemble": ensemble}
    settings = plan_settings(section, "trial.yaml", ANY_CODE)
    plan = make_plan(settings, plant(0.02, testbed=CsaTestbed(modes=1)), Feedback())
    assert plan.summary["slowest"] == {"stiffness": -0.3}
