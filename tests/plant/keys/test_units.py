"""Quantities with a unit are numbers in SI in every section; those of other kinds are refused."""

from dataclasses import field
from math import pi
from typing import Any

import numpy as np
import pytest

from flexslew_plant.errors import BadInput
from flexslew_plant.keys.units import in_si, names_of, units_in
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


@section
class Instrument:
    """With units by kind and by system."""

    kind: str = "force"
    mass: float = 1.0  # [kg or slug]
    limit: float = 1.0  # [N or lb; torque: N m or lb ft]


@section
class Craft:
    """Written in a system of units."""

    units: str = "si"
    parts: dict[str, Instrument] = field(default_factory=dict)


@pytest.mark.parametrize("unit", ["s", "rad", "rad/s", "m", "N", "N m", "kg", "Hz", "A", "Pa"])
def test_a_unit_of_si_is_one_and_every_symbol_of_its_kind_scales(unit: str) -> None:
    assert in_si(f"1 {unit}", [unit]) == 1.0
    for name in names_of(unit):
        factor = in_si(f"1 {name}", [unit])
        for number in np.random.default_rng(1).standard_normal(5) * 1e3:
            assert in_si(f"{number:.6e}{name}", [unit]) == pytest.approx(number * factor, rel=1e-6)


@pytest.mark.parametrize(
    ("text", "unit", "number"),
    [
        ("0.66 deg/sqrt(h)", "rad/sqrt(s)", 0.66 * pi / 180.0 / 60.0),
        ("0.66 deg/√hr", "rad/sqrt(s)", 0.66 * pi / 180.0 / 60.0),
        ("0.01 deg/s/sqrt(Hz)", "rad/sqrt(s)", 0.01 * pi / 180.0),
        ("3 °/h", "rad/s", 3.0 * pi / 180.0 / 3600.0),
        ("6000 rpm", "rad/s", 200.0 * pi),
        ("0.5 Hz", "rad/s", pi),
        ("30 arcmin", "rad", 0.5 * pi / 180.0),
        ("5 µrad", "rad", 5e-6),
        ("20 mN m", "N m", 0.02),
        ("20 mNm", "N m", 0.02),
        ("1 lb ft", "N m", 1.3558179483314),
        ("1 ft-lb", "N m", 1.3558179483314),
        ("2 lb", "kg", 0.90718474),
        ("2 lb", "N", 8.896443230521),
        ("2 g", "m/s^2", 19.6133),
        ("2 g", "kg", 2e-3),
        ("12 kg m2", "kg m^2", 12.0),
        ("12 g·cm²", "kg m^2", 12e-7),
        ("3 g cm", "kg m", 3e-5),
        ("100 ppm", "-", 1e-4),
        ("0.5 %", "-", 0.005),
        ("1 m", "ft", 1.0 / 0.3048),
        ("1 psi", "lb/ft^2", 144.0),
        ("2 / (N m)^2", "1/(N m)^2", 2.0),
    ],
)
def test_numbers_of_a_data_sheet_are_read(text: str, unit: str, number: float) -> None:
    assert in_si(text, [unit]) == pytest.approx(number, rel=1e-12)


@pytest.mark.parametrize("text", ["2 g/", "2 deg/sqrt(", "2 (s", "2 m^9", "2 sqrt", "2"])
def test_a_text_that_is_no_quantity_stays_a_text(text: str) -> None:
    assert in_si(text, ["kg", "m"]) == text


def test_a_quantity_without_its_system_of_units_stays_a_text() -> None:
    assert in_si("2 slug", ["kg", "slug"]) == "2 slug"
    assert in_si("2 m", ["m", "rad"]) == 2.0


def test_the_kind_and_the_system_of_units_of_a_section_select_the_unit() -> None:
    parts = {"a": {"mass": "1 slug", "limit": "1 lb"}, "b": {"kind": "torque", "limit": "2 N m"}}
    si = validated(Craft, {"parts": parts}, "a.yaml").parts
    feet = validated(Craft, {"units": "slug_ft_lb", "parts": parts}, "a.yaml").parts
    assert (si["a"].mass, si["a"].limit) == pytest.approx((14.5939029372, 4.44822161526))
    assert (feet["a"].mass, feet["a"].limit) == pytest.approx((1.0, 1.0))
    assert (si["b"].limit, feet["b"].limit) == pytest.approx((2.0, 2.0 / 1.3558179483314))
    with pytest.raises(
        BadInput, match=r"parts\.b\.limit: '2 N' is not allowed: give a number in N m"
    ):
        validated(Craft, {"parts": {"b": {"kind": "torque", "limit": "2 N"}}}, "a.yaml")


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
        (
            "turns: [{ratio: 3 deg}]",
            "turns.0.ratio: '3 deg' is not allowed: give a number in %, or with",
        ),
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
    assert units_in("noise [rate: m/s; strain: -]", {"kind": "strain"}) == ("-",)
    assert units_in("noise [rate: m/s; strain: -]") == ("m/s", "-")


def test_brackets_of_an_example_name_no_unit() -> None:
    assert units_in("by joint, as `{JOINT: [-0.1, 1.1]}` [rad or m]; null: any") == ("rad", "m")
