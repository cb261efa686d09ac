"""Times of steps: quantiles to 1 %, exact extremes and jitter, in bounded memory."""

import numpy as np
import pytest

from flexslew_plant.step_times import StepTimes


def test_the_summary_is_that_of_the_times(case: np.random.Generator) -> None:
    times = 1e-3 * case.lognormal(sigma=1.5, size=2000)
    steps, noted = StepTimes(), list[int]()
    for time in times.tolist():
        steps.add(time)
        noted += [found.steps for found in [steps.summary_of_power(500)] if found is not None]
    assert noted == [500, 1000, 2000]
    found = steps.summary()
    assert found is not None
    assert found[:1] + found[4:5] == (2000, times.max())
    assert found.least == times.min()
    assert found.jitter == pytest.approx(times.std(), rel=1e-9)
    for share, value in ((0.5, found.median), (0.99, found.late)):
        exact = np.quantile(times, share, method="inverted_cdf")
        assert value == pytest.approx(exact, rel=0.011)


def test_without_a_step_there_is_no_summary_and_extremes_have_a_bin() -> None:
    steps = StepTimes()
    assert steps.summary() is None
    steps.add(0.0)
    steps.add(1e9)
    found = steps.summary()
    assert found is not None
    assert (found.steps, found.least, found.longest) == (2, 0.0, 1e9)
