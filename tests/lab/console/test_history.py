"""What charts draw: arrays that grow and forget, extremes that survive thinning."""

import numpy as np
import pytest

from flexslew_lab.console.history import LIMIT, Curve, Track, reduce_samples


def test_a_track_keeps_rows_and_begins_anew_after_a_reset() -> None:
    track = Track()
    for start in range(0, 1000, 7):
        time = np.arange(start, min(start + 7, 1000), dtype=float) * 0.01
        track.add(time, {"q": np.column_stack((time, -time))})
    assert np.array_equal(track.time, np.arange(1000) * 0.01)
    assert np.array_equal(track.column("q")[:, 1], -track.time)
    assert track.column("unknown").shape == (1000, 0)
    track.add(np.array([0.0]), {"q": np.ones((1, 2))})
    assert track.time.tolist() == [0.0]


def test_a_column_that_widens_is_filled_up() -> None:
    track = Track()
    track.add(np.array([0.0]), {"q": np.ones((1, 1))})
    track.add(np.array([0.1]), {"q": np.ones((1, 3))})
    assert np.isnan(track.column("q")[0, 1:]).all()
    assert (track.column("q")[1] == 1.0).all()


def test_a_long_run_forgets_its_beginning_and_nothing_else() -> None:
    track, batch = Track(), 30_000
    for k in range(2 * LIMIT // batch + 1):
        time = np.arange(k * batch, (k + 1) * batch, dtype=float) * 0.01
        track.add(time, {"q": time[:, None]})
        assert track.time.size <= LIMIT
        assert np.array_equal(track.column("q")[:, 0], track.time)
    assert track.time[-1] == time[-1]
    assert np.allclose(np.diff(track.time), 0.01)


@pytest.mark.parametrize("seed", range(20))
def test_thinning_keeps_every_extreme(seed: int) -> None:
    rng = np.random.default_rng(seed)
    time = np.cumsum(rng.uniform(0.001, 0.1, rng.integers(700, 5000)))
    curve = Curve("a", time, rng.standard_normal(time.size))
    start, end = np.sort(rng.uniform(0.0, time[-1], 2))
    axis, (row,) = reduce_samples([curve], start, end)
    assert (axis[0], axis[-1]) == (start, end)
    inside = curve.value[(time >= start) & (time < end)]
    known = row[np.isfinite(row)]
    assert len(axis) == len(row) <= 1200
    assert (np.diff(axis) > 0).all()
    if inside.size > 2:
        assert known.min() <= inside.min()
        assert known.max() >= inside.max()
        assert known.min() >= curve.value.min()
        assert known.max() <= curve.value.max()


def test_few_points_stay_as_they_are_and_curves_of_other_ticks_share_the_axis() -> None:
    a = Curve("a", np.array([0.0, 1.0, 2.0]), np.array([1.0, 2.0, 3.0]))
    b = Curve("b", np.array([1.0, 1.5]), np.array([5.0, 6.0]))
    axis, (first, second) = reduce_samples([a, b], 0.0, 2.0)
    assert axis.tolist() == [0.0, 1.0, 1.5, 2.0]
    assert first[[0, 1, 3]].tolist() == [1.0, 2.0, 3.0]
    assert np.isnan(second[[0, 3]]).all()
    assert second[[1, 2]].tolist() == [5.0, 6.0]


@pytest.mark.parametrize("points", [5, 5000])
def test_a_window_is_as_wide_as_it_says_after_a_stall(points: int) -> None:
    late = np.linspace(100.0, 110.0, points)
    time = np.concatenate(([9.0], late))  # nothing came for 91 s
    axis, (row,) = reduce_samples([Curve("a", time, 2.0 * time)], 80.0, 110.0)
    assert (axis[0], axis[-1]) == (80.0, 110.0)
    known = np.isfinite(row)
    assert row[0] == pytest.approx(160.0)  # on the line from the point before the window
    assert np.allclose(
        row[known], 2.0 * axis[known], atol=0.2
    )  # the slope times the width of a bucket


def test_a_window_without_data_is_as_wide_as_it_says() -> None:
    for curves in ([], [Curve("a", np.zeros(0), np.zeros(0))]):
        assert reduce_samples(curves, 0.0, 30.0)[0].tolist() == [0.0, 30.0]
