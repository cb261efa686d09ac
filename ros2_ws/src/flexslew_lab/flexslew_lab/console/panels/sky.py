"""The sky: where axes of a platform look, and the cones that they must keep out of."""

from time import monotonic

import numpy as np

from flexslew_lab.console.desk import PanelContext
from flexslew_lab.console.view import COORDINATES
from flexslew_lab.report.sky_map import testbed_sky_map
from flexslew_plant.arrays import Matrix

_PERIOD = 1.0  # between two drawings [wall s]
_POINTS = 200  # of a track


class SkyPanel:
    """Draws the sphere of boresights of a testbed that has some.

    Args:
        context: of the page.
    """

    def __init__(self, context: PanelContext) -> None:
        self._view = context.view
        with context.gui.middle:
            self._sky_element = context.gui.html(visible=False)
        self._next = 0.0

    def refresh(self) -> None:
        """Draw what has been flown since the last time."""
        now = monotonic()
        if now < self._next:
            return
        self._next = now + _PERIOD
        position = self._view.truth.column(COORDINATES)
        reference = self._view.controller_state.column("reference_position")
        content = testbed_sky_map(self._view.testbed, _some(position), _some(reference))
        self._sky_element.visible = bool(content)
        self._sky_element.content = content


def _some(rows: Matrix) -> Matrix:
    """Return as many rows as are drawn, the first and the last among them."""
    if not len(rows):
        return rows
    some: Matrix = rows[np.unique(np.linspace(0, len(rows) - 1, _POINTS).astype(int))]
    return some
