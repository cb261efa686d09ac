from math import inf
from typing import Any

import numpy as np
import pytest
from scipy import stats

from flexslew_lab.studies.findings.population import Population
from flexslew_lab.studies.findings.replicates import scatter
from flexslew_lab.studies.findings.statistics import (
    dkw_half_width,
    quantile,
    quantile_bounds,
    sign_test,
    success_bounds,
    trials_needed,
)


def success_bound(successes: int, n: int, confidence: float) -> float:
    return success_bounds(successes, n, confidence)[0]


def test_852_trials_without_a_failure_show_three_sigma_at_90_percent() -> None:
    assert trials_needed(0.9973, 0.9) == 852
    assert success_bound(852, 852, 0.9) >= 0.9973 > success_bound(851, 851, 0.9)


@pytest.mark.parametrize("probability", [0.5, 0.9, 0.99])
@pytest.mark.parametrize("failures", [0, 1, 3])
def test_trials_needed_are_the_fewest_whose_bound_is_high_enough(
    probability: float, failures: int
) -> None:
    n = trials_needed(probability, 0.95, failures)
    assert success_bound(n - failures, n, 0.95) >= probability
    assert success_bound(n - 1 - failures, n - 1, 0.95) < probability


def test_the_success_bound_is_that_of_scipy_s_exact_test() -> None:
    for successes, n in ((0, 5), (3, 7), (99, 100), (100, 100)):
        exact = stats.binomtest(successes, n, alternative="greater").proportion_ci(0.9, "exact")
        assert success_bound(successes, n, 0.9) == pytest.approx(exact.low, abs=1e-12)


@pytest.mark.parametrize("n", [1, 20, 300])
@pytest.mark.parametrize("p", [0.02, 0.5, 0.9, 0.9973])
def test_a_success_bound_is_below_the_probability_as_often_as_it_says(n: int, p: float) -> None:
    """Exactly: summed over all that n trials can show."""
    k = np.arange(n + 1)
    holds = np.array([success_bound(int(successes), n, 0.9) <= p for successes in k])
    assert stats.binom.pmf(k, n, p)[holds].sum() >= 0.9 - 1e-12


@pytest.mark.parametrize("n", [20, 300])
@pytest.mark.parametrize("q", [0.5, 0.9])
def test_simulated_quantiles_lie_in_their_bounds(n: int, q: float) -> None:
    """Of a skewed distribution, whose quantile is known, 500 times over."""
    rng, truth = np.random.default_rng(23), float(stats.lognorm(1.0).ppf(q))
    found = [quantile_bounds(rng.lognormal(size=n), q, 0.9) for _ in range(500)]
    inside = np.mean([low <= truth <= high for low, high in found])
    assert inside >= 0.9 - 3.0 * np.sqrt(0.09 / 500)


@pytest.mark.parametrize("n", [5, 40, 300])
@pytest.mark.parametrize("q", [0.05, 0.5, 0.9, 0.99])
def test_order_statistics_cover_the_quantile_as_often_as_they_say(n: int, q: float) -> None:
    """Exactly: the ranks of uniform samples are binomial, so no chance is in this test."""
    values = np.arange(1.0, n + 1.0)
    low, high = quantile_bounds(values, q, 0.9)
    rank_low = 0 if low == -inf else int(low)
    rank_high = n + 1 if high == inf else int(high)
    below = stats.binom.cdf(rank_low - 1, n, q)  # fewer than l samples under it: X_(l) is above
    above = stats.binom.sf(rank_high - 1, n, q)
    assert below <= 0.05 + 1e-12
    assert above <= 0.05 + 1e-12
    assert stats.binom.cdf(rank_low, n, q) > 0.05 - 1e-12  # the next one would cover too little
    assert rank_high == 1 or stats.binom.sf(rank_high - 2, n, q) > 0.05 - 1e-12


def test_bounds_agree_with_scipy_s_test_of_a_quantile() -> None:
    values = np.random.default_rng(3).standard_normal(500)
    # its stub says float
    interval: Any = stats.quantile_test(values, p=0.9).confidence_interval(0.95)
    low, high = quantile_bounds(values, 0.9, 0.95)
    ordered = np.sort(values).tolist()
    assert abs(ordered.index(low) - ordered.index(interval.low)) <= 1
    assert abs(ordered.index(high) - ordered.index(interval.high)) <= 1


