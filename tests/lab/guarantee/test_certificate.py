"""Certificates that end early name what they have reached, and never hold."""

import numpy as np
import pytest

from flexslew_lab.guarantee.box import Box
from flexslew_lab.guarantee.certificate import certify
from flexslew_lab.guarantee.model.uncertain_loop import GainLimit, UncertainLoop
from flexslew_lab.guarantee.scalings.multipliers import MOST_UNKNOWNS

STATES = 12


def loop_of(parameters: int) -> UncertainLoop:
    """Return a stable loop in which every parameter acts on all states."""
    rng = np.random.default_rng(7)
    slopes = 0.01 * rng.normal(size=(parameters, STATES, STATES))

    def exact(p: np.ndarray) -> np.ndarray:
        whole = np.zeros((STATES + 1, STATES + 1))
        whole[:-1, :-1] = 0.5 * np.eye(STATES) + np.tensordot(p, slopes, 1)
        return whole

    def stable(p: np.ndarray) -> bool:
        return bool(abs(np.linalg.eigvals(exact(p)[:-1, :-1])).max() < 1.0)

    return UncertainLoop(Box(np.zeros(parameters), np.ones(parameters)), STATES, exact, stable)


def test_too_many_scalings_are_named() -> None:
    unknowns = 2 * 4 * STATES**2
    assert unknowns > MOST_UNKNOWNS
    found = certify(loop_of(4), seconds=600.0)
    assert not found.holds
    assert f"{unknowns} scalings of {STATES} states and 4 parameters are too many" in found.ended


def test_cells_certify_what_has_too_many_scalings() -> None:
    found = certify(loop_of(3), seconds=600.0)
    assert found.holds
    assert not found.ended


@pytest.mark.parametrize("parameters", [1, 4])
@pytest.mark.parametrize("gain", [None, GainLimit(10.0)])
def test_no_time_is_no_certificate(parameters: int, gain: GainLimit | None) -> None:
    found = certify(loop_of(parameters), gain, seconds=0.0)
    assert not found.holds
    assert found.unstable is None
    assert found.ended
