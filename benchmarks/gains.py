"""Gains found by the bench: the search on M1 beside an exhaustive grid."""

from itertools import product
from time import process_time

import numpy as np

from flexslew_lab.gains.ensemble import GainEnsemble, gains_of
from flexslew_lab.gains.search import search_gains
from flexslew_lab.notebook import trial

_GRID = 25  # points along each gain, over the same range
_BATCH = 25


def figures() -> dict[str, float]:
    """Return what a search finds for `pd_feedforward` on M1, and the best of a grid.

    found, grid, shipped: worst residual at no less than the disk margin of the shipped gains [m].
    found_to_grid: of the two [-]; at most 1.02 was asked for.
    search_s, grid_s: processor time [s].
    """
    what = trial("m1")
    gains = gains_of(what, "m1", None)
    ensemble = GainEnsemble(what, "m1", gains)
    begin = process_time()
    found = search_gains(ensemble, gains)
    middle = process_time()
    axis = 2.0 ** np.linspace(-2.0, 2.0, _GRID)
    points = list(product(axis, axis))
    best = np.inf
    for k in range(0, len(points), _BATCH):
        for outcome in ensemble.outcomes(points[k : k + _BATCH]):
            if outcome.alpha >= found.least and outcome.residual < best:
                best = outcome.residual
    return {
        "found": found.best.outcome.residual,
        "grid": float(best),
        "shipped": found.shipped.residual,
        "found_to_grid": found.best.outcome.residual / float(best),
        "search_s": middle - begin,
        "grid_s": process_time() - middle,
    }
