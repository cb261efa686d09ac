"""Bounds at a level of confidence and sums of sources."""

import numpy as np
import pytest

from flexslew_lab.budget.contribution import (
    ErrorParts,
    bound_of,
    drawn_parts,
    fixed_parts,
    half_width,
    noise_parts,
    sum_parts,
)
from flexslew_plant.errors import BadInput

_POINTS = 2976
_SINE = np.sin(2.0 * np.pi * np.arange(_POINTS)[:, None] / 248.0)
_NONE = np.zeros((_POINTS, 1))


def _value(parts: ErrorParts, interpretation: str, level: float = 0.9973) -> float:
    return float(bound_of(parts, interpretation, half_width(level)).value[0])  # type: ignore[arg-type]


@pytest.mark.parametrize(("level", "width"), [(0.6827, 1.0), (0.9545, 2.0), (0.9973, 3.0)])
def test_levels_of_confidence_have_the_half_widths_of_a_normal_distribution(
    level: float, width: float
) -> None:
    assert half_width(level) == pytest.approx(width, abs=3e-4)


@pytest.mark.parametrize("level", [0.0, 1.0, -1.0, np.nan])
def test_a_level_that_is_no_probability_is_refused(level: float) -> None:
    with pytest.raises(BadInput, match="--level"):
        half_width(level)


@pytest.mark.parametrize("interpretation", ["mixed", "temporal", "ensemble"])
def test_a_white_noise_is_bounded_by_its_half_width(interpretation: str) -> None:
    parts = noise_parts({"APE": np.full((_POINTS, 1), 4.0)})["APE"]
    assert _value(parts, interpretation) == pytest.approx(2.0 * half_width(0.9973), rel=1e-6)


@pytest.mark.parametrize("interpretation", ["mixed", "temporal", "ensemble"])
def test_a_constant_is_bounded_by_itself(interpretation: str) -> None:
    parts = fixed_parts({"APE": _NONE - 0.5})["APE"]
    assert _value(parts, interpretation) == pytest.approx(0.5)


def test_a_harmonic_has_the_quantiles_of_its_own_distribution() -> None:
    """|sin| is below sin(pi p / 2) for the share p of the time; its largest value is one."""
    parts = ErrorParts(_SINE, _NONE, _NONE)
    assert _value(parts, "mixed", 0.5) == pytest.approx(np.sin(np.pi / 4.0), rel=0.01)
    assert _value(parts, "ensemble", 0.5) == pytest.approx(1.0)
    assert float(bound_of(parts, "mixed", 3.0).deviation[0]) == pytest.approx(np.sqrt(0.5))


def test_the_mixed_bound_contains_its_share_of_all_members() -> None:
    parts = ErrorParts(_SINE, _NONE + 0.25, _NONE + 0.09)
    value, rng = _value(parts, "mixed", 0.95), np.random.default_rng(5)
    inside = [
        (abs(_SINE + 0.5 * rng.standard_normal() + 0.3 * rng.standard_normal((_POINTS, 1))) < value)
        for _ in range(600)
    ]
    assert np.mean(inside) == pytest.approx(0.95, abs=0.01)


def test_the_interpretations_differ_for_what_members_draw() -> None:
    """Of a constant per member, the worst member keeps it for all time; mixed does, too."""
    parts = drawn_parts({"APE": _NONE + 2.0})["APE"]
    assert _value(parts, "temporal") == pytest.approx(2.0 * half_width(0.9973))
    both = sum_parts([parts, noise_parts({"APE": _NONE + 1.0})["APE"]])
    width = half_width(0.9973)
    assert _value(both, "mixed") == pytest.approx(width * np.sqrt(5.0), rel=1e-6)
    assert _value(both, "temporal") > _value(both, "mixed")


def test_errors_of_one_run_add_with_their_signs_and_variances_add() -> None:
    total = sum_parts(
        [ErrorParts(_SINE, _NONE + 1.0, _NONE), ErrorParts(-_SINE, _NONE, _NONE + 2.0)]
    )
    assert abs(total.fixed).max() == 0.0
    assert float(bound_of(total, "mixed", 1.0).deviation[0]) == pytest.approx(np.sqrt(3.0))
