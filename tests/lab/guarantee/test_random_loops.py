"""Certificates of random loops, against dense grids of their parameters."""

import numpy as np

from flexslew_lab.guarantee.box import Box
from flexslew_lab.guarantee.certificate import certify
from flexslew_lab.guarantee.model.uncertain_loop import UncertainLoop
from flexslew_lab.guarantee.search import breakdown

STATES, PARAMETERS = 5, 2
GRID = np.linspace(-1.0, 1.0, 61)


def random_loop(rng: np.random.Generator, scale: float) -> UncertainLoop:
    """Return a stable random loop with two parameters, over a scale of its box."""
    a = rng.normal(size=(STATES, STATES))
    a *= rng.uniform(0.9, 0.99) / abs(np.linalg.eigvals(a)).max()
    slopes = [
        0.1 * rng.normal(size=(STATES, 1)) @ rng.normal(size=(1, STATES)) for _ in range(PARAMETERS)
    ]

    def exact(p: np.ndarray) -> np.ndarray:
        whole = np.zeros((STATES + 1, STATES + 1))
        whole[:-1, :-1] = a + sum(value * s for value, s in zip(p, slopes, strict=True))
        return whole

    def stable(p: np.ndarray) -> bool:
        return bool(abs(np.linalg.eigvals(exact(p)[:-1, :-1])).max() < 1.0)

    box = Box(np.zeros(PARAMETERS), np.full(PARAMETERS, scale))
    return UncertainLoop(box, STATES, exact, stable)


def test_bounds_enclose_the_truth_of_a_dense_grid(case: np.random.Generator) -> None:
    seed = int(case.integers(2**32))
    wide = random_loop(np.random.default_rng(seed), 4.0)
    found = breakdown(wide)
    if found is None:
        assert all(wide.stable(wide.box.at(np.array([x, y]))) for x in GRID for y in GRID)
        return
    upper = 4.0 * found.scale
    assert not wide.stable(found.values)
    certificate = certify(random_loop(np.random.default_rng(seed), 0.95 * upper), seconds=600.0)
    assert certificate.holds
    box = Box(np.zeros(PARAMETERS), np.full(PARAMETERS, 0.95 * upper))
    assert all(wide.stable(box.at(np.array([x, y]))) for x in GRID for y in GRID)
    refuted = certify(random_loop(np.random.default_rng(seed), 1.02 * upper), seconds=5.0)
    assert not refuted.holds
