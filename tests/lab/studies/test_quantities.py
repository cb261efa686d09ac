"""Distributions of a study are read in any unit of their key's kind."""

from math import pi
from pathlib import Path

import pytest

from flexslew_lab.studies.study import parse_study
from flexslew_plant.errors import BadInput


def numbers_of(key: str, spread: str) -> tuple[float, ...]:
    text = (
        "{study: spread, trial: m1, sampling: {method: random, n: 4},"
        f" vary: {{{key}: {spread}}}}}"
    )
    (varied,) = parse_study(text, "s.yaml", Path()).varied
    assert varied.distribution is not None
    return varied.distribution.numbers


@pytest.mark.parametrize(
    ("key", "spread", "numbers"),
    [
        ("plan.goal.base_yaw", "{uniform: [57 deg, 60 deg]}", (57 * pi / 180, 60 * pi / 180)),
        ("plan.goal.base_yaw", "{offset: {normal: [0, 30 arcsec]}}", (0.0, pi / 21600)),
        ("duration", "{choice: [1 min, 2 min]}", (60.0, 120.0)),
        ("testbed.damping_ratio", "{uniform: [500 ppm, 1 %]}", (0.0005, 0.01)),
        ("plan.goal.base_yaw", "{relative: {uniform: [-5 %, 5 %]}}", (-0.05, 0.05)),
        ("controllers.pd_feedforward.kp.0", "{uniform: [0.4 kN m/rad, 500]}", (400.0, 500.0)),
    ],
)
def test_quantities_are_numbers_of_the_key(
    key: str, spread: str, numbers: tuple[float, ...]
) -> None:
    assert numbers_of(key, spread) == pytest.approx(numbers, rel=1e-12)


@pytest.mark.parametrize(
    ("key", "spread", "words"),
    [
        ("plan.goal.base_yaw", "{uniform: [1 kg, 2]}", "vary.plan.goal.base_yaw.uniform: '1 kg'"),
        ("plan.goal.base_yaw", "{uniform: [0, 2 m]}", "'2 m' is not allowed: give a number in rad"),
        ("duration", "{relative: {uniform: [-1 s, 1 s]}}", "'-1 s' is not allowed: give a number"),
    ],
)
def test_a_quantity_of_another_kind_is_refused_at_its_key(
    key: str, spread: str, words: str
) -> None:
    with pytest.raises(BadInput) as error:
        numbers_of(key, spread)
    assert words in str(error.value)
    assert str(error.value).startswith("s.yaml: vary.")
