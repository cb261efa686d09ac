"""The sky: where axes of a platform look, and the cones that they must keep out of."""

from time import monotonic

import numpy as np

from flexslew_lab.console.desk import Desk
from flexslew_lab.console.view import COORDINATES
from flexslew_lab.report.sky_map import drawn_sky
from flexslew_plant.arrays import Matrix

_PERIOD = 1.0  # between two drawings [wall s]
_POINTS = 200  # of a track


class SkyPanel:
    """Draws the sphere of boresights of a testbed that has some.

    Args:
        desk: of the page.
    """

    def __init__(self, desk: Desk) -> None:
        self._view = desk.view
        with desk.gui.middle:
            self._drawn = desk.gui.html(visible=False)
        self._next = 0.0

    def refresh(self) -> None:
        """Draw what has been flown since the last time."""
        now = monotonic()
        if now < self._next:
            return
        self._next = now + _PERIOD
        position = self._view.truth.column(COORDINATES)
        reference = self._view.controller_state.column("reference_position")
        drawn = drawn_sky(self._view.testbed, _some(position), _some(reference))
        self._drawn.visible = bool(drawn)
        self._drawn.content = drawn


def _some(rows: Matrix) -> Matrix:
    """Return as many rows as are drawn, the first and the last among them."""
    if not len(rows):
        return rows
    some: Matrix = rows[np.unique(np.linspace(0, len(rows) - 1, _POINTS).astype(int))]
    return some
