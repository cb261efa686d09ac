"""Antennas that cannot turn so: one line that says which key and what is allowed, nothing flown."""

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from tests.lab.conftest import Call

from flexslew_lab.reproduce.scole_flights import example_trial
from flexslew_plant.errors import BadInput

Fly = Callable[[str, dict[str, Any]], str]
WITH = {  # the antenna of each shipped trial, and where its z may point
    "antenna_1": ("beam", [0.0, 0.8, 0.6]),
    "antenna_2": ("second", [0.8, 0.0, 0.6]),
    "antenna_4": ("beam", [0.0, 0.8, 0.6]),
    "antenna_5_1": ("membrane", [0.0, -0.8, 0.6]),
    "antenna_5_2": ("membrane", [0.0, -0.8, 0.6]),
}
ACTUATOR = {"kind": "force", "direction": [0.0, 2.0, 0.0], "limit": 1000.0}
TWINS = {"testbed.actuators.twin": ACTUATOR}  # of y


@pytest.fixture
def refused(call: Call, monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> Fly:
    """Return what flies a shipped trial with some keys set, and gives back why it was refused."""

    def fly(name: str, keys: dict[str, Any]) -> str:
        sets = [w for key, value in keys.items() for w in ("--set", f"{key}={json.dumps(value)}")]
        code, out, err = call("trial", name, "--in-process", *sets, "--out", tmp_path / "run")
        assert (code, out) == (2, ""), err
        assert len(err.strip().splitlines()) == 1
        assert err.startswith("error: ")
        assert not list(tmp_path.iterdir())
        return err

    monkeypatch.setenv("COLUMNS", "2000")
    monkeypatch.chdir(tmp_path)
    return fly


def hinge(name: str) -> str:
    return f"testbed.appendages.{WITH[name][0]}.hinge"


@pytest.mark.parametrize("name", WITH)
@pytest.mark.parametrize("to", [-0.31, 0.31, "sight"])
def test_a_target_outside_of_the_range_of_its_hinge(refused: Fly, name: str, to: Any) -> None:
    place, sight = hinge(name), {"line_of_sight": WITH[name][1], "duration": 1.0}
    wish = sight if to == "sight" else {"to": to, "duration": 1.0}
    told = refused(name, {f"{place}.range": [-0.3, 0.3], f"{place}.motion": wish})
    assert f"{place}.motion.0.to: " in told
    assert "outside of the range -0.3 to 0.3 rad" in told


@pytest.mark.parametrize("name", WITH)
def test_a_target_of_the_schedule_outside_of_the_range(refused: Fly, name: str) -> None:
    entry = {"at": 3.5, "retarget": {"appendage": WITH[name][0], "to": 2.0, "duration": 1.0}}
    told = refused(
        name, {f"{hinge(name)}.range": [-1.8, 1.8], "schedule": [entry], "duration": 5.0}
    )
    assert f"schedule.0.retarget: {hinge(name)}.motion." in told
    assert ".to: 2 rad is outside of the range -1.8 to 1.8 rad" in told


@pytest.mark.parametrize("name", WITH)
@pytest.mark.parametrize("begin", [0.0, 0.5, 0.999])
def test_turns_of_one_hinge_that_overlap(refused: Fly, name: str, begin: float) -> None:
    two = [{"to": 0.1, "duration": 1.0}, {"to": 0.2, "duration": 1.0, "at": begin}]
    told = refused(name, {f"{hinge(name)}.motion": two})
    assert f"{hinge(name)}.motion.1.at: begins at {begin:g} s, before the last one ends" in told
    again = {"appendage": WITH[name][0], "to": 0.3, "duration": 0.5}
    entries = [{"at": 3.5, "retarget": again}, {"at": 3.5 + begin / 2.1, "retarget": again}]
    told = refused(name, {"schedule": entries, "duration": 5.0})
    assert f"schedule.1.retarget: {hinge(name)}.motion." in told
    assert "before the last one ends at 4 s" in told


def test_turns_that_follow_at_once_and_those_of_two_hinges_are_no_overlap() -> None:
    two = [{"to": 0.1, "duration": 1.0}, {"to": 0.2, "duration": 1.0, "at": 1.0}]
    both = {name: {"hinge": {"motion": two}} for name in ("first", "second")}
    assert example_trial("antenna_2", {"testbed": {"appendages": both}}).testbed.modes == 12


@pytest.mark.parametrize(
    ("name", "keys"),
    [
        ("antenna_1", {}),  # the plan balances
        ("antenna_2", {}),
        ("antenna_4", {"plan.gains": "perturbation"}),
        ("antenna_4", {"active": "modal_space", "controllers": {"modal_space": {}}}),
        ("antenna_5_1", {}),
    ],
)  # fmt: skip
def test_efforts_that_do_the_same_leave_a_motion_that_cannot_be_balanced(
    refused: Fly, name: str, keys: dict[str, Any]
) -> None:
    told = refused(name, {**TWINS, **keys})
    assert "B* has rank" in told or "one effort for each motion" in told
    if "B* has rank" in told:
        assert "twin and y are dependent; the motion of" in told
        assert "cannot be balanced" in told


@pytest.mark.parametrize("gains", ["perturbation", "adiabatic"])
def test_an_end_condition_that_is_not_positive_definite(refused: Fly, gains: str) -> None:
    soft = {"plan.duration": 2.75, "duration": 2.75}  # ends where the stiffness is lowest
    swing = {"testbed.parameters.stiffness_swing": 90.0}
    told = refused("antenna_3", {"plan.gains": gains, **swing, **soft})
    assert "P0 + P1 at the end of the manoeuvre is not positive definite: lowest" in told
    assert "take gains: perturbation with end_condition: zero" in told


def test_a_table_that_does_not_end_at_rest() -> None:
    table = [[0.0, 0.0, 0.0, 0.0], [1.0, 1.0, 0.5, 0.0]]
    wish = {"to": 0.1, "duration": 1.0, "profile": "table", "table": table}
    with pytest.raises(BadInput, match=r"motion.0.table: must rise .* to \[1, 1, 0, 0\]"):
        example_trial(
            "antenna_1", {"testbed": {"appendages": {"beam": {"hinge": {"motion": wish}}}}}
        )
