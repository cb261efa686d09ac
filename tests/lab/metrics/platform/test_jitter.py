"""Jitter of a known motion: sines and noise have their power where they tremble."""

from typing import Any

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from tests.lab.metrics.blocks import ticks_of

from flexslew_lab.metrics.metric import Block, Ending, ReferenceManoeuvre, RunSetup
from flexslew_lab.metrics.platform.jitter import Jitter, by_octave
from flexslew_plant.arrays import Indices, Matrix
from flexslew_plant.testbeds import read_testbed

WINDOW, END, PERIOD = 20.0, 3.0, 0.05  # [s]
CRAFT = read_testbed({"kind": "spacecraft", "appendages": {}, "pointing_window": WINDOW}, "here")
TIME = np.arange(0.0, 200.0, PERIOD)


def measured(error: Matrix, ticks: Indices | None = None, cuts: tuple[int, ...] = ()) -> Any:
    """Return what the metric says of small errors, shape (times, 3), from a goal."""
    model, goal = CRAFT.model(), Rotation.from_rotvec([0.3, -0.8, 1.1])
    position = np.zeros((len(error), model.positions))
    position[:, 3:7] = (goal * Rotation.from_rotvec(error)).as_quat()
    aim = ReferenceManoeuvre(0.0, END, goal.as_rotvec(), np.zeros(3))
    metric = Jitter(RunSetup(tuple(model.joint_names), aim, np.ones(3), CRAFT))
    numbers = np.arange(len(error)) if ticks is None else ticks
    time, none = numbers.astype(float) * PERIOD, np.zeros((len(error), 3))
    held = np.full(len(error), PERIOD)
    held[0] = 0.0
    block = Block(
        numbers, time, held, position, np.zeros((len(error), model.coordinates)), none,
        none[:, :0], none, time >= 0.0, time >= END - 1e-9,
    )  # fmt: skip
    for first, last in zip([0, *cuts], [*cuts, len(error)], strict=True):
        metric.add(ticks_of(block, first, last))
    return metric.result(Ending([], [], True))


@pytest.mark.parametrize("seed", range(4))
def test_a_sine_on_a_drift_is_in_its_octave_alone(seed: int) -> None:
    rng = np.random.default_rng(seed)
    error = np.zeros((len(TIME), 3))
    expected, amplitudes = [], rng.uniform(1e-6, 1e-4, 3)
    for k, octave in enumerate(rng.choice(np.arange(2, 7), 3, replace=False).tolist()):
        low, high = 4 * 2 ** (octave - 1), min(4 * 2**octave, 200)
        line = int(rng.integers(low + 2, high - 2))  # Hann's window spreads it to both sides
        error[:, k] = amplitudes[k] * np.sin(2.0 * np.pi * line / WINDOW * TIME + rng.uniform(0, 6))
        expected.append(octave)
    drift = 1e-5 * np.linspace(-1.0, 1.0, len(TIME))
    found = measured(error + drift[:, None])
    ends = np.array(found["jitter_frequency"])
    np.testing.assert_allclose(ends[:-1], (4.0 * 2.0 ** np.arange(ends.size - 1) - 0.5) / WINDOW)
    for k, octave in enumerate(expected):
        row = np.array(found["jitter"][k])
        assert row[octave] == pytest.approx(amplitudes[k] / np.sqrt(2.0), rel=2e-3)
        # the line that fits a sine of few periods is no sine: a thousandth of the power
        assert np.delete(row, octave).max() < 4e-2 * row[octave]


def test_of_white_noise_every_octave_has_its_share_of_the_variance() -> None:
    error = 1e-5 * np.random.default_rng(3).standard_normal((len(TIME), 3))
    found = measured(error)
    rms, ends = np.array(found["jitter"]), np.array(found["jitter_frequency"])
    widths = np.diff(ends, prepend=0.0) / ends[-1]
    assert np.sqrt((rms**2).sum(axis=1)) == pytest.approx(1e-5, rel=0.03)
    assert (rms[:, -3:] / 1e-5) ** 2 == pytest.approx(
        np.tile(widths[-3:], (3, 1)), rel=0.15
    )  # 9 windows of more than 60 lines: 1 / sqrt(540)


def test_it_does_not_depend_on_blocks_and_a_gap_begins_a_window_anew() -> None:
    rng = np.random.default_rng(5)
    error = 1e-5 * rng.standard_normal((len(TIME), 3)).cumsum(axis=0)
    whole = measured(error)
    for _ in range(3):
        cuts = tuple(sorted(rng.choice(np.arange(1, len(TIME)), 6, replace=False).tolist()))
        assert measured(error, cuts=cuts) == whole
    size, first = round(WINDOW / PERIOD), round(END / PERIOD)
    kept = np.r_[: first + size + 7, first + size + 20 : first + 2 * size + 20]
    one = measured(error[: first + size])["jitter"]
    two = measured(error[np.r_[:first, first + size + 20 : first + 2 * size + 20]])["jitter"]
    both = measured(error[kept], kept)["jitter"]
    np.testing.assert_allclose(np.square(both), (np.square(one) + np.square(two)) / 2.0)


def test_without_a_whole_window_there_is_none() -> None:
    assert set(measured(np.zeros((100, 3))).values()) == {None}


@pytest.mark.parametrize("lines", [4, 5, 8, 9, 33, 1000])
def test_octaves_leave_no_line_out(lines: int) -> None:
    power = np.random.default_rng(lines).uniform(size=(lines, 2))
    ends, rms = by_octave(power, 0.1)
    np.testing.assert_allclose((rms**2).sum(axis=0), power.sum(axis=0))
    assert ends[-1] == pytest.approx((lines - 0.5) * 0.1)
    assert (np.diff(ends) > 0.0).all()
