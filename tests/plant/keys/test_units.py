"""Quantities with a unit are numbers in SI in every section; those of other kinds are refused."""

from dataclasses import field
from math import pi
from typing import Any

import numpy as np
import pytest

from flexslew_plant.errors import BadInput
from flexslew_plant.keys.units import UNITS, in_si, units_in
from flexslew_plant.settings import PerJoint, section, validated
from flexslew_plant.yaml_data import load_yaml


@section
class Turn:
    """Of an appendage."""

    angle: float = 0.0  # where it ends [rad]
    note: str = ""  # in words
    ratio: float = 0.0  # of what is left [-]


@section
class Manoeuvre:
    """With keys of every form."""

    duration: float = 25.0  # at least 0 [s]
    goal: dict[str, float] | None = None  # by joint [rad or m]
    rest: PerJoint = (0.0,)  # one per joint [rad]
    turns: tuple[Turn, ...] = field(default=())
    ticks: int = 1  # that are flown


def read(text: str) -> Any:
    return validated(Manoeuvre, load_yaml(text, "a.yaml"), "a.yaml")


@pytest.mark.parametrize("unit", UNITS)
def test_a_unit_of_si_is_one_and_every_number_scales(unit: str) -> None:
    assert in_si(f"1 {unit}", [unit]) == 1.0
    for number in np.random.default_rng(1).standard_normal(20) * 1e3:
        for name, factor in UNITS[unit].items():
            assert in_si(f"{number:.6e}{name}", [unit]) == pytest.approx(number * factor, rel=1e-6)


def test_quantities_are_read_wherever_a_section_has_a_number() -> None:
    found = read(
        "{duration: 2 min, goal: {arm: 57 deg, cart: 30 cm}, rest: [180 deg, 1],"
        " turns: [{}, {angle: -90deg, note: 90 deg}]}"
    )
    assert found.duration == 120.0
    assert found.goal == pytest.approx({"arm": 57.0 * pi / 180.0, "cart": 0.3})
    assert found.rest == pytest.approx((pi, 1.0))
    assert found.turns[1].angle == pytest.approx(-pi / 2.0)
    assert found.turns[1].note == "90 deg"


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("duration: 57 deg", "a.yaml: duration: '57 deg' is not allowed: give a number in s, ms"),
        ("goal: {arm: 2 min}", "goal.arm: '2 min' is not allowed: give a number in rad, mrad, deg"),
        ("turns: [{angle: 3 kg}]", "turns.0.angle: '3 kg' is not allowed: give a number"),
        ("turns: [{ratio: 3 deg}]", "turns.0.ratio: '3 deg' is not allowed: give a number without"),
        ("duration: 1e400 min", "duration: '1e400 min' is not allowed: give a finite number"),
        ("duration: soon", "duration: 'soon' is not allowed: give a number"),
        ("{duration: 2 min, gaol: 1}", "gaol: unknown key"),
        ("{ticks: 3 s}", "ticks: '3 s' is not allowed: give a number without a unit"),
    ],
)
def test_a_quantity_of_another_kind_is_refused_at_its_key(text: str, words: str) -> None:
    with pytest.raises(BadInput) as error:
        read(text)
    assert words in str(error.value)


def test_units_are_those_in_the_brackets_of_the_words() -> None:
    assert units_in("by joint; one left out stays [rad or m]") == ("rad", "m")
    assert units_in("of a drive [N m or N]; at least 0") == ("N m", "N")
    assert units_in("in words") == ()


def test_brackets_of_an_example_name_no_unit() -> None:
    assert units_in("by joint, as `{JOINT: [-0.1, 1.1]}` [rad or m]; null: any") == ("rad", "m")
