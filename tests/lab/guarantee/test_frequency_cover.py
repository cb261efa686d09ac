"""All frequencies are covered, or the uncovered one is named."""

import numpy as np
import pytest

from flexslew_lab.guarantee.scalings.delta_blocks import DeltaBlocks
from flexslew_lab.guarantee.scalings.frequency_cover import LoopChannels, cover
from flexslew_lab.guarantee.scalings.multipliers import Scalings

DISTANCE = 1e-6  # of the pole from the unit circle
ANGLE = 0.777


def resonance(peak: float) -> LoopChannels:
    """Return a resonance at ANGLE whose gain is above half of its peak over about 2e-6 rad."""
    turn = np.array([[np.cos(ANGLE), np.sin(ANGLE)], [-np.sin(ANGLE), np.cos(ANGLE)]])
    one = LoopChannels((1.0 - DISTANCE) * turn, np.eye(2)[:, :1], np.eye(2)[:1], np.zeros((1, 1)))
    angles = ANGLE + DISTANCE * np.linspace(-5.0, 5.0, 10_001)
    return LoopChannels(one.a, one.b, one.c * peak / abs(one.at(angles)).max(), one.d)


def test_a_resonance_between_grid_points_is_not_missed() -> None:
    scalings = Scalings(DeltaBlocks((), ((1, 1),)))
    grid = np.linspace(0.0, np.pi, 2000)
    assert abs(resonance(1.01).at(grid)).max() < 0.01  # a grid does not show it
    open_at = cover(resonance(1.01), scalings, []).open_at
    assert open_at == pytest.approx(ANGLE, abs=1e-5)
    assert cover(resonance(0.99), scalings, []).open_at is None


def test_arcs_overlap_and_hold_within() -> None:
    channels = resonance(0.9)
    arcs = sorted(cover(channels, Scalings(DeltaBlocks((1,))), []).arcs, key=lambda arc: arc.low)
    assert arcs[0].low < 0.0
    assert max(arc.high for arc in arcs) > np.pi
    reached = 0.0
    for arc in arcs:
        assert arc.low < reached or reached == 0.0
        reached = max(reached, arc.high)
        inside = np.linspace(max(arc.low, 0.0), min(arc.high, np.pi), 12)[1:-1]
        assert np.linalg.eigvalsh(arc.multiplier.phi(channels.at(inside))).max() < 0.0
