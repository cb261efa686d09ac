"""What a plan of a study is known by."""

from typing import Any

from tests.lab.studies.batch.both_ways import CRAFT

from flexslew_lab.studies.flight import plan_key
from flexslew_lab.trial.trial import Trial, trial_of_values


def turning(method: str, to: float) -> Trial:
    """Return a trial of a craft whose boom turns to another target."""
    turn = {"at": 0.5, "duration": 1.0, "to": 0.3, "axis": [1.0, 0.0, 0.0]}
    boom: dict[str, Any] = CRAFT["appendages"]["boom"]
    hinged = boom | {"hinge": boom["hinge"] | {"motion": turn}}
    values = {
        "testbed": CRAFT | {"appendages": {"boom": hinged}},
        "plan": {"method": method, "goal": {"roll": 0.4}, "duration": 4.0},
        "schedule": [{"at": 2.0, "retarget": {"appendage": "boom", "to": to, "duration": 1.0}}],
    }
    return trial_of_values(values, "test")


def test_a_plan_from_the_testbed_is_another_one_where_new_targets_differ() -> None:
    assert plan_key(turning("input_shaping", 0.1)) == plan_key(turning("input_shaping", 0.1))
    assert plan_key(turning("input_shaping", 0.1)) != plan_key(turning("input_shaping", 0.2))


def test_a_plan_without_a_model_does_not_depend_on_new_targets() -> None:
    assert plan_key(turning("none", 0.1)) == plan_key(turning("none", 0.2))
