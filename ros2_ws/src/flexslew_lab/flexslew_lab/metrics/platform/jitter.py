"""How a platform that points trembles, by frequency."""

from collections.abc import Mapping
from typing import Any, ClassVar

import numpy as np

from flexslew_lab.metrics.metric import Block, Ending, Key, MetricEntry, RunSetup, goal_by_joint
from flexslew_lab.metrics.platform.block_motions import block_motions
from flexslew_plant.arrays import Matrix, Vector
from flexslew_plant.testbeds.contract import Pointing as PointingTestbed

_MIN_TICKS = 16  # ticks of a window, below which it has no spectrum
_MAX_TICKS = 1_000_000  # and beyond which it is not kept


class Jitter:
    """Implements Metric, of a platform that points.

    Welch 1967: the attitude error from the end of the manoeuvre, or `pointing_from`, on is cut into
    windows of `pointing_window`, each less its straight line and times Hann's window; the mean of
    their spectra is summed by octaves. The square of a band's value is the variance of the attitude
    error in that band. Where a tick is missing the window starts again.
    """

    KEYS: ClassVar[Mapping[str, Key]] = {
        "jitter_frequency": Key(
            "Hz",
            False,
            "upper ends of the octaves of `jitter`, the first from 0 on",
            spectrum=True,
        ),
        "jitter": Key(
            "rad",
            False,
            "x y z, by octave: root mean square of the attitude error in it after the manoeuvre's "
            "end, less the straight line of each pointing_window; null: no window is whole",
            spectrum=True,
        ),
        "rms_jitter": Key(
            "rad", False, "x y z: the same over all octaves; null: no window is whole", axes=True
        ),
    }

    def __init__(self, setup: RunSetup) -> None:
        known: Any = setup.testbed
        self._testbed: PointingTestbed = known
        self._goal = goal_by_joint(setup)
        self._from = max(setup.manoeuvre.end, self._testbed.pointing_from) - 1e-9  # [s]
        self._period = 0.0  # of a tick [s]
        self._size = 0  # ticks of a window; 0: not known yet
        self._last = -1  # tick
        self._open: list[Matrix] = []  # parts of the window that is open
        self._tick_count = 0  # ticks in it
        self._sum: Matrix | None = None  # of the spectra, (frequencies, 3)
        self._windows = 0

    def add(self, block: Block) -> None:
        """Take the next ticks."""
        counts = (block.time >= self._from) & (block.held > 0.0)  # a run's first tick has no length
        if not counts.any():
            return
        error = block_motions(self._testbed, block, self._goal).attitude
        error, ticks = error[counts], block.tick[counts]
        if not self._size:
            self._period = float(block.held[counts][0])
            size = self._testbed.pointing_window / self._period
            self._size = round(size) if _MIN_TICKS <= size <= _MAX_TICKS else -1
        if self._size < 0:
            return
        gaps = np.flatnonzero(np.diff(ticks.astype(np.int64)) != 1) + 1
        if self._last >= 0 and int(ticks[0]) != self._last + 1:
            self._begin()
        for k, part in enumerate(np.split(error, gaps)):
            if k:
                self._begin()
            self._take(part)
        self._last = int(ticks[-1])

    def _begin(self) -> None:
        self._open, self._tick_count = [], 0

    def _take(self, error: Matrix) -> None:
        """Take ticks without a gap."""
        while len(error):
            part = error[: self._size - self._tick_count]
            self._open.append(part)
            self._tick_count += len(part)
            error = error[len(part) :]
            if self._tick_count == self._size:
                whole = np.concatenate(self._open)
                from scipy.signal import detrend, periodogram  # slow to import

                level = detrend(whole, axis=0)
                _, spectrum = periodogram(level, 1.0 / self._period, "hann", detrend=False, axis=0)
                self._sum = spectrum if self._sum is None else self._sum + spectrum
                self._windows += 1
                self._begin()

    def result(self, ending: Ending) -> dict[str, Any]:
        """Return the root mean squares by body axis and octave."""
        if self._sum is None:
            return dict.fromkeys(self.KEYS)
        step = 1.0 / (self._size * self._period)
        ends, rms = by_octave(self._sum / self._windows * step, step)
        return {
            "jitter_frequency": ends.tolist(),
            "jitter": rms.T.tolist(),
            "rms_jitter": np.linalg.norm(rms, axis=0).tolist(),
        }


def by_octave(power: Matrix, step: float) -> tuple[Vector, Matrix]:
    """Return the upper ends of octaves [Hz] and the root of the power in each.

    Args:
        power: at the frequencies 0, step, 2 step and so on, shape (frequencies, columns).
        step: between them [Hz].

    Returns:
        shapes (octaves,) and (octaves, columns). A band ends half-way between two frequencies, the
        first with the four lowest ones.
    """
    counts = [4]
    while counts[-1] < len(power):
        counts.append(2 * counts[-1])
    starts = [0, *counts[:-1]]
    sums = np.add.reduceat(power, starts, axis=0)
    last = len(power)
    ends = (np.minimum(counts, last) - 0.5) * step
    return ends, np.sqrt(sums)


JITTER = MetricEntry(Jitter, of=PointingTestbed)
