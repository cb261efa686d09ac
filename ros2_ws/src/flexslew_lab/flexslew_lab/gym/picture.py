"""The testbed as it is bent, from above and from the side, as an array or in a window."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from flexslew_lab.console.picture import body
from flexslew_plant.arrays import Vector
from flexslew_plant.extras import required
from flexslew_plant.testbeds import Testbed

_VIEWS = (("from above", 0, 1), ("from the side", 0, 2))
_SIZE, _DOTS = (8.0, 4.0), 80  # width and height [inch], dots in an inch
_MARGIN = 1.1
_PAUSE = 1e-3  # in which a window shows what was drawn [s]


class ScenePicture:
    """Draws with Matplotlib.

    Args:
        testbed: that is drawn.
        shown: whether in a window.

    Raises:
        ModuleNotFoundError: Matplotlib is not installed.
    """

    def __init__(self, testbed: Testbed, shown: bool) -> None:
        required("matplotlib")
        self._scene, self._shown, self._reach = testbed.scene(), shown, 0.0
        if shown:
            from matplotlib import pyplot

            self._figure: Any = pyplot.figure(figsize=_SIZE, dpi=_DOTS)
            pyplot.ion()
        else:
            from matplotlib.backends.backend_agg import FigureCanvasAgg
            from matplotlib.figure import Figure

            self._figure = Figure(figsize=_SIZE, dpi=_DOTS)
            FigureCanvasAgg(self._figure)

    def draw(self, q: Vector, t: float) -> NDArray[np.uint8] | None:
        """Return the picture at positions q and a time [s], (height, width, 3); shown: None."""
        geometry, figure = body(self._scene, q, t), self._figure
        figure.clear()
        places = np.array([place for _, place in geometry.poses.values()]).reshape(-1, 3)
        points = np.concatenate((places, *geometry.lines))
        self._reach = reach = max(self._reach, _MARGIN * float(np.abs(points).max(initial=1.0)))
        for axes, (name, x, y) in zip(figure.subplots(1, 2), _VIEWS, strict=True):
            for line in geometry.lines:
                axes.plot(line[:, x], line[:, y], lw=2.0, color="tab:blue")
            axes.plot(places[:, x], places[:, y], "o", ms=4.0, color="tab:gray")
            axes.set(xlim=(-reach, reach), ylim=(-reach, reach), aspect="equal")
            axes.set_title(f"{name}, {t:.2f} s")
        if self._shown:
            from matplotlib import pyplot

            pyplot.pause(_PAUSE)
            return None
        figure.canvas.draw()
        return np.asarray(figure.canvas.buffer_rgba())[:, :, :3].copy()

    def close(self) -> None:
        """Close the window."""
        if self._shown:
            from matplotlib import pyplot

            pyplot.close(self._figure)
