"""Trials flown in a batch and by the bench, for tests that hold the two beside each other."""

from typing import Any

import pytest

from flexslew_lab.studies.batch.fleet import BatchRunner
from flexslew_lab.studies.cases import case_of
from flexslew_lab.studies.flight import simulate_case
from flexslew_lab.studies.run import PreparedStudy
from flexslew_lab.studies.ways import Way

CRAFT: dict[str, Any] = {
    "kind": "spacecraft",
    "platform": {"mass": 150.0, "inertia": {"xx": 40.0, "yy": 35.0, "zz": 30.0, "xy": 1.0}},
    "appendages": {
        "boom": {
            "hinge": {"place": [0.0, 0.5, 0.1]},
            "shape": {
                "kind": "beam",
                "length": 6.0,
                "linear_density": 0.4,
                "bending_stiffness": 300.0,
                "modes": 2,
            },
            "damping": {"ratio": 0.02},
        }
    },
    "actuators": {},
    "wheels": {"roll": {"axis": [1.0, 0.0, 0.0], "inertia": 0.05, "limit": 20.0}},
}
TOLERANCE = 1e-9  # of a metric, or of one where it is smaller


def require_equal(ready: PreparedStudy, numbers: list[int], status: str = "ok") -> None:
    """Fly the trials both ways and compare every metric; `failed`: and why they have none."""
    cases = [case_of(ready.study, ready.samples, k) for k in numbers]
    results = [r for some, _ in BatchRunner(ready.study, ready.plans).fly(cases) for r in some]
    results.sort(key=lambda result: result.number)
    assert [r.number for r in results] == numbers
    for result, case in zip(results, cases, strict=True):
        bench = simulate_case(ready.study, case, ready.plans)
        assert (result.status, result.way) == (status, "batch")
        assert (bench.status, bench.reason) == (status, result.reason)
        for name, value in bench.metrics.items():
            ours = result.metrics[name]
            if value is None:
                assert ours is None, name
            else:
                assert ours == pytest.approx(value, rel=TOLERANCE, abs=TOLERANCE), name


def ways_of(ready: PreparedStudy, count: int) -> list[Way]:
    """Return how the first trials are flown."""
    cases = [case_of(ready.study, ready.samples, k) for k in range(count)]
    ways: dict[int, Way] = {}
    for some, others in BatchRunner(ready.study, ready.plans).fly(cases):
        ways |= {one.number: Way.BATCH for one in some}
        ways |= {one.case.number: one.way for one in others}
    return [ways[k] for k in range(count)]
