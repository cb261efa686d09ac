"""Trials flown in lanes and by the bench, for tests that hold the two beside each other."""

import pytest

from flexslew_lab.studies.cases import case_of
from flexslew_lab.studies.flight import flown
from flexslew_lab.studies.lanes.fleet import Lanes
from flexslew_lab.studies.run import Preparation

TOLERANCE = 1e-9  # of a metric, or of one where it is smaller


def require_equal(ready: Preparation, numbers: list[int]) -> None:
    """Fly the trials both ways and compare every metric."""
    cases = [case_of(ready.study, ready.samples, k) for k in numbers]
    results = [r for some, _ in Lanes(ready.study, ready.plans).fly(cases) for r in some]
    assert [r.number for r in results] == numbers
    for result, case in zip(results, cases, strict=True):
        bench = flown(ready.study, case, ready.plans)
        assert (result.status, result.way) == ("ok", "lanes")
        for name, value in bench.metrics.items():
            ours = result.metrics[name]
            if value is None:
                assert ours is None, name
            else:
                assert ours == pytest.approx(value, rel=TOLERANCE, abs=TOLERANCE), name
