"""Modes some per cent apart, which one mode between them with more damping nearly explains."""

import numpy as np
import pytest
from tests.lab.identification.shaken import bench, shaken, truth
from tests.representatives import representatives

from flexslew_lab.identification.modal.modes import identify_modes

PLAN = {"band": [0.3, 8.0], "largest_excursion": [0.3]}
GAINS = np.array([20.0]), np.array([60.0])


@pytest.mark.parametrize(
    ("frequencies", "damping", "joints"),
    representatives(
        [
            ((0.987, 1.016, 4.247), 0.01, (0.051, 0.066, 0.094)),  # between them, damped by 1.5 %
            ((3.329, 3.386), 0.002, (0.022, 0.065)),  # a weak one and a strong one
            ((0.7972, 0.8124), 0.002, (0.068, 0.051)),  # 1.5 periods apart over the record
        ],
        ((3.329, 3.386), 0.002, (0.022, 0.065)),
    ),
)
def test_close_modes_are_told_apart_with_intervals_that_hold_the_truth(
    frequencies: tuple[float, ...], damping: float, joints: tuple[float, ...]
) -> None:
    free = [
        {"frequency": w, "damping_ratio": damping, "joints": [p], "tips": [1.0]}
        for w, p in zip(frequencies, joints, strict=True)
    ]
    modes = {"free_modes": free, "modes": len(free)}
    bed = bench(kind="identified", inertia=[[100.0]], effort_limit=[20.0], **modes)
    record = shaken(bed, PLAN, GAINS, np.random.default_rng(1), period=0.05).record
    found = identify_modes(record, (0.3, 8.0))
    true, ratios, inertia = truth(bed)
    assert len(found.modes) == len(true)
    for mode, w, zeta in zip(found.modes, true, ratios, strict=True):
        for told, value in ((mode.frequency, w), (mode.damping_ratio, zeta)):
            # 1.96 standard deviations are half of an interval: none of fourteen is beyond 3.5
            assert abs(told.value - value) < 3.5 / 1.96 * 0.5 * (told.high - told.low)
    assert found.inertia[0][0].value == pytest.approx(inertia[0, 0], rel=3e-3)
    assert all(one.white for one in found.whiteness)