def test_a_quantile_is_a_sample_that_a_share_does_not_exceed() -> None:
    values = np.array([4.0, 1.0, 3.0, 2.0])
    assert [quantile(values, q) for q in (0.25, 0.26, 0.5, 0.75, 0.99)] == [1, 2, 2, 3, 4]


def test_failures_stand_at_the_far_end_and_take_the_upper_bound_with_them() -> None:
    values = np.concatenate((np.linspace(0.0, 1.0, 95), np.full(5, inf)))
    found = Population(values).quantile(0.9, 0.9)
    assert found.estimate is not None
    assert found.high is None  # unbounded
    assert Population(values).quantile(0.99, 0.9).estimate is None
    assert Population(values).mean(0.9).estimate is None


def test_a_dkw_band_holds_for_nine_of_ten_samples() -> None:
    rng = np.random.default_rng(11)
    n, inside = 60, 0
    for _ in range(400):
        u = np.sort(rng.random(n))
        worst = max((np.arange(1, n + 1) / n - u).max(), (u - np.arange(n) / n).max())
        inside += worst <= dkw_half_width(n, 0.9)
    assert success_bound(inside, 400, 0.999) <= 0.9 + 0.1
    assert inside / 400 >= 0.9 - 3.0 * np.sqrt(0.09 / 400)


def test_replicates_bound_a_mean_as_often_as_they_say() -> None:
    """Of unequal sizes, and with an offset of their own: the ratio estimate."""
    rng, inside = np.random.default_rng(5), 0
    parts = np.repeat(np.arange(8), [9, 9, 10, 10, 10, 10, 10, 11])
    for _ in range(1000):
        values = rng.random(len(parts)) + rng.standard_normal(8)[parts]
        found = scatter(values, parts)
        assert found.mean == pytest.approx(values.mean())
        inside += abs(found.mean - 0.5) <= found.margin(0.9)
    assert abs(inside / 1000 - 0.9) < 3.0 * np.sqrt(0.09 / 1000)


def test_the_sign_test_is_that_of_scipy() -> None:
    for larger, smaller in ((0, 5), (3, 7), (40, 60), (50, 50), (1, 0)):
        exact = stats.binomtest(larger, larger + smaller, 0.5).pvalue
        assert sign_test(larger, smaller) == pytest.approx(exact, rel=1e-9)
    assert sign_test(0, 0) == 1.0


def test_the_upper_bound_of_success_is_the_lower_one_of_failure() -> None:
    for successes, n in ((0, 5), (3, 7), (129, 200), (7, 7)):
        _, high = success_bounds(successes, n, 0.9)
        assert high == pytest.approx(1.0 - success_bounds(n - successes, n, 0.9)[0], abs=1e-12)


def test_one_replicate_and_a_grid_have_no_bounds() -> None:
    values = np.linspace(0.0, 1.0, 16)
    kept = values < 2.0
    for population in (
        Population(values, np.zeros(16, dtype=np.int32)),
        Population(values, bounded=False),
    ):
        assert population.quantile(0.5, 0.9)[::2] == (None, None)
        assert population.mean(0.9)[::2] == (None, None)
        assert population.success(kept, 0.9).low is None
        assert population.success(kept, 0.9).estimate == 1.0


def test_replicates_never_show_more_than_as_many_independent_trials() -> None:
    kept = np.ones(512, dtype=bool)
    replicated = Population(np.zeros(512), np.repeat(np.arange(8, dtype=np.int32), 64))
    assert replicated.success(kept, 0.9).low == success_bound(512, 512, 0.9)
    kept[:60] = False  # all in one replicate: they disagree
    low = replicated.success(kept, 0.9).low
    assert low is not None
    assert low < success_bound(452, 512, 0.9)


@pytest.mark.parametrize("unit", [2.0**-1020, 2.0**-600, 2.0**600, 2.0**1020])
@pytest.mark.parametrize("parts", [None, np.repeat(np.arange(4, dtype=np.int32), 5)])
def test_a_mean_has_the_same_bounds_in_units_whose_squares_are_no_numbers(
    unit: float, parts: Any
) -> None:
    values = np.random.default_rng(1).normal(1.0, 0.5, size=20)
    plain, large = (Population(size * values, parts).mean(0.9) for size in (1.0, unit))
    assert [end / unit for end in large if end is not None] == list(plain)
