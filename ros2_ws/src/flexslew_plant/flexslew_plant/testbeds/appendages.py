"""What the appendages of each testbed show: tip deflection and root curvature from the modes."""

from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np

from flexslew_plant.arrays import Matrix
from flexslew_plant.testbeds import Testbed, csa


class Appendages(NamedTuple):
    """Linear maps from the modal coordinates to what a sensor at each appendage reads."""

    names: tuple[str, ...]
    tip: Matrix  # (appendages, modes) [-]
    curvature: Matrix  # at the root, (appendages, modes) [1/m^2]


def _csa(testbed: Any) -> Appendages:
    """Two beams that bend antisymmetrically (3), so that their tips are opposite in y."""
    root = csa.beam(testbed).shape(np.zeros(1), derivative=2)[:, 0]
    sides = np.array([[1.0], [-1.0]])
    return Appendages(
        ("beam_positive", "beam_negative"), sides * np.ones(testbed.modes), sides * root
    )


def _one_tip(name: str) -> Callable[[Any], Appendages]:
    """One appendage whose mode is its tip deflection; its curvature is not modelled."""
    return lambda testbed: Appendages((name,), np.ones((1, 1)), np.zeros((1, 1)))


_APPENDAGES: dict[str, Callable[[Any], Appendages]] = {
    "csa": _csa,
    "floating_oscillator": _one_tip("spring"),
    "hub_with_appendages": _one_tip("appendage"),
}


def appendages_of(testbed: Testbed) -> Appendages:
    """Return the appendages of a `testbed` section."""
    return _APPENDAGES[testbed.kind](testbed)
