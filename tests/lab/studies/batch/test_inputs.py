"""What the members of a group are given."""

from typing import Any

import numpy as np
import pytest

from flexslew_lab.studies.batch.inputs import tips_measured
from flexslew_plant.testbeds import read_testbed

SHARES: list[tuple[Any, int]] = [
    ([[1.0, 2.0], [-1.0, -2.0]], 1),
    ([[1.0, 2.0], [1.0, -2.0]], 2),
    ([[1.0, 2.0], [1.0, 2.0], [2.0, 1.0], [-2.0, -1.0], [0.0, 0.0]], 3),
    (np.zeros((2, 0)), 0),
]


@pytest.mark.parametrize(("shares", "count"), SHARES)
def test_no_tip_bends_further_than_those_that_are_measured(shares: Any, count: int) -> None:
    tip = np.array(shares)
    bent = abs(tip @ np.random.default_rng(4).standard_normal((tip.shape[1], 100)))
    assert tips_measured(tip) == count
    assert np.array_equal(bent[:count].max(axis=0, initial=0.0), bent.max(axis=0))


def test_of_beams_that_bend_against_each_other_one_is_measured() -> None:
    assert tips_measured(read_testbed({"kind": "csa"}, "test").model().appendages.tip) == 1
