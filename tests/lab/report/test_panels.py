"""Panels of a page."""

import numpy as np
import pytest

from flexslew_lab.report.panels import Panel, style


@pytest.mark.parametrize(
    ("unit", "size", "flat"),
    [
        ("m", 1e-17, True),
        ("rad", 1e-15, True),
        ("m", 0.0, True),
        ("m", 1e-9, False),
        ("", 1e-17, False),
    ],
)
def test_rounding_of_what_has_not_moved_is_drawn_flat(unit: str, size: float, flat: bool) -> None:
    panel = Panel("platform position error", unit)
    time = np.linspace(0.0, 1.0, 50)
    panel.line(time, np.full(50, np.nan), "y", style(1))
    panel.line(time, size * np.cos(9.0 * time), "x", style(0))
    low, high = panel.layout([], False)["yaxis"].get("range", (None, None))
    assert (low is not None and high - low > 100.0 * size) == flat
