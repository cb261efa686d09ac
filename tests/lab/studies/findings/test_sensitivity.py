"""Sobol indices of a Saltelli sample, on the function of Ishigami and Homma (1990)."""

import numpy as np
import pytest

from flexslew_lab.studies.findings.sensitivity import Index, indices
from flexslew_lab.studies.sampling.distributions import Distribution
from flexslew_lab.studies.sampling.methods import Sampling, draw_samples
from flexslew_plant.arrays import Vector

NAMES = ["x1", "x2", "x3"]
A, B = 7.0, 0.1
# sin x1 + A sin^2 x2 + B x3^4 sin x1 on (-pi, pi)^3: variances in closed form
V1 = 0.5 * (1.0 + B * np.pi**4 / 5.0) ** 2
V2, V13 = A**2 / 8.0, 8.0 * B**2 * np.pi**8 / 225.0
TOTAL = V1 + V2 + V13
FIRST = (V1 / TOTAL, V2 / TOTAL, 0.0)
WHOLE = ((V1 + V13) / TOTAL, V2 / TOTAL, V13 / TOTAL)


def sample(n: int, seed: int) -> Vector:
    """Return the function's values in the order of a Saltelli sample."""
    unit = draw_samples(
        Sampling(method="saltelli", n=n), [Distribution("uniform", (0.0, 1.0))] * 3, seed
    ).unit
    x = np.pi * (2.0 * unit.T - 1.0)
    values: Vector = np.sin(x[0]) + A * np.sin(x[1]) ** 2 + B * x[2] ** 4 * np.sin(x[0])
    return values


def found(n: int, seed: int) -> list[Index]:
    """Return the indices of a sample after checking that there are any."""
    rows, why = indices(sample(n, seed), NAMES, 0.9, seed)
    assert not why
    return rows


@pytest.mark.slow
def test_indices_are_those_in_closed_form() -> None:
    rows = found(1024, 3)
    assert rows == found(1024, 3)  # bounds, too: a report is the same whenever it is written
    assert [row.name for row in rows] == NAMES
    for row, first, total in zip(rows, FIRST, WHOLE, strict=True):
        assert row.first[1] == pytest.approx(first, abs=0.03)
        assert row.total[1] == pytest.approx(total, abs=0.03)


def test_bootstrap_bounds_hold_as_often_as_they_say() -> None:
    """A Sobol sequence is better than the bootstrap knows: at least nine of ten bounds hold."""
    inside = []
    for seed in range(20):
        for row, first, total in zip(found(128, seed), FIRST, WHOLE, strict=True):
            inside.append(row.first[0] <= first <= row.first[2])
            inside.append(row.total[0] <= total <= row.total[2])
    assert np.mean(inside) >= 0.9 - 3.0 * np.sqrt(0.09 / len(inside))


def test_bounds_of_replicates_hold_of_a_pure_interaction_too() -> None:
    """Of one design, whose rows are less even together than independent ones, 56 % held."""
    four = [Distribution("uniform", (0.0, 1.0))] * 4
    truth = np.array([[0.0] * 4, [1.0, 1.0, 0.0, 0.0]])
    inside = []
    for seed in range(60):
        unit = draw_samples(Sampling(method="saltelli", n=256, replicates=8), four, seed).unit - 0.5
        rows, _ = indices(unit[:, 0] * unit[:, 1], list("abcd"), 0.9, seed, 8)
        ends = np.array([(row.first, row.total) for row in rows]).swapaxes(0, 1)
        inside.append((ends[..., 0] <= truth) & (truth <= ends[..., 2]))
    assert np.mean(inside) >= 0.9 - 3.0 * np.sqrt(0.09 / 60)  # those of a study hang together


def test_one_missing_number_leaves_no_index() -> None:
    values = sample(64, 1)
    for bad in (np.nan, np.inf):
        values[17] = bad
        rows, why = indices(values, NAMES, 0.9, 1)
        assert not rows
        assert why.startswith("1 of 320 trials gave no number")
    assert indices(np.ones(320), NAMES, 0.9, 1) == ([], "the metric does not vary")


@pytest.mark.parametrize("n", [2, 64])
def test_one_value_has_all_of_the_variance(n: int) -> None:
    one = Distribution("uniform", (0.0, 1.0))
    values = np.sin(2.0 * draw_samples(Sampling(method="saltelli", n=n), [one], 1).unit[:, 0])
    rows, why = indices(values, ["x"], 0.9, 1)
    assert (len(rows), why) == (1, "")
    if n > 2:
        assert rows[0].first[1] == pytest.approx(1.0, abs=0.05)
        assert rows[0].total[1] == pytest.approx(1.0, abs=0.05)


@pytest.mark.filterwarnings("error")
def test_a_value_without_effect_has_no_share_and_bounds_of_it() -> None:
    two = [Distribution("uniform", (0.0, 1.0))] * 2
    values = np.sin(2.0 * draw_samples(Sampling(method="saltelli", n=64), two, 1).unit[:, 0])
    rows, _ = indices(values, ["x", "y"], 0.9, 1)
    assert rows[1] == Index("y", (0.0, 0.0, 0.0), (0.0, 0.0, 0.0))
    assert rows[0].first[0] < rows[0].first[1] < rows[0].first[2]


@pytest.mark.filterwarnings("error")
@pytest.mark.parametrize("unit", [1e-300, 1e300])
def test_indices_are_the_same_in_every_unit(unit: float) -> None:
    values = sample(64, 2)
    rows, _ = indices(unit * values, NAMES, 0.9, 2)
    assert np.array([row[1:] for row in rows]) == pytest.approx(
        np.array([row[1:] for row in indices(values, NAMES, 0.9, 2)[0]]), rel=1e-9, abs=1e-12
    )


def test_a_single_row_shows_no_index() -> None:
    rows, why = indices(sample(1, 1), NAMES, 0.9, 1)
    assert not rows
    assert why == "one row has no scatter; give a larger n"
