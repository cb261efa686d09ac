import numpy as np
import pytest
from scipy import stats
from scipy.stats import qmc

from flexslew_lab.studies.sampling.distributions import FAMILIES, Distribution, distribution_of
from flexslew_lab.studies.sampling.methods import METHODS, Sampling, draw_samples, replicates_of
from flexslew_plant.settings import validated

UNIT = Distribution("uniform", (0.0, 1.0))
ARGUMENTS = {
    "uniform": [-1.0, 3.0],
    "loguniform": [1e-5, 1e-3],
    "normal": [1.0, 0.5],
    "truncated_normal": [1.0, 0.5, 0.2, 1.4],
    "triangular": [0.0, 0.2, 1.0],
    "choice": [1, 2, 4],
}


@pytest.mark.parametrize("family", list(FAMILIES))
def test_every_family_is_the_inverse_of_its_distribution(family: str) -> None:
    spread = distribution_of({family: ARGUMENTS[family]}, "test")
    unit = (np.arange(999) + 0.5) / 999
    values = spread.at(unit)
    assert (np.diff(values) >= 0.0).all()
    assert len(spread.levels(5)) == (3 if family == "choice" else 5)
    assert np.isfinite(spread.levels(5).astype(float)).all()
    references = {
        "uniform": stats.uniform(-1.0, 4.0),
        "loguniform": stats.loguniform(1e-5, 1e-3),
        "normal": stats.norm(1.0, 0.5),
        "truncated_normal": stats.truncnorm(-1.6, 0.8, loc=1.0, scale=0.5),
        "triangular": stats.triang(0.2),
    }
    if family in references:
        assert references[family].cdf(values) == pytest.approx(unit, abs=1e-9)
    else:
        assert np.unique_counts(values).counts.tolist() == [333, 333, 333]


@pytest.mark.parametrize("method", ["random", "lhs", "sobol", "grid", "saltelli"])
def test_the_same_seed_draws_the_same_samples_and_another_one_others(method: str) -> None:
    s = validated(Sampling, {"method": method, "n": 16}, "test")
    first, again, other = (draw_samples(s, [UNIT] * 3, seed) for seed in (5, 5, 6))
    assert np.array_equal(first.unit, again.unit)
    assert method == "grid" or not np.array_equal(first.unit, other.unit)


@pytest.mark.parametrize("replicates", [1, 4, 8])
def test_every_replicate_of_sobol_is_balanced_and_so_is_each_beginning(replicates: int) -> None:
    found = draw_samples(Sampling(method="sobol", n=256, replicates=replicates), [UNIT] * 3, 2)
    for k in range(replicates):
        part = found.unit[found.replicate == k]
        for first in (8, 32):
            for column in part[:first].T:
                assert np.bincount((column * first).astype(int)).tolist() == [1] * first
    assert len({tuple(found.unit[found.replicate == k][0]) for k in range(replicates)}) == (
        replicates
    )


def test_every_replicate_of_lhs_is_a_latin_hypercube() -> None:
    s = Sampling(method="lhs", n=103)
    found = draw_samples(s, [UNIT] * 2, 2)
    assert replicates_of(s) == 16
    for k in range(16):
        part = found.unit[found.replicate == k]
        for column in part.T:
            assert sorted((column * len(part)).astype(int)) == list(range(len(part)))


def test_a_grid_holds_every_pair_of_levels() -> None:
    found = draw_samples(Sampling(method="grid", n=4), [UNIT, Distribution("choice", (1, 2))], 0)
    pairs = set(zip(*(c.tolist() for c in found.values), strict=True))
    assert len(pairs) == 8
    assert {x for x, _ in pairs} == {0.0, 1.0 / 3.0, 2.0 / 3.0, 1.0}


def test_saltelli_exchanges_one_column_after_the_other() -> None:
    found = draw_samples(Sampling(method="saltelli", n=8), [UNIT] * 3, 1).unit.reshape(5, 8, 3)
    a, b = found[:2]
    for j in range(3):
        assert np.array_equal(found[2 + j][:, j], b[:, j])
        others = [k for k in range(3) if k != j]
        assert np.array_equal(found[2 + j][:, others], a[:, others])


def test_sobol_is_more_even_than_random() -> None:
    random = draw_samples(Sampling(method="random", n=256), [UNIT] * 2, 1)
    sobol = draw_samples(Sampling(method="sobol", n=256, replicates=1), [UNIT] * 2, 1)
    assert qmc.discrepancy(sobol.unit) < 0.1 * qmc.discrepancy(random.unit)


def test_bounds_are_claimed_for_independent_or_replicated_samples_only() -> None:
    assert [m for m, kind in METHODS.items() if kind.independent] == ["random"]
    assert [m for m, kind in METHODS.items() if kind.replicated] == ["lhs", "sobol"]
