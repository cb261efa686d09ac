import copy

import pytest
from hypothesis import given
from hypothesis import strategies as st

from flexslew_lab.trial.overrides import override_values, value_at
from flexslew_plant.errors import BadInput

VALUES = {
    "seed": 1,
    "testbed": {"modes": 3, "parameters": {"length": 30.0}},
    "controllers": {"pd": {"kp": [460.0, 461.0]}, "my.law": {"gain": 1.0}},
    "plan": None,
    "schedule": [{"at": 1.0, "switch": "pd"}],
}


@pytest.mark.parametrize(
    ("path", "value"),
    [
        ("seed", 7),
        ("testbed.parameters.length", 31.0),
        ("controllers.pd.kp", [1.0, 2.0]),
        ("controllers.pd.kp.1", 5.0),
        ("controllers.lqr.filter.prediction", "linear"),
        ("controllers.my.law.gain", 2.0),
        ("plan.goal.base_yaw", 0.5),
        ("schedule.0.at", 2.0),
        ("testbed", {"kind": "other"}),
    ],
)
def test_a_change_stands_where_its_path_says(path: str, value: object) -> None:
    before = copy.deepcopy(VALUES)
    changed = override_values(VALUES, {path: value})
    assert value_at(changed, path) == value
    assert before == VALUES
    assert override_values(changed, {path: "again"}) != changed


def test_changes_are_applied_in_order() -> None:
    changed = override_values(VALUES, {"testbed": {"kind": "hub"}, "testbed.modes": 1})
    assert changed["testbed"] == {"kind": "hub", "modes": 1}


def test_what_a_change_brings_is_not_shared_with_the_result() -> None:
    gains = [1.0, 2.0]
    changed = override_values(VALUES, {"controllers.pd.kp": gains})
    gains[0] = 9.0
    assert changed["controllers"]["pd"]["kp"] == [1.0, 2.0]


def test_what_stands_twice_is_changed_in_one_place() -> None:
    shared = {"length": 30.0}
    values = {"testbed": shared, "model": shared}
    changed = override_values(values, {"testbed.length": 31.0})
    assert changed == {"testbed": {"length": 31.0}, "model": {"length": 30.0}}


@pytest.mark.parametrize(
    ("path", "words"),
    [
        ("", "is no path"),
        ("testbed..modes", "is no path"),
        ("seed.more", "seed is the scalar 1"),
        ("controllers.pd.kp.2", "entries 0 to 1, not 2"),
        ("controllers.pd.kp.first", "entries 0 to 1, not first"),
    ],
)
def test_a_path_that_leads_nowhere_is_refused_in_one_line(path: str, words: str) -> None:
    with pytest.raises(BadInput, match=words) as error:
        override_values(VALUES, {path: 1})
    assert "\n" not in str(error.value)


def test_nothing_at_a_path_is_said() -> None:
    with pytest.raises(BadInput, match="more: lenght is not there"):
        value_at(VALUES, "testbed.lenght.more")
    with pytest.raises(BadInput, match="lenght is not there"):
        value_at(VALUES, "testbed.parameters.lenght")


@given(st.lists(st.sampled_from(["a", "b", "c"]), min_size=1, max_size=4), st.integers())
def test_whatever_is_put_is_found_again(keys: list[str], value: int) -> None:
    path = ".".join(keys)
    assert value_at(override_values({}, {path: value}), path) == value
