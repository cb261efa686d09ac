"""Efforts that were sampled but not held are those of a band-limited signal."""

from pathlib import Path

import numpy as np
import pytest
from tests.lab.identification.disturbed import spring_record
from tests.lab.identification.shaken import bench, shaken

from flexslew_lab.identification.identification import identify
from flexslew_lab.identification.records.file_experiment import FileColumns, experiment_of_file
from flexslew_lab.identification.records.hold import Hold, acts_as_held
from flexslew_plant.arrays import Vector
from flexslew_plant.errors import BadInput

PERIOD, TICKS = 0.0016, 4096
FREQUENCY, RATIO = 437.0, 0.05  # an eighth of the sampling rate: half a tick is 20 degrees


def multisine(seed: int) -> tuple[Vector, Vector, Vector]:
    """Return times, an effort without parts above half of half the rate, and an exact response."""
    rng = np.random.default_rng(seed)
    t = PERIOD * np.arange(TICKS, dtype=np.float64)
    w = 2.0 * np.pi * np.fft.rfftfreq(TICKS, PERIOD)
    lines = (w > 0.0) & (w < 0.5 * np.pi / PERIOD)
    spectrum = np.where(lines, np.exp(2j * np.pi * rng.uniform(size=len(w))), 0.0)
    response = 1.0 / (FREQUENCY**2 - w**2 + 2j * RATIO * FREQUENCY * w)
    u, y = (np.fft.irfft(part, TICKS) for part in (spectrum, spectrum * response))
    noisy: Vector = y + 3e-3 * y.std() * rng.standard_normal(TICKS)
    return t, np.asarray(u, dtype=np.float64), noisy


def write(path: Path, t: Vector, u: Vector, y: Vector) -> Path:
    rows = np.column_stack((t, u, y))
    np.savetxt(path, rows, delimiter=",", header="time,u,y", comments="", fmt="%.12g")
    return path


@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize("hold", [None, "band-limited"])
def test_one_mode_of_a_signal_that_is_not_held_is_one_mode(
    tmp_path: Path, seed: int, hold: Hold | None
) -> None:
    path = write(tmp_path / "lab.csv", *multisine(seed))
    columns = FileColumns(inputs=("u",), outputs=("y",), hold=hold)
    experiment, notes = experiment_of_file(path, columns)
    assert any("samples of a band-limited signal" in note for note in notes) is (hold is None)
    model = identify([experiment]).model
    (mode,) = [one for one in model.modes if one.frequency.value < model.band[1]]
    assert mode.frequency.value == pytest.approx(FREQUENCY, rel=1e-4)
    assert mode.damping_ratio.value == pytest.approx(RATIO, rel=2e-3)


@pytest.mark.parametrize("seed", range(3))
def test_efforts_that_were_held_are_read_as_held(seed: int) -> None:
    """The residual of a spring that stiffens is no white noise in either way."""
    assert acts_as_held(spring_record(seed, 4096))


@pytest.mark.parametrize("ratio", [1.0, 0.1, 0.001])
def test_a_closed_loop_of_held_efforts_is_read_as_held(ratio: float) -> None:
    """Its efforts follow the noise of the readings at once, however loud that is."""
    plan = {"band": [0.3, 6.0], "largest_excursion": [0.2], "duration": 60.0, "resolution": 0.4}
    gains = np.array([4.0]), np.array([8.0])
    testbed = bench(kind="floating_oscillator", damping_ratio=0.02)
    random = np.random.default_rng(5)
    assert acts_as_held(shaken(testbed, plan, gains, random, ratio=ratio, period=0.02).record)


def test_a_slow_signal_is_taken_in_the_middle_of_each_tick(tmp_path: Path) -> None:
    t = PERIOD * np.arange(400, dtype=np.float64)
    w = np.array([2.0, 300.0, 900.0])[:, None]
    u: Vector = np.asarray(np.sin(w * t).sum(axis=0), dtype=float)
    columns = FileColumns(inputs=("u",), outputs=("y",), hold="band-limited")
    record = experiment_of_file(write(tmp_path / "lab.csv", t, u, u), columns)[0].record
    middle = t[23:-25] + 0.5 * PERIOD
    expected = (np.sin(w * middle) / np.sinc(w * PERIOD / (2.0 * np.pi))).sum(axis=0)
    assert record.ticks == len(middle)
    np.testing.assert_allclose(record.effort[:, 0], expected, atol=1e-6)
    np.testing.assert_allclose(record.measured[:-1, 0], u[23:-25], atol=1e-10)


@pytest.mark.parametrize(
    ("spoilt", "past", "words"),
    [
        ("gap", False, "needs 96 or more samples at even times without gaps"),
        ("short", False, "96 or more samples"),
        (
            "",
            True,
            "'band-limited' is not allowed: efforts that end at their stamps are held",
        ),
    ],
)
def test_what_does_not_fit_is_refused(tmp_path: Path, spoilt: str, past: bool, words: str) -> None:
    t, u, y = (part[:300] for part in multisine(1))
    kept = {"gap": np.arange(300) != 150, "short": t < t[90], "": t >= 0.0}[spoilt]
    path = write(tmp_path / "lab.csv", t[kept], u[kept], y[kept])
    columns = FileColumns(inputs=("u",), outputs=("y",), past=past, hold="band-limited")
    with pytest.raises(BadInput, match=words):
        experiment_of_file(path, columns)
