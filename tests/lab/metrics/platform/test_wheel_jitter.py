"""The line of a wheel that is not balanced, in the spectrum of the attitude."""

import numpy as np
import pytest
from tests.plant.testbeds.spacecraft.test_imbalance import SPEED, WHEEL, J, coasted, craft

from flexslew_lab.metrics.metric import Block, Ending, ReferenceManoeuvre, RunSetup
from flexslew_lab.metrics.platform.jitter import Jitter


def test_the_jitter_of_a_wheel_is_in_the_octave_of_its_harmonic() -> None:
    period, order, size = 0.01, 1.5, 1e-5
    bed = craft({"harmonics": [{"order": order, "torque": size}]}, pointing_window=10.0)
    position, velocity = coasted(bed, period, 30.0)
    metric = Jitter(RunSetup(("wheel",), ReferenceManoeuvre(0.0, 0.0, np.zeros(1), np.zeros(1)),
                             np.ones(1), bed))  # fmt: skip
    ticks = np.arange(len(position))
    time = period * ticks.astype(float)
    none, all_ = np.zeros((len(position), 1)), ticks >= 0
    held = np.full(len(position), period)
    metric.add(Block(ticks, time, held, position, velocity, none, none[:, :0], none,
                     all_, all_))  # fmt: skip
    found = metric.result(Ending([], [], True))
    ends, rms = np.array(found["jitter_frequency"]), np.array(found["jitter"])
    octave = int(np.searchsorted(ends, order * SPEED / (2.0 * np.pi)))
    spin = WHEEL * SPEED / J
    amplitude = size * SPEED**2 / (J * order * SPEED * (order * SPEED - spin))
    for axis in (0, 1):  # ticks of .3 rad of the harmonic: .3^2 / 24 of it lost
        assert rms[axis, octave] == pytest.approx(amplitude / np.sqrt(2.0), rel=0.01)
        others = np.delete(rms[axis], [0, 1, octave])  # the first two have the slow nutation
        assert rms[axis, octave] > 100.0 * others.max()
