"""`./flexslew reproduce antennas`: the parts that take seconds; the command flies all rows."""

import pytest

from flexslew_lab.reproduce import antennas, trial_flights


def test_every_constant_is_as_published() -> None:
    rows = antennas._beam_constants()
    assert [row["item"] for row in rows if not row["ok"]] == []


@pytest.mark.slow
def test_the_oscillator_flies_as_published() -> None:
    rows = antennas._example_3()
    assert [row["item"] for row in rows if not row["ok"]] == []
    assert len(rows) == 7


@pytest.mark.slow
def test_the_planar_antenna_flies_as_published() -> None:
    rows = antennas._example_4()
    assert [row["item"] for row in rows if not row["ok"]] == []
    assert len(rows) == 18


@pytest.mark.slow
def test_the_shipped_trials_fly_as_published() -> None:
    rows = trial_flights.example_trial_rows(("antenna_2", "antenna_4"))
    assert [row for row in rows if not row["ok"]] == []
    assert len(rows) == 7


@pytest.mark.slow
def test_the_membrane_flies_as_computed_independently() -> None:
    rows = antennas._example_5()
    assert [row["item"] for row in rows if not row["ok"]] == []
    assert sum(row["item"].startswith("example 5, case 2 controlled") for row in rows) == 4
